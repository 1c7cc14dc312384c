"""An environment of its own for each peer, and calls into it.

A peer is installed once into a virtual environment below a folder that is kept, at the version
given here, and called as a subprocess that answers with JSON on stdout.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["ELASTICA", "EXUDYN", "REQUIREMENTS", "Peer", "Unavailable", "ask", "prepare"]

ADAPTERS = Path(__file__).resolve().parent / "peers"


class Peer(NamedTuple):
    """What to install, and the adapter that calls it."""

    requirement: str
    adapter: str


EXUDYN = Peer("exudyn==1.13.6", "exudyn_beam.py")
ELASTICA = Peer("pyelastica==1.0.0", "elastica_rod.py")
REQUIREMENTS = (EXUDYN.requirement, ELASTICA.requirement)


class Unavailable(Exception):
    """A peer that cannot be installed, and why."""


def default_folder() -> Path:
    """In the user's cache."""
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(cache) / "skfem-cosserat" / "peers"


def prepare(peer: Peer, folder: str | Path | None = None) -> Path:
    """Python of the peer's environment, which is made where it is not there yet.

    Raises
    ------
    Unavailable
        If it cannot be installed: no wheel for this Python, no network.
    """
    home = default_folder() if folder is None else Path(folder)
    version = f"py{sys.version_info[0]}.{sys.version_info[1]}"
    place = home / f"{peer.requirement.replace('==', '-')}-{version}"
    python = place / ("Scripts" if os.name == "nt" else "bin") / "python"
    ready = place / "installed"
    if ready.exists():
        return python
    try:
        venv.create(place, with_pip=True, clear=True, symlinks=os.name != "nt")
        install = [str(python), "-m", "pip", "install", "--quiet", peer.requirement]
        subprocess.run(install, check=True, capture_output=True, text=True, timeout=900)
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or str(error)).strip().splitlines() or ["no reason given"]
        raise Unavailable(f"{peer.requirement} could not be installed: {lines[-1]}") from error
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Unavailable(f"{peer.requirement} could not be installed: {error}") from error
    ready.touch()
    return python


def ask(python: Path, peer: Peer, *options: str, timeout: float = 300.0) -> dict[str, Any]:
    """What the adapter answers; its ``status`` says what went wrong, if anything did."""
    command = [str(python), str(ADAPTERS / peer.adapter), *options]
    alone = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=timeout,
            env=alone | threads,
            check=True,
        )
        return json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        return {"status": f"no answer within {timeout:g} s"}
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or "").strip().splitlines() or ["no reason given"]
        return {"status": f"failed with exit status {error.returncode}: {lines[-1]}"}
    except json.JSONDecodeError as error:
        return {"status": f"no JSON in its answer: {error}"}
