"""The adapters of the folder ``peers``, an environment of its own for each, and calls into it.

A peer is installed once into a virtual environment below a folder that is kept, at the version that
its adapter names, and called as a subprocess that answers with JSON: see peers/README.md.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["Peer", "Unavailable", "ask", "peers", "prepare"]

ADAPTERS = Path(__file__).resolve().parent / "peers"
#: lines of an adapter that are read without importing it
STATED = re.compile(r'^(NAME|REQUIREMENT) = "(.*?)"', re.MULTILINE)


class Peer(NamedTuple):
    """Its name in tables, what to install (nothing: this Python has it), and the adapter."""

    name: str
    requirement: str
    adapter: Path


class Unavailable(Exception):
    """A peer that cannot be installed, and why."""


def peers(folder: Path = ADAPTERS) -> dict[str, Peer]:
    """All adapters of a folder by the names of their files: those that state a requirement."""
    found = {}
    for path in sorted(folder.glob("*.py")):
        stated = dict(STATED.findall(path.read_text(encoding="utf-8")))
        if "REQUIREMENT" in stated:
            found[path.stem] = Peer(stated.get("NAME", path.stem), stated["REQUIREMENT"], path)
    return found


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
    if not peer.requirement:
        return Path(sys.executable)
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


def ask(python: Path, peer: Peer, scene: dict[str, Any], timeout: float = 300.0) -> dict[str, Any]:
    """What the adapter answers; its ``status`` says what went wrong, if anything did.

    With ``process_s`` and ``wall_s``: CPU and wall time of the whole process (s).
    """
    alone = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    options: dict[str, Any] = {"capture_output": True, "text": True, "input": json.dumps(scene)}
    options |= {"timeout": timeout, "env": alone | threads}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    try:
        with tempfile.TemporaryDirectory() as elsewhere:  # some write a log where they are
            command = [str(python), str(peer.adapter)]
            done = subprocess.run(command, check=True, cwd=elsewhere, **options)
        answer = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        return {"status": f"no answer within {timeout:g} s"}
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or "").strip().splitlines() or ["no reason given"]
        return {"status": f"failed with exit status {error.returncode}: {lines[-1]}"}
    except json.JSONDecodeError as error:
        return {"status": f"failed: no JSON in its answer: {error}"}
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**answer, "process_s": spent, "wall_s": wall}
