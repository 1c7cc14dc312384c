"""Sections from meshes of their shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skfem import Mesh, MeshQuad1, MeshTri1, MeshTri2
from skfem.mesh import MeshQuad2

from ..errors import InputError
from ..figures import PALETTE, panels
from ..frozen import Frozen
from ..section import Material, Section
from ..types import ArrayLike, Floats, IndexArray, names_known, positive
from .warping import MaterialAnisotropic, ProfileConstants, Warping, elasticity, solve_warping

# -- boundary of a mesh as closed polygons ---------------------------------------------------------


def signed_area(polygon: Floats) -> float:
    """Area of a closed polygon (k, 2), positive if counter-clockwise.

    Examples
    --------
    >>> signed_area(np.array([[0, 0], [1, 0], [0, 1.0]]))
    0.5
    """
    x, y = (polygon - polygon[0]).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def boundary_loops(mesh: Mesh) -> list[Floats]:
    """Closed polygons (k, 2) of the boundary: the outer one first, then the holes.

    Curved edges are drawn by three points. The outer one goes counter-clockwise, holes clockwise.

    Examples
    --------
    >>> import skfem
    >>> boundary_loops(skfem.MeshTri().refined(2))[0].shape
    (4, 2)
    """
    facets = mesh.boundary_facets()
    curved = isinstance(mesh, (MeshTri2, MeshQuad2))
    middle = mesh.doflocs[:, mesh.dofs.facet_dofs[0, facets]] if curved else None
    at: dict[int, list[tuple[int, int]]] = {}
    for k, (a, b) in enumerate(mesh.facets[:, facets].T.tolist()):
        at.setdefault(a, []).append((k, b))
        at.setdefault(b, []).append((k, a))
    left = set(range(len(facets)))
    loops = []
    while left:
        k = min(left)
        start = node = int(mesh.facets[0, facets[k]])
        points = []
        while True:
            k, following = next((k, b) for k, b in at[node] if k in left)
            left.remove(k)
            points.append(mesh.p[:, node])
            if middle is not None:
                points.append(middle[:, k])
            node = following
            if node == start:
                break
        polygon = np.array(points)
        before = polygon - np.roll(polygon, 1, axis=0)
        after = np.roll(polygon, -1, axis=0) - polygon
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        # without points on the straight line between their neighbours
        loops.append(polygon[abs(cross) > 1e-9 * size])
    loops.sort(key=lambda loop: -abs(signed_area(loop)))
    return [
        loop if (signed_area(loop) > 0) == (k == 0) else loop[::-1] for k, loop in enumerate(loops)
    ]


# -- A cross-section as a mesh of the plane with its materials; solved to a tolerance --------------

AnyMaterial = Material | MaterialAnisotropic


def _checked_mesh(item: str, mesh: Mesh) -> Mesh:
    """Finite, of positive area, every edge between at most two elements, in one piece."""
    if not isinstance(mesh, (MeshTri1, MeshTri2, MeshQuad1, MeshQuad2)):
        raise InputError(
            item,
            f"mesh is a {type(mesh).__name__}, expected scikit-fem's MeshTri, MeshTri2, MeshQuad"
            " or MeshQuad2",
        )
    if mesh.nelements == 0:
        raise InputError(item, "mesh has no elements")
    if mesh.doflocs.shape[0] != 2 or not np.isfinite(mesh.doflocs).all():
        raise InputError(item, "points of the mesh are not two finite numbers each")
    counts = np.unique(
        np.sort(mesh.t[mesh_edges(mesh)], axis=0).reshape(2, -1), axis=1, return_counts=True
    )[1]
    if counts.max() > 2:
        raise InputError(item, f"an edge of the mesh belongs to {counts.max()} elements")
    if mesh.affine or type(mesh) is MeshQuad1:  # files hold points of construction lines
        mesh = mesh.remove_unused_nodes()
    size = _sizes(mesh)
    if (size <= 1e-12 * size.max()).any():
        raise InputError(item, f"element {int(size.argmin())} of the mesh has no area")
    pairs = mesh.f2t[:, mesh.f2t[1] >= 0]
    graph = coo_matrix((np.ones(pairs.shape[1]), pairs), shape=2 * (mesh.nelements,))
    parts, part = connected_components(graph, directed=False)
    if parts > 1:
        first = mesh.p[:, mesh.t[:, [np.argmax(part == k) for k in range(2)]]].mean(1)
        raise InputError(
            item,
            f"the section falls into {parts} parts that share no edge, e.g. those at"
            f" {first[:, 0].tolist()} and {first[:, 1].tolist()}; expected one piece",
        )
    return mesh


def mesh_edges(mesh: Mesh) -> IndexArray:
    """(2, edges) local vertices of each edge of an element."""
    n = mesh.t.shape[0]
    return np.array([np.arange(n), (np.arange(n) + 1) % n])


def _assigned(item: str, mesh: Mesh, names: list[str]) -> IndexArray:
    """Number of the named subdomain that each element is in: exactly one."""
    known = mesh.subdomains or {}
    index = np.full(mesh.nelements, -1)
    for k, name in enumerate(names):
        if name not in known:
            raise InputError(
                item, f"subdomain {name!r} is unknown; {names_known(name, sorted(known))}"
            )
        if (index[known[name]] >= 0).any():
            other = names[index[known[name]].max()]
            raise InputError(item, f"subdomains {other!r} and {name!r} share elements")
        index[known[name]] = k
    if (index < 0).any():
        raise InputError(
            item, f"{(index < 0).sum()} of {len(index)} elements are in none of {names}"
        )
    return index


class Profile(Frozen):
    """Cross-section of any shape and of any linear elastic materials.

    Parameters
    ----------
    mesh : skfem.MeshTri, MeshTri2, MeshQuad or MeshQuad2
        In the axes ``(X_1, X_2)`` along d1 and d2 (m), its origin on the beam's line. Curved
        meshes (``MeshTri2``, ``MeshQuad2``) are taken as the exact shape.
    material : Material or MaterialAnisotropic, or a dict of them by name
        Of the whole section, or of each of the mesh's subdomains, which cover it once.

    Raises
    ------
    InputError
        If the mesh is empty, has flat elements or an edge of three elements, or falls into parts;
        if an element has no material or two.

    Examples
    --------
    A mesh of scikit-fem, from a file for instance (``skfem.Mesh.load``):

    >>> import skfem
    >>> square = skfem.MeshTri().refined(2)                    # [0, 1] x [0, 1]
    >>> constants = Profile(square, Material(E=1.0, nu=0.0, rho=1.0)).constants()
    >>> constants.shear_factors.round(4).tolist(), round(constants.torsion_constant, 5)
    ([0.8333, 0.8333], 0.14058)
    """

    item = "profile"

    def __init__(self, mesh: Mesh, material: AnyMaterial | Mapping[str, AnyMaterial]):
        mesh = _checked_mesh(self.item, mesh)
        if isinstance(material, Mapping):
            index = _assigned(self.item, mesh, list(material))
            materials = list(material.values())
        else:
            index = np.zeros(mesh.nelements, np.int64)
            materials = [material]
        elasticities = [elasticity(each) for each in materials]
        first = [materials.index(each) for each in materials]  # given several times: once
        distinct = sorted(set(first))
        self.mesh = mesh
        self.index = np.array([distinct.index(k) for k in first])[index]
        self.materials = tuple(materials[k] for k in distinct)
        self.elasticities = np.stack([elasticities[k] for k in distinct])

    @property
    def outline(self) -> Floats:
        """Outer boundary (k, 2), counter-clockwise (m)."""
        return boundary_loops(self.mesh)[0]

    @property
    def holes(self) -> list[Floats]:
        """Boundaries (k, 2) of the holes, clockwise (m)."""
        return boundary_loops(self.mesh)[1:]

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self.mesh.nelements} elements,"
            f" {len(self.materials)} materials, {len(self.holes)} holes)"
        )

    def summary(self) -> dict[str, Any]:
        """Elements, area, materials."""
        area = sum(map(signed_area, self._loops()))
        return {"elements": self.mesh.nelements, "area in m²": area, "materials": self.materials}

    def _loops(self) -> list[Floats]:
        return boundary_loops(self.mesh)

    def constants(self, tolerance: float = 1e-4, max_elements: int = 20_000) -> ProfileConstants:
        """Solve Saint-Venant's problems, with the mesh refined where they need it.

        Each mesh is solved with elements of order 2 and of order 3. The relative difference of
        their energies, under the worst of all resultants, is the estimated error of the result,
        that of order 3; it does not see how far a polygon is from the curve it stands for.

        Parameters
        ----------
        tolerance : float
            Relative error allowed for the elastic energy under any resultants.
        max_elements : int
            Give up beyond.

        Returns
        -------
        ProfileConstants

        Raises
        ------
        InputError
            If the tolerance is not reached; with the error that is.
        """
        positive(self.item, "tolerance", tolerance)
        shift = _centroid(self.mesh)
        mesh = self.mesh.translated(-shift)
        index = self.index
        while True:
            coarse, fine = (
                solve_warping(mesh, order, index, self.elasticities) for order in (2, 3)
            )
            error = float(abs(eigh(coarse.compliance, fine.compliance)[0] - 1).max())
            if error <= tolerance:
                return self._result(fine, error).moved(-shift)
            finer = _refined(mesh, index, _marked(coarse, fine))
            if finer is None or finer[0].nelements > max_elements:
                raise InputError(
                    self.item,
                    f"tolerance = {tolerance:g} is not reached with {mesh.nelements} elements:"
                    f" error {error:.2g}; allow more than max_elements = {max_elements}, or more"
                    " error",
                )
            mesh, index = finer

    def section(
        self, tolerance: float = 1e-4, origin: ArrayLike = (0.0, 0.0), angle: float = 0.0
    ) -> Section:
        """The section of a beam.

        Parameters
        ----------
        tolerance : float
            See :meth:`constants`.
        origin : (2,) array
            Where the beam's line passes, in the axes of the profile (m).
        angle : float
            From the profile's axes to the directors d1 and d2 (rad).

        Examples
        --------
        >>> from skfem_cosserat.profile import ProfileRectangle
        >>> section = ProfileRectangle(0.01, 0.02, Material(210e9, 0.3, 7850)).section()
        >>> round(section.mass, 3)
        1.57
        """
        return self.constants(tolerance).moved(origin, angle).section()

    def _result(self, warping: Warping, error: float) -> ProfileConstants:
        dx = warping.basis.dx
        x = np.asarray(warping.basis.global_coordinates())
        rho = np.array([each.rho for each in self.materials])[warping.index][:, None] * dx
        mass = rho.sum()
        area = dx.sum()
        C = self.elasticities[warping.index]
        shear = np.einsum("eij,eq->ij", C[:, [[4, 3], [4, 3]], [[4, 4], [3, 3]]], dx)
        return ProfileConstants(
            stiffness=np.asarray(np.linalg.inv(warping.compliance)),
            area=float(area),
            centroid=np.einsum("ieq,eq->i", x, dx) / area,
            second_moments=np.einsum("ieq,jeq,eq->ij", x, x, dx),
            mass=float(mass),
            centre=np.einsum("ieq,eq->i", x, rho) / mass,
            inertia=np.einsum("ieq,jeq,eq->ij", x, x, rho),
            shear_moduli=shear,
            error=error,
            elements=warping.basis.mesh.nelements,
            unknowns=3 * warping.basis.N,
            outline=self.outline - _centroid(self.mesh),
            holes=tuple(hole - _centroid(self.mesh) for hole in self.holes),
            warping=warping,
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw the mesh by its materials; matplotlib's axes (of the extra ``view``).

        Without `ax` on a figure of its own: ``profile.plot().figure.savefig(...)``.
        """
        if ax is None:
            _, (ax,) = panels(5.0, 4.0)
        from matplotlib.collections import PolyCollection

        cells = PolyCollection(
            list(self.mesh.p.T[self.mesh.t.T]),
            array=self.index,
            cmap="Set3",
            edgecolor="0.5",
            linewidth=0.4,
        )
        ax.add_collection(cells)
        for loop in boundary_loops(self.mesh):
            ax.fill(*loop.T, fill=False, linewidth=1.2, edgecolor=PALETTE["ink"])
        ax.set(aspect="equal", xlabel="$X_1$ in m", ylabel="$X_2$ in m")
        ax.autoscale()
        return ax


def _sizes(mesh: Mesh) -> Floats:
    """About the area of each element: that between its corners."""
    x, y = mesh.p[:, mesh.t] - mesh.p[:, :1, None]
    return abs((x * np.roll(y, -1, axis=0) - y * np.roll(x, -1, axis=0)).sum(0))


def _centroid(mesh: Mesh) -> Floats:
    weight = _sizes(mesh)
    return mesh.p[:, mesh.t].mean(1) @ weight / weight.sum()


def _marked(coarse: Warping, fine: Warping) -> IndexArray:
    """Elements that hold most of the energy of the difference, for six loads of equal energy."""
    loads = np.linalg.inv(np.linalg.cholesky(fine.compliance)).T
    difference = np.einsum("rl,rieq->lieq", loads, fine.strains - coarse.strains)
    share = fine.energies(difference).sum(0)
    share_down = -np.sort(-share)
    total = share_down.cumsum()
    least = share_down[np.searchsorted(total, 0.8 * total[-1])]
    return np.flatnonzero(share >= (1 - 1e-6) * least)  # equal ones together


def _refined(mesh: Mesh, index: IndexArray, marked: IndexArray) -> tuple[Mesh, IndexArray] | None:
    """Triangles split where marked, straight quadrilaterals all; None for curved ones."""
    if isinstance(mesh, MeshQuad2):
        return None
    curved = isinstance(mesh, MeshTri2)
    straight = MeshTri1(mesh.p[:, : mesh.t.max() + 1], mesh.t) if curved else mesh
    # subdomains go along: the bits of the numbers of the elements say where each one came from
    number = np.arange(mesh.nelements)
    bits = range(mesh.nelements.bit_length())
    tagged = straight.with_subdomains({str(k): np.flatnonzero(number >> k & 1) for k in bits})
    finer = tagged.refined(marked) if mesh.t.shape[0] == 3 else tagged.refined()
    parent = np.zeros(finer.nelements, np.int64)
    for k in bits:
        parent[finer.subdomains[str(k)]] += 1 << k
    return (_bent(mesh, straight, finer, parent) if curved else finer), index[parent]


def _bent(mesh: MeshTri2, straight: MeshTri1, finer: MeshTri1, parent: IndexArray) -> MeshTri2:
    """The refined mesh ``finer`` of ``straight``, mapped to the curved shape of ``mesh``."""
    out = MeshTri2.from_mesh(finer)
    nodes = out.dofs.element_dofs
    local = straight.mapping().invF(out.doflocs[:, nodes.T], tind=parent)
    points = np.empty(out.doflocs.shape)
    points[:, nodes.T] = mesh.mapping().F(local, tind=parent)
    return replace(out, doflocs=points)
