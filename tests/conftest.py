"""Fixtures: a working off-screen renderer, and a synthetic scene with a known motion."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# before numpy is loaded: threads of BLAS only slow down the many small products
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# warnings of other packages are errors in pytest's workers and the processes that tests start;
# pip, which the README's line runs before, has some
if os.environ.get("SKFEM_COSSERAT_WARNINGS") == "error":
    os.environ["PYTHONWARNINGS"] = "error"

# scenes of one file of tests serve others, whatever folders both are in
sys.path.extend(sorted({str(file.parent) for file in Path(__file__).parent.glob("*/test_*.py")}))

import numpy as np
import pytest

from skfem_cosserat.integrators import choice

LONG_RUN, promising = choice.LONG_RUN, choice.promising
# "auto" does not look for compiled kernels here: what there is hangs on the tests run before
choice.promising = lambda: False


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--kernels",
        choices=("auto", "numba"),
        default="auto",
        help="numba: compiled kernels wherever there are some, but in tests of the plain ones",
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--kernels") == "numba":
        choice.LONG_RUN = 0


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases of a test with ``one_quick`` as slow, but for the first."""
    begun: set[str] = set()
    for item in items:
        if item.get_closest_marker("one_quick"):
            test = item.nodeid.split("[")[0]
            if test in begun:
                item.add_marker("slow")
            begun.add(test)


@pytest.fixture(autouse=True)
def _plain(request: pytest.FixtureRequest) -> Iterator[None]:
    """Tests of plain kernels: of which kernels are chosen, of iterations, of the last digits."""
    asked = choice.LONG_RUN
    if request.node.get_closest_marker("plain"):
        choice.LONG_RUN = LONG_RUN
    yield
    choice.LONG_RUN = asked


@pytest.fixture
def kept_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled kernels that are on disk are taken, as outside of the tests."""
    monkeypatch.setattr(choice, "promising", promising)


@pytest.fixture(params=["numpy", "numba"])
def kernels(request: pytest.FixtureRequest) -> str:
    """Kernels of a test whose statement holds with both: what ``kernels=`` of a run takes."""
    if request.param == "numba":
        pytest.importorskip("numba")
    return str(request.param)


SHOT = """
import sys, pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[64, 64])
plotter.add_mesh(pyvista.Sphere())
image = plotter.screenshot(return_img=True)
sys.exit(0 if image.std() > 1.0 else 3)
"""


@pytest.fixture(scope="session")
def renderer() -> None:
    """Skip unless a picture can be taken; in a subprocess, for VTK without OpenGL ends its process.

    With ``SKFEM_COSSERAT_RENDER=require`` in the environment the test fails instead.
    """
    try:
        run = subprocess.run(
            [sys.executable, "-c", SHOT], capture_output=True, text=True, timeout=60, check=False
        )
        code, text = run.returncode, run.stderr[-500:]
    except subprocess.TimeoutExpired:
        code, text = -1, "no answer within 60 s"
    if code == 0:
        return
    message = f"off-screen rendering does not work (exit code {code}): {text}"
    if os.environ.get("SKFEM_COSSERAT_RENDER") == "require":
        pytest.fail(message)
    pytest.skip(message)


NODES = {
    1: [0.0, 1.0],
    2: [0.0, 0.5, 1.0],
    3: [0.0, 0.5 - 0.2**0.5 / 2, 0.5 + 0.2**0.5 / 2, 1.0],
    4: [0.0, 0.5 - (3 / 28) ** 0.5, 0.5, 0.5 + (3 / 28) ** 0.5, 1.0],
}
GAUSS = {k: (np.polynomial.legendre.leggauss(k)[0] + 1.0) / 2.0 for k in range(1, 5)}
OUTLINE = np.array([[0.1, 0.05], [-0.1, 0.05], [-0.1, -0.05], [0.1, -0.05]])
BOX = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])
_FACES = "013 032 467 475 045 051 237 276 026 064 157 173"
BOX_FACES = np.array([[int(corner) for corner in face] for face in _FACES.split()])
#: Triad (in rows) of a beam along x, and the rotation from it to that of a leg along y.
ALONG_X = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
LEG = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def turn(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class Scene:
    """A straight beam, a bent beam, a box and a mass point turn about z with 1 rad/s and grow."""

    def __init__(self, order: int = 1) -> None:
        self.order = order
        p, n = order, 2 * order + 1
        line = np.concatenate([np.array(NODES[p][:-1]), 1.0 + np.array(NODES[p])])
        self.nodes = {
            "boom": np.column_stack([line, 0 * line, 0 * line]),
            "angle": np.column_stack(
                [np.minimum(line, 1.0), np.maximum(line - 1.0, 0.0), 0 * line + 1.0]
            ),
        }
        self.size = 2 * 12 * n + 12 + 3
        self.static: dict[str, Any] = {}
        for k, name in enumerate(self.nodes):
            turns = np.tile(np.eye(3), (2, p + 1, 1, 1))
            if name == "angle":
                turns[1] = LEG
            own = {
                "offsets": 12 * (k * n + np.arange(n)),
                "connectivity": np.array([np.arange(p + 1), p + np.arange(p + 1)]),
                "lengths": np.ones(2),
                "rotations": turns,
                "part": np.array([0, k]),
                "section": np.array([0, k]),
                "gauss": GAUSS[p],
                "outline/0": OUTLINE,
            }
            self.static |= {f"beam/{name}/{key}": value for key, value in own.items()}
        self.static |= {
            "body/hub/offset": np.array(24 * n),
            "body/hub/points": BOX,
            "body/hub/faces": BOX_FACES,
            "point/ball/offset": np.array(24 * n + 12),
        }
        self.meta: dict[str, Any] = {
            "integrator": "Synthetic",
            "step": 0.1,
            "versions": {"numpy": np.__version__},
            "beams": [
                {"name": "boom", "order": p, "parts": ["a"], "sections": ["box"]},
                {"name": "angle", "order": p, "parts": ["b", "c"], "sections": ["box", "none"]},
            ],
            "bodies": [{"name": "hub", "shape": "box"}],
            "points": [{"name": "ball"}],
            "joints": [
                {"name": "pin", "type": "revolute", "a": "hub", "b": "boom"},
                {"name": "weld", "type": "rigid", "a": "boom", "b": "ball"},
            ],
        }

    def motion(self, t: float) -> np.ndarray:
        """Linear map of reference places to places at time t."""
        return (1.0 + 0.1 * t) * turn(t)

    def coordinates(self, t: float) -> np.ndarray:
        A, R = self.motion(t), turn(t)
        parts = []
        for nodes in self.nodes.values():
            d = np.tile((ALONG_X @ R.T).ravel(), (len(nodes), 1))
            parts.append(np.hstack([nodes @ A.T, d]).ravel())
        body = [*(A @ [-0.5, 0.0, 0.0]), *R.T.ravel()]
        return np.concatenate([*parts, body, A @ [2.5, 0.0, 0.0]])

    def row(self, k: int) -> dict[str, Any]:
        t = 0.1 * k
        q = self.coordinates(t)
        e = 1e-6
        row: dict[str, Any] = {
            "t": t,
            "step": k,
            "q": q,
            "p": 2.0 * q,
            "v": (self.coordinates(t + e) - self.coordinates(t - e)) / (2 * e),
            "energy": 1.0 + 1e-9 * k,
            "kinetic": 0.5 + 0.4 * np.sin(t),
            "strain_energy": 0.5 - 0.4 * np.sin(t),
            "momentum": np.array([t, 2.0 * t, 1.0 / 3.0]),
            "joint/pin/position": self.motion(t) @ [-0.3, 0.0, 0.0],
            "joint/pin/force": np.array([1.0, t, 0.0]),
            "joint/weld/position": self.motion(t) @ [2.0, 0.0, 0.0],
        }
        values = np.arange(2 * self.order * 6, dtype=float).reshape(2, self.order, 6)
        for name in self.nodes:
            row[f"beam/{name}/resultant"] = values + t
            row[f"beam/{name}/strain"] = 0.001 * values + t
            ends = np.array([[0, 1], [1, 2]])[..., None] * np.arange(1.0, 7.0)
            row[f"beam/{name}/nodal_resultant"] = ends + t
            row[f"beam/{name}/nodal_strain"] = 0.001 * ends
        return row

    def history(self, states: int = 5) -> Any:
        from skfem_cosserat.history import HistoryWriter

        writer = HistoryWriter(self.meta, self.static)
        for k in range(states):
            writer.append(self.row(k))
        writer.close()
        return writer.history()


@pytest.fixture
def make_scene() -> type[Scene]:
    """Class of the synthetic scene."""
    return Scene
