"""Blades from input files of BeamDyn, the beam code of OpenFAST."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .beam import Beam
from .errors import InputError, MeshError
from .frames import ground
from .joint import JointFixed
from .kernels import skew
from .mesh import CurveSpline, MeshCurve
from .model import Model
from .section import Section
from .section_field import SectionTable
from .types import FilePath, Floats

#: how far entries may be off what they have to be, relative to the diagonal
WRONG = 1e-6
#: places that are one, relative to the length of the blade
NEAR = 1e-7
#: entries of a primary file that give the line, its sections and what is not read
READ = ("member_total", "kp_total", "BldFile")


class BladeBeamDyn(NamedTuple):
    """A blade as files of BeamDyn describe it.

    Attributes
    ----------
    mesh : MeshCurve
        The reference axis, a smooth line through all key points, with nodes at these and at all
        stations.
    section : SectionTable
        Stiffness, mass and damping at the stations, linear in between as in BeamDyn.
    twist : callable
        Angle (rad) of the sections for an arc length (m), smooth through the key points.
    model : Model
        The blade alone, fixed at its root.
    beam : Beam
        That of the model, "blade".
    left : tuple of str
        Entries of the primary file that were not read: solver, actuator, output.
    """

    mesh: MeshCurve
    section: SectionTable
    twist: Callable[[float], float]
    model: Model
    beam: Beam
    left: tuple[str, ...]


def read_beamdyn(path: FilePath, order: int = 3) -> BladeBeamDyn:
    """Read a blade from the primary input file of BeamDyn and the blade file that it names.

    Coordinates are those of the file: z along the blade, x to the suction side, y to the trailing
    edge; sections have d1, d2, d3 along these, turned by the twist about -z.

    Parameters
    ----------
    path : path-like
        The primary file. The blade file is looked for beside it.
    order : int
        Polynomial order of the elements, of which there is one between two stations or key points.

    Returns
    -------
    BladeBeamDyn
        Damping matrices are ``sqrt(mu_i mu_j) S_ij``, which is BeamDyn's ``mu_i S_ij`` on the
        diagonal, and symmetric.

    Raises
    ------
    MeshError
        If a file is missing, an entry is no number, a table ends early, stations do not increase
        from 0 to 1, a stiffness is not symmetric positive definite or a mass matrix not that of a
        flat section, with the line.

    Examples
    --------
    >>> blade = read_beamdyn("IEA-15-240-RWT_BeamDyn.dat")   # doctest: +SKIP
    >>> blade.model.freeze()   # doctest: +SKIP
    """
    primary = _Lines(Path(path))
    points, angles = _key_points(primary)
    curve = CurveSpline(points)
    table = _stations(_Lines(primary.path.parent / primary.text("BldFile")), curve.length)
    # sections have kinks at stations, the line and its twist (slightly) at key points
    places = np.union1d(table.s, curve.knots)
    places = places[np.append(True, np.diff(places) > NEAR * curve.length)]
    mesh = MeshCurve.init_curve(curve, 1, name="blade").at(places[1:-1])
    from scipy.interpolate import CubicSpline  # slow to import

    # the director is d2: y as far as possible; d1 is a quarter turn back
    twist = CubicSpline(curve.knots, -0.5 * np.pi - np.radians(angles), bc_type="not-a-knot")

    model = Model()
    beam = model.add("blade", Beam(mesh, table, order=order, director=(0.0, 1.0, 0.0), twist=twist))
    model.add("root", JointFixed(ground(points[0]), beam.node("blade.start")))
    left = tuple(name for name in primary.entries if name not in READ)
    return BladeBeamDyn(mesh, table, twist, model, beam, left)


class _Lines:
    """A file line by line, with entries ``value name - what it is``."""

    def __init__(self, path: Path):
        self.path = path
        try:
            self.lines = path.read_text(errors="replace").splitlines()
        except OSError as error:
            raise MeshError(f"file '{path}'", f"cannot be read: {error.strerror}") from error
        #: numbers of the lines of entries by name, and their values without quotes
        self.entries: dict[str, int] = {}
        self.texts = {}
        for k, line in enumerate(self.lines):
            found = re.match(r'\s*("[^"]*"|\S+)\s+([A-Za-z_]\w*)\s+-', line)
            if found and found[2] not in self.entries:
                self.entries[found[2]], self.texts[found[2]] = k, found[1].strip('"')

    def text(self, name: str) -> str:
        """Value of an entry, which has to be there."""
        if name not in self.texts:
            raise MeshError(f"file '{self.path}'", f"has no entry {name}")
        return self.texts[name]

    def count(self, name: str) -> int:
        """A whole number, of an entry that has to be there."""
        value = self.text(name)
        if not value.isdigit():
            raise self.wrong(self.entries[name], f"{name} = {value}, expected a whole number")
        return int(value)

    def numbers(self, k: int, count: int) -> Floats:
        """The numbers with which a line begins."""
        words = self.lines[k].split()[:count] if k < len(self.lines) else []
        try:  # as Fortran writes them
            found = np.array([float(word.upper().replace("D", "E")) for word in words])
        except ValueError:
            found = np.zeros(0)
        if len(found) < count or not np.isfinite(found).all():
            text = " ".join(words) or "nothing"
            raise self.wrong(k, f"{text}, expected {count} numbers")
        return found

    def wrong(self, k: int, text: str) -> MeshError:
        """An error about a line."""
        return MeshError(f"file '{self.path}'", f"line {k + 1}: {text}")


def _key_points(primary: _Lines) -> tuple[Floats, Floats]:
    """Key points (k, 3) in m, and twists (k,) in degrees."""
    count = primary.count("kp_total")
    members = primary.count("member_total")
    first = primary.entries["kp_total"] + 1 + members + 2  # two lines of headings
    rows = np.array([primary.numbers(k, 4) for k in range(first, first + count)])
    return rows[:, :3], rows[:, 3]


def _stations(blade: _Lines, length: float) -> SectionTable:
    """The table of a blade file, for a line of this length (m)."""
    count = blade.count("station_total")
    kind = blade.count("damp_type")
    end = len(blade.lines)
    rows = [k for k in range(end) if blade.lines[k].split()]
    titles = [i for i, k in enumerate(rows) if blade.lines[k].lstrip().startswith("---")]
    if not titles or rows[titles[-1]] < blade.entries["damp_type"]:
        raise MeshError(f"file '{blade.path}'", "has no table of stations under a '---' heading")
    if kind > 1:
        text = f"damp_type = {kind}, expected 0 or 1: others are not read"
        raise blade.wrong(blade.entries["damp_type"], text)
    mu = blade.numbers(rows[titles[-1] - 1], 6) if kind else np.zeros(6)
    table = [*rows[titles[-1] + 1 :], *[end] * 13 * count]
    eta: list[float] = []
    stations = []
    for k in range(count):
        own = table[13 * k :][:13]
        eta.append(blade.numbers(own[0], 1)[0])
        if not (eta[-2] < eta[-1] <= 1 if k else eta[0] == 0):
            raise blade.wrong(own[0], f"station at {eta[-1]:.6g}, expected to increase, 0 to 1")
        matrices = np.array([blade.numbers(row, 6) for row in own[1:]])
        try:
            stations.append(_station(matrices, mu))
        except InputError as error:
            raise blade.wrong(own[0], f"station at {eta[-1]:.6g}: {error}") from error
    if eta[-1] != 1.0:
        raise blade.wrong(own[0], f"the last station is at {eta[-1]:.6g}, expected 1")
    values: dict[str, Any] = {
        name: [getattr(each, name) for each in stations]
        for name in ("stiffness", "mass", "inertia", "centre", "viscosity")
    }
    return SectionTable(np.array(eta) * length, **values)


def _station(rows: Floats, mu: Floats) -> Section:
    """The section of a station, of twelve rows of its matrices.

    InputError for matrices that no flat section has.
    """
    D = rows[:6]
    M = rows[6:]
    mass, a, b, c = M[0, 0], M[4, 4], -M[3, 4], M[3, 3]
    centre = np.array([M[1, 5], -M[0, 5]]) / mass
    arm = mass * skew(np.append(centre, 0.0))
    turning = np.array([[c, -b, 0.0], [-b, a, 0.0], [0.0, 0.0, a + c]])
    flat = np.block([[mass * np.eye(3), -arm], [arm, turning]])
    for matrix, expected, what in ((D, D.T, "symmetric"), (M, flat, "that of a flat section")):
        off = abs(matrix - expected) / np.sqrt(abs(np.outer(np.diag(expected), np.diag(expected))))
        if not off.max() < WRONG:
            i, j = np.unravel_index(off.argmax(), (6, 6))
            text = f"entry {i + 1}, {j + 1} is {matrix[i, j]:.6g}, not {expected[i, j]:.6g}"
            raise InputError("a matrix", f"is not {what}: {text}")
    D = 0.5 * (D + D.T)
    viscosity = D * np.sqrt(np.outer(mu, mu))
    return Section(D, mass, [[a, b], [b, c]], viscosity=viscosity, centre=centre)
