"""Profiles of common shapes, on mapped meshes of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from skfem import Mesh, MeshTri1, MeshTri2

from ..errors import InputError
from ..section import all_positive
from ..types import Floats, IndexArray, positive, shaped
from .profile import AnyMaterial, Profile

#: A rectangle of a profile: its ends along d1, along d2 (m), and its material.
Part = tuple[Sequence[float], Sequence[float], AnyMaterial]


def _lines(ends: Floats) -> tuple[Floats, IndexArray]:
    """Ends sorted, those equal to round-off once; and the position of each given end."""
    size = np.ptp(ends)
    order = ends.argsort(axis=None)
    new = np.diff(ends.ravel()[order], prepend=-np.inf) > 1e-9 * size
    place = np.empty(ends.size, np.int64)
    place[order] = new.cumsum() - 1
    return ends.ravel()[order][new], place.reshape(ends.shape)


def _divided(x: Floats, size: float) -> tuple[Floats, IndexArray]:
    """Each interval in equal parts at most ``size`` long; the interval of each part."""
    counts = np.ceil(np.diff(x) / size - 1e-9).astype(int)
    parts = [
        np.linspace(a, b, n, endpoint=False) for a, b, n in zip(x, x[1:], counts, strict=False)
    ]
    return np.append(np.concatenate(parts), x[-1]), np.arange(len(counts)).repeat(counts)


class ProfileRectangles(Profile):
    """Rectangles side by side, each of its own material: built-up, sandwich, rolled sections.

    Parameters
    ----------
    parts : sequence of ((a, b), (c, d), material)
        Rectangles ``a <= X_1 <= b``, ``c <= X_2 <= d`` (m). They may share edges or parts of them,
        where they are bonded, and must not overlap.

    Examples
    --------
    A sandwich of aluminium faces and a light core:

    >>> from skfem_cosserat import Material
    >>> skin, core = Material(70e9, 0.33, 2700), Material(70e6, 0.33, 60)
    >>> sandwich = ProfileRectangles([
    ...     ((-0.05, 0.05), (0.020, 0.022), skin), ((-0.05, 0.05), (-0.020, 0.020), core),
    ...     ((-0.05, 0.05), (-0.022, -0.020), skin)])
    >>> round(sandwich.constants(1e-3).mass, 3)
    1.32
    """

    item = "profile of rectangles"

    def __init__(self, parts: Sequence[Part]):
        if len(parts) == 0:
            raise InputError(self.item, "no rectangles are given")
        ends = shaped(self.item, "ends", [part[:2] for part in parts], (len(parts), 2, 2))
        for k, part in enumerate(ends):
            if (part[:, 1] <= part[:, 0]).any():
                raise InputError(
                    self.item, f"rectangle {k}: ends {part.tolist()}, expected a < b and c < d"
                )
        # triangles are at most three times longer than wide
        size = 3 * np.diff(ends, axis=2).min()
        (x, place_x), (y, place_y) = (_lines(ends[:, axis]) for axis in range(2))
        owner = np.full((len(x) - 1, len(y) - 1), -1)
        for k, ((a, b), (c, d)) in enumerate(zip(place_x, place_y, strict=True)):
            if (owner[a:b, c:d] >= 0).any():
                raise InputError(self.item, f"rectangles {owner[a:b, c:d].max()} and {k} overlap")
            owner[a:b, c:d] = k
        mesh, names = _grid(x, y, owner, size)
        super().__init__(mesh, dict(zip(names, (part[2] for part in parts), strict=True)))


def _grid(x: Floats, y: Floats, owner: IndexArray, size: float) -> tuple[Mesh, list[str]]:
    """Triangles of the cells that are owned, a subdomain for each owner."""
    (x, column), (y, row) = _divided(x, size), _divided(y, size)
    cell = owner[np.ix_(column, row)]
    i, j = (cell >= 0).nonzero()
    corner = i * len(y) + j
    a, b, c, d = corner, corner + len(y), corner + len(y) + 1, corner + 1
    even = (i + j) % 2 == 0
    t = np.hstack(
        [
            np.where(even, [a, b, c], [a, b, d]),
            np.where(even, [a, c, d], [b, c, d]),
        ]
    )
    used, t = np.unique(t, return_inverse=True)
    points = np.stack([x.repeat(len(y)), np.tile(y, len(x))])[:, used]
    owners = np.tile(cell[i, j], 2)
    names = [f"rectangle {k}" for k in range(owner.max() + 1)]
    mesh = MeshTri1(points, t.reshape(3, -1)).with_subdomains(
        {name: np.flatnonzero(owners == k) for k, name in enumerate(names)}
    )
    return mesh, names


class ProfileRectangle(ProfileRectangles):
    """Solid rectangle.

    Parameters
    ----------
    a, b : float
        Edges along d1 and d2 (m).
    material : Material or MaterialAnisotropic

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> ProfileRectangle(0.01, 0.02, Material(210e9, 0.0, 7850)).constants().shear_factors.round(4)
    array([0.8333, 0.8333])
    """

    def __init__(self, a: float, b: float, material: AnyMaterial):
        self.item = "rectangle"
        all_positive(self.item, a=a, b=b)
        # two parts along the shorter edge, so that both axes are axes of symmetry of the mesh
        x = a / 2
        y = b / 2
        mesh, names = _grid(
            np.array([-x, 0, x]), np.array([-y, 0, y]), np.zeros((2, 2), int), min(a, b)
        )
        Profile.__init__(self, mesh, {names[0]: material})


class ProfileI(ProfileRectangles):
    """I of constant thicknesses: a web along d2 between two flanges along d1.

    Parameters
    ----------
    height : float
        Over all, along d2 (m).
    width : float or (bottom, top)
        Of the flanges, along d1 (m).
    flange : float or (bottom, top)
        Their thickness (m).
    web : float
        Thickness (m).
    material : Material or MaterialAnisotropic

    Notes
    -----
    The origin is in the middle of height and web. Corners are sharp; for fillets take
    :class:`ProfilePolygon` or a mesh.

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> beam = ProfileI(0.2, 0.1, 0.008, 0.006, Material(210e9, 0.3, 7850))
    >>> round(beam.constants(1e-2).area, 6)
    0.002704
    """

    def __init__(
        self,
        height: float,
        width: float | tuple[float, float],
        flange: float | tuple[float, float],
        web: float,
        material: AnyMaterial,
    ):
        self.item = "I"
        (low, high), (t_low, t_high) = _pair("width", width), _pair("flange", flange)
        all_positive(self.item, height=height, web=web)
        if t_low + t_high >= height or web > min(low, high):
            raise InputError(
                self.item,
                f"height = {height!r}, width = {width!r}, flange = {flange!r}, web = {web!r}:"
                " expected room for the web between the flanges, and a web within their width",
            )
        y = height / 2
        super().__init__(
            [
                ((-low / 2, low / 2), (-y, -y + t_low), material),
                ((-web / 2, web / 2), (-y + t_low, y - t_high), material),
                ((-high / 2, high / 2), (y - t_high, y), material),
            ]
        )


def _pair(name: str, value: float | tuple[float, float]) -> tuple[float, float]:
    low, high = np.broadcast_to(shaped("I", name, value, (), (2,)), 2).tolist()
    return positive("I", name, low), positive("I", name, high)


class ProfileChannel(ProfileRectangles):
    """U of constant thicknesses: a web along d2, flanges from it along d1.

    Parameters
    ----------
    height, width : float
        Over all, along d2 and d1 (m).
    flange, web : float
        Thicknesses (m).
    material : Material or MaterialAnisotropic

    Notes
    -----
    The origin is in the middle of the height and of the web's thickness; the shear centre is on
    the other side of the web than the flanges, at negative ``X_1``.

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> channel = ProfileChannel(0.1, 0.05, 0.005, 0.004, Material(210e9, 0.3, 7850))
    >>> bool(channel.constants(1e-2).shear_centre[0] < -0.016)
    True
    """

    def __init__(
        self, height: float, width: float, flange: float, web: float, material: AnyMaterial
    ):
        self.item = "channel"
        all_positive(self.item, height=height, width=width, flange=flange, web=web)
        if 2 * flange >= height or web >= width:
            raise InputError(
                self.item,
                f"flange = {flange!r}, web = {web!r} do not fit into height = {height!r},"
                f" width = {width!r}",
            )
        y = height / 2
        x = (-web / 2, width - web / 2)
        super().__init__(
            [
                (x, (-y, -y + flange), material),
                ((-web / 2, web / 2), (-y + flange, y - flange), material),
                (x, (y - flange, y), material),
            ]
        )


class ProfileBox(ProfileRectangles):
    """Rectangular tube of constant thicknesses.

    Parameters
    ----------
    width, height : float
        Over all, along d1 and d2 (m).
    thickness : float or (sides, top and bottom)
        Of the walls (m).
    material : Material or MaterialAnisotropic

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> box = ProfileBox(0.1, 0.06, 0.004, Material(210e9, 0.3, 7850))
    >>> len(box.holes), round(box.constants(1e-2).area, 6)
    (1, 0.001216)
    """

    def __init__(
        self,
        width: float,
        height: float,
        thickness: float | tuple[float, float],
        material: AnyMaterial,
    ):
        self.item = "box"
        all_positive(self.item, width=width, height=height)
        sides, ends = _pair("thickness", thickness)
        x = width / 2
        y = height / 2
        if sides >= x or ends >= y:
            raise InputError(
                self.item,
                f"thickness = {thickness!r} does not fit into width = {width!r},"
                f" height = {height!r}",
            )
        between = (-y + ends, y - ends)
        super().__init__(
            [
                ((-x, x), (-y, -y + ends), material),
                ((-x, -x + sides), between, material),
                ((x - sides, x), between, material),
                ((-x, x), (y - ends, y), material),
            ]
        )


class ProfileRings(Profile):
    """Concentric layers, each of its own material: coated bars, lined tubes.

    Parameters
    ----------
    radii : (k + 1,) array
        Of the boundaries between layers from inside, increasing (m); the first is zero for a
        solid section.
    materials : sequence of k materials
        Of the layers from inside.
    segments : int
        Curved edges of a circle, a multiple of six. Arcs are parabolas: the area is exact to about
        ``3.3 / segments**4``, which the estimated error of the constants does not contain.

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> steel, copper = Material(210e9, 0.3, 7850), Material(120e9, 0.34, 8960)
    >>> wire = ProfileRings((0, 0.001, 0.0015), (steel, copper)).constants()
    >>> bool(np.isclose(wire.mass, np.pi * (7850 * 1e-6 + 8960 * 1.25e-6), rtol=1e-6))
    True
    """

    item = "rings"

    def __init__(
        self, radii: Sequence[float], materials: Sequence[AnyMaterial], segments: int = 48
    ):
        r = shaped(self.item, "radii", radii, (max(len(materials), 1) + 1,))
        if r[0] < 0 or (np.diff(r) <= 0).any():
            raise InputError(self.item, f"radii = {r.tolist()}, expected 0 <= first < second ...")
        if segments < 12 or segments % 6:
            raise InputError(self.item, f"segments = {segments!r}, expected a multiple of 6 >= 12")
        mesh, names = _rings(r, segments)
        super().__init__(mesh, dict(zip(names, materials, strict=True)))


def _rings(radii: Floats, segments: int) -> tuple[MeshTri2, list[str]]:
    """Curved triangles: a disk of hexagonal pattern if solid, then rings of equal division."""
    points, triangles, owners = [], [], []
    if radii[0] == 0:
        p, t = _disk(segments // 6)
        points.append(radii[1] * p)
        triangles.append(t)
        owners.append(np.zeros(t.shape[1], int))
        first = 1
        inner = p.shape[1] - segments
    else:
        points.append(radii[0] * _circle(segments))
        first = 0
        inner = 0
    number = inner + segments
    for k in range(first, len(radii) - 1):
        length = 2 * np.pi * radii[k + 1] / segments
        parts = int(np.ceil((radii[k + 1] - radii[k]) / (2 * length)))
        for r in np.linspace(radii[k], radii[k + 1], parts + 1)[1:]:
            points.append(r * _circle(segments))
            i = np.arange(segments)
            a = inner + i
            b = inner + (i + 1) % segments
            c = number + i
            d = number + (i + 1) % segments
            triangles.append(np.hstack([[a, b, d], [a, c, d]]))
            owners.append(np.full(2 * segments, k))
            inner = number
            number = number + segments
    owner = np.concatenate(owners)
    names = [f"layer {k}" for k in range(len(radii) - 1)]
    mesh = MeshTri1(np.hstack(points), np.hstack(triangles)).with_subdomains(
        {name: np.flatnonzero(owner == k) for k, name in enumerate(names)}
    )
    return _polar(mesh), names


def _circle(count: int) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)])


def _disk(count: int) -> tuple[Floats, IndexArray]:
    """Unit disk of ``count`` rings of 6, 12, 18 ... points around its centre."""
    points = [np.zeros((2, 1))]
    triangles = []
    start = [0, 1]
    for k in range(1, count + 1):
        points.append(k / count * _circle(6 * k))
        start.append(start[-1] + 6 * k)
        for sector in range(6):
            for j in range(k):
                a, b = (start[k] + (sector * k + j + i) % (6 * k) for i in range(2))
                below = [
                    start[k - 1] + (sector * (k - 1) + j + i) % max(6 * (k - 1), 1)
                    for i in range(2)
                ]
                triangles.append((a, b, below[0]))
                if j < k - 1:
                    triangles.append((b, below[0], below[1]))
    return np.hstack(points), np.array(triangles).T


def _polar(mesh: MeshTri1) -> MeshTri2:
    """Edges curved about the origin: their middles have the mean radius and the mean angle."""
    out = MeshTri2.from_mesh(mesh)
    ends = mesh.p[:, mesh.facets]
    r = np.linalg.norm(ends, axis=0)
    unit = np.divide(ends, r, out=np.zeros_like(ends), where=r > 0)
    direction = unit.sum(1)
    middle = r.mean(0) * direction / np.linalg.norm(direction, axis=0)
    points = out.doflocs.copy()
    points[:, out.dofs.facet_dofs[0]] = middle
    return replace(out, doflocs=points, _subdomains=mesh.subdomains)


class ProfileTube(ProfileRings):
    """Circular tube.

    Parameters
    ----------
    outer, inner : float
        Radii (m), ``0 < inner < outer``.
    material : Material or MaterialAnisotropic

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> tube = ProfileTube(0.05, 0.04, Material(70e9, 0.3, 2700)).constants()
    >>> bool(np.isclose(tube.torsion_constant, np.pi / 2 * (0.05**4 - 0.04**4), rtol=1e-5))
    True
    """

    def __init__(self, outer: float, inner: float, material: AnyMaterial):
        self.item = "tube"
        all_positive(self.item, outer=outer, inner=inner)
        if inner >= outer:
            raise InputError(self.item, f"inner = {inner!r}, expected inner < outer = {outer!r}")
        super().__init__((inner, outer), (material,))


class ProfileCircle(ProfileRings):
    """Solid circle.

    Parameters
    ----------
    radius : float
        (m).
    material : Material or MaterialAnisotropic

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> ProfileCircle(1.0, Material(1.0, 0.3, 1.0)).constants().shear_factors.round(4).tolist()
    [0.8507, 0.8507]
    """

    def __init__(self, radius: float, material: AnyMaterial):
        self.item = "circle"
        all_positive(self.item, radius=radius)
        super().__init__((0.0, radius), (material,))
