"""Geometrically exact (Simo-Reissner) beams with interpolated directors on a scikit-fem mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix

from .along import Along
from .basis import DirectorBasis, ElementLoad, ElementMatrix
from .body import RigidBody
from .element import Interpolation, InterpolationLobatto
from .errors import InputError, MeshError, ModelWarning
from .frames import LineItem, Place, Vertices, vector
from .frozen import lock_arrays, loosened, seal
from .kernels import (
    BeamElements,
    SectionPoints,
    beam_force,
    beam_moduli,
    beam_strain,
    beam_stress,
    beam_tangent,
    exp_quaternion,
    mass_blocks,
    null_space_blocks,
    rotation_matrix,
)
from .mesh import MeshCurve
from .mesh.divide import places_in
from .mesh.topology import arc_starts, find_chains, places_along
from .mesh.triads import check_bends
from .section import Section
from .section_field import SectionAlong, SectionField, SectionSampled, distinct, section_points
from .theory import Theory, TheoryReissner
from .types import Array, ArrayLike, Floats, IndexArray, VectorLike, shaped, switch
from .warn import Notices, warn

#: what gives a beam, or a named part, its sections
SectionLike = Section | SectionField | Callable[[float], Section]
#: steps of sections in a row that look like a smooth taper, and how large each may be: the
#: logarithm of EA EI_1 EI_2; how near to its end a kink does an element no harm, of its length
STAIRS, STEP, NEAR = 5, 3.0, 1e-6
NodalField = Callable[[Floats], ArrayLike] | ArrayLike | None


class Beam(LineItem):
    """Beam, or network of beams, on a mesh of lines: every node is a frame of 12 coordinates.

    All twelve components are interpolated alike and directors are not re-orthonormalised between
    nodes (113). Where several parts of the mesh meet in a node they are rigidly connected: each
    keeps the angle its section triad has against the node's triad in the reference.

    Parameters
    ----------
    mesh : MeshCurve
        Lines in space with named parts and nodes.
    section : Section, SectionField, callable, or dict of str to such
        One for all, or one for each named part; every element must get exactly one. Sections that
        vary along the line are a :class:`SectionTaper`, a :class:`SectionTable` or a function of
        the arc length (m) from the start of the part that gives a :class:`Section`.
    order : int or Interpolation
        Polynomial order of the elements, 1 to 8, on Gauss-Lobatto nodes with `order` Gauss
        points. For comparison, other nodes or Gauss points: ``InterpolationEquidistant(3)``,
        ``InterpolationLobatto(2, points=3)``.
    director : (3,) array or dict of str to (3,) array, optional
        Unit vector that d1 points to as far as possible; default: transported without twist.
    twist : float, callable or dict, optional
        Pre-twist about the tangent: rate (rad/m) or angle as function of arc length.
    velocity, angular_velocity : (3,) or (N, 3) array or callable, optional
        Initial velocity (m/s) and spatial angular velocity (rad/s) of the nodes; a callable gets
        the reference positions (N, 3).
    lumped : bool
        Mass by quadrature at the nodes, which makes the mass matrix nodal: what
        :class:`Explicit` needs. Of the same order as the consistent mass with Gauss-Lobatto nodes,
        which it asks for.
    theory : Theory, optional
        Which strains are modelled: by default all, :class:`TheoryReissner`; fewer with
        :class:`TheoryKirchhoff`, :class:`TheoryInextensible`.
    strain : (6,) array, callable or pair of arrays, optional
        Strains ``(Gamma, K)`` at which the sections are free of stress (1, 1/m): by heat, growth
        or prestress. The same everywhere, a function of the arc length (m) from the start of the
        part, or a table ``(s (k,), strains (k, 6))`` that is linear in between.

    Raises
    ------
    InputError
        If elements have no section, a part is unknown, a director is no unit vector or parallel
        to the line, or a field has a wrong shape.
    MeshError
        If directors flip inside an element, its line folds back, or it turns by 90 degrees or more
        between neighbouring nodes. More than it could be bent by is reported by a warning.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section, director=(1, 0, 0))
    >>> len(beam.vertices())
    5
    """

    kind = "beam"

    def __init__(
        self,
        mesh: MeshCurve,
        section: SectionLike | Mapping[str, SectionLike],
        *,
        order: int | Interpolation = 1,
        director: VectorLike | Mapping[str, VectorLike] | None = None,
        twist: Any = None,
        velocity: NodalField = None,
        angular_velocity: NodalField = None,
        lumped: bool = False,
        theory: Theory | None = None,
        strain: Any = None,
    ):
        if not isinstance(mesh, MeshCurve):
            raise InputError(
                self.label, f"mesh is {type(mesh).__name__}, expected MeshCurve (lines in space)"
            )
        if theory is not None and not isinstance(theory, Theory):
            raise InputError(
                self.label, f"theory = {theory!r}, expected a Theory, as TheoryInextensible()"
            )
        self.theory = TheoryReissner() if theory is None else theory
        self.mesh = mesh
        self._orientation = (director, twist, strain)
        self.basis = DirectorBasis(mesh, order=order)
        self.lumped = switch(self.label, lumped, "lumped")
        if self.lumped and not isinstance(self.basis.interpolation, InterpolationLobatto):
            other = self.basis.interpolation
            raise InputError(self.label, f"lumped with {other!r}, expected Gauss-Lobatto nodes")
        self._sections, self.section_id = self._assign(section)
        triads = self.basis.triads(directors=director, twist=twist)
        kind = self.basis.interpolation
        nodes = self.basis.connectivity
        with Notices() as notices:
            check_bends(mesh, kind, nodes, self.basis.nodes[nodes], triads, self.label)
            self._check_thickness()
            self._check_fields()
        #: what was doubtful when it was made, as ``history.meta["warnings"]`` of its runs repeats
        self.warnings = tuple(notices.found)
        self.triads = self.basis.nodal_triads(triads)
        self.rotations = self.basis.relative_rotations(triads)
        free = np.zeros(6) if strain is None else strain
        self._strain = Along(self.label, "strain", free, 6)
        self.velocity = self._field("velocity", velocity)
        self.angular_velocity = self._field("angular_velocity", angular_velocity)
        self.reference = np.concatenate([self.basis.nodes[:, None], self.triads], 1).reshape(-1)
        self.elements = self._elements()
        free = self.strains_at(np.arange(mesh.nelements), self.elements.points)
        if free[..., list(self.theory.held)].any():
            raise InputError(self.label, f"strain is of what {self.theory!r} holds: leave it out")
        self._lock()

    @property
    def sections(self) -> Mapping[str, Section | SectionField]:
        """Sections, or fields of them, by the names of parts; "section" if there is one for all."""
        return MappingProxyType(self._sections)

    @property
    def _varying(self) -> dict[str, SectionField]:
        """Those of the sections that vary along the line."""
        named = self.sections.items()
        return {name: each for name, each in named if isinstance(each, SectionField)}

    @property
    def _one_section(self) -> bool:
        return list(self.sections) == ["section"]

    def _parts(self) -> Iterator[tuple[str, Any]]:
        yield from (("elements", self.mesh.nelements), ("order", self.basis.order))
        yield from (("sections", self.sections), ("theory", self.theory))

    def summary(self) -> dict[str, Any]:
        """Length, mesh, mass and sections, those that vary at both ends of their elements."""
        rows = dict(self._parts()) | {"length in m": float(self.basis.lengths.sum())}
        rows["mass in kg"] = float(self.scalar_mass()[:, ::4, ::4].sum())
        starts, _ = self._part_lengths()
        for k, name in enumerate(rows.pop("sections")):
            own = np.flatnonzero(self.section_id == k)
            ends = own[np.argsort(starts[own])][[0, -1]]
            first, last = self.sections_at(ends, np.array([0.0, 1.0])).diagonal()
            both = {"start": first.summary(), "end": last.summary()}
            rows[name] = both if first is not last else first.summary()
        return rows

    def _loops(self) -> Sequence[Floats]:
        return next(iter(self.sections.values()))._loops()

    def _lock(self) -> None:
        lock_arrays(self.elements)

    def __setstate__(self, state: Any) -> None:
        super().__setstate__(state)
        self._lock()

    def _assign(
        self, section: SectionLike | Mapping[str, SectionLike]
    ) -> tuple[dict[str, Section | SectionField], IndexArray]:
        ne = self.mesh.nelements
        if not isinstance(section, Mapping) or not section:
            return {"section": self._section("= ", section)}, np.zeros(ne, np.int64)
        number = np.full(ne, -1, np.int64)
        given = {name: self._section(f"of part {name!r} is ", x) for name, x in section.items()}
        for k, name in enumerate(given):
            ids = self.mesh.elements_of(name)
            taken = ids[number[ids] >= 0]
            if len(taken):
                raise InputError(
                    self.label,
                    f"element {taken[0]} gets two sections, of"
                    f" {list(given)[number[taken[0]]]!r} and {name!r}",
                )
            number[ids] = k
        missing = np.flatnonzero(number < 0)
        if len(missing):
            raise InputError(
                self.label,
                f"{len(missing)} of {ne} elements have no section (first: element {missing[0]});"
                f" sections are given for the parts {sorted(given)}",
            )
        return given, number

    def _section(self, text: str, given: Any) -> Section | SectionField:
        if isinstance(given, (Section, SectionField)):
            return given
        if not callable(given) or isinstance(given, type):
            expected = "expected Section, SectionField, function of arc length or dict of them"
            raise InputError(self.label, f"section {text}{given!r}, {expected}")
        return SectionAlong(given)

    def arc_lengths(
        self, elements: IndexArray, part: str | None, xi: Floats
    ) -> tuple[Floats, float]:
        """Arc lengths (m, k) of places (k,) in elements (m,) along their line, and its length (m).

        The line is that of the part; without a name the whole beam, or if this is no single line
        the parts of the mesh, of which the length is that of the longest.
        """
        lines = self._lines() if part is None else (0 * self.section_id, [part])
        starts, totals = self._chains(self.part(part), *lines)
        places = starts[elements, None] + self.mesh.lengths[elements, None] * xi
        return places, float(np.nanmax(totals))

    def _lines(self) -> tuple[IndexArray, Iterable[str]]:
        """Numbers (ne,) and names of lines: the whole beam if it is one, else those of the mesh."""
        one = 0 * self.section_id
        with suppress(MeshError):  # parts point against each other
            if len(find_chains(self.mesh.t, one, [""]).chains()) == 1:
                return one, [""]
        return self.mesh.owners, self.mesh.beams

    def _chains(self, ids: IndexArray, owner: IndexArray, names: Iterable[str]) -> Floats:
        """Arc length (2, ne) from the start of its line to each element, and of the whole line.

        Lines are those of some elements that have one owner.
        """
        out = np.full((2, self.mesh.nelements), np.nan)
        lengths = self.mesh.lengths[ids]
        if len(ids):
            chains = find_chains(self.mesh.t[:, ids], owner[ids], list(names))
            out[0, ids] = arc_starts(chains, lengths)
            for chain in chains.chains():
                out[1, ids[chain.elements]] = lengths[chain.elements].sum()
        return out

    def _part_lengths(self) -> Floats:
        """As :meth:`_chains`, for the parts whose sections vary."""
        varying = np.array([name in self._varying for name in self.sections])
        lines = self._lines() if self._one_section else (self.section_id, self.sections)
        return self._chains(np.flatnonzero(varying[self.section_id]), *lines)

    def sections_at(self, elements: IndexArray, xi: Floats) -> Array:
        """Sections at places of elements, an array (m, k) of objects.

        Parameters
        ----------
        elements : (m,) int array
        xi : (k,) or (m, k) array
            Reference coordinates in [0, 1].
        """
        at = np.broadcast_to(xi, (len(elements), np.shape(xi)[-1]))
        given = np.array(list(self.sections.values()), object)[self.section_id[elements]]
        out = given[:, None].repeat(at.shape[1], 1)
        starts, totals = self._part_lengths()
        for m in np.flatnonzero(np.isfinite(totals[elements])):
            e = elements[m]
            for k, x in enumerate(at[m]):
                s = float(starts[e] + self.mesh.lengths[e] * x)
                try:
                    out[m, k] = given[m].inside(e, x, s, totals[e])
                except Exception as error:
                    name = list(self.sections)[self.section_id[e]]
                    text = f"its {name!r} at s = {s:.6g} m: {error}"
                    raise InputError(self.label, text) from error
        return out

    def strains_at(self, elements: IndexArray, xi: Floats) -> Floats:
        """Strains (m, k, 6) or (6,) without stress at places, see :meth:`sections_at`."""
        return self._strain.on(self, elements, None, xi)

    def section_points(self, elements: IndexArray, xi: Floats) -> SectionPoints:
        """What sections resist with at places of elements, as for :meth:`sections_at`."""
        return section_points(self.sections_at(elements, xi), self.theory.held)

    def _check_thickness(self) -> None:
        """Say that a section is thicker than the whole beam is long."""
        length = float(self.basis.lengths.sum())
        every = np.arange(self.mesh.nelements)
        kinds, number = distinct(self.sections_at(every, np.array([0.5]))[:, 0])
        for k, one in enumerate(kinds):
            name = list(self.sections)[self.section_id[np.argmax(number == k)]]
            thickness = 0.0 if one.outline is None else float(np.ptp(one.outline, axis=0).max())
            if thickness > length:
                warn(
                    self.label,
                    f"its {name!r} is {thickness:.3g} m thick, more than its whole length of"
                    f" {length:.3g} m: are both in m?",
                    ModelWarning,
                )

    def kinks(self) -> Iterator[tuple[str, float, int, float]]:
        """Kinks of sections that vary: their name, arc length (m), element and place in it, 0 to 1.

        One between two elements is that of the element that ends there.
        """
        starts, totals = self._part_lengths()
        for e in np.flatnonzero(np.isfinite(totals)).tolist():
            name = list(self.sections)[self.section_id[e]]
            for s in self._varying[name].kinks(float(totals[e])).tolist():
                xi = (s - starts[e]) / self.mesh.lengths[e]
                if NEAR < xi <= 1 + NEAR:
                    yield name, s, e, xi

    def _check_fields(self) -> None:
        """Say which sections cost accuracy."""
        for name, s, e, _ in [each for each in self.kinks() if each[3] < 1 - NEAR][:1]:
            warn(
                self.label,
                f"its {name!r} has a kink at s = {s:.6g} m, inside element {e}: errors fall with"
                " h^2 there, whatever the order; give the mesh vertices at its kinks, by"
                " mesh.at(s) or mesh.at(s, part)",
                ModelWarning,
            )
        starts, _ = self._chains(np.arange(len(self.section_id)), *self._lines())
        if self._varying or len(np.unique(starts)) < len(starts):
            return
        sections = self.sections_at(np.argsort(starts), np.array([0.5]))[:, 0]
        steps = np.diff([np.log(np.diag(each.stiffness)[2:5]).sum() for each in sections])
        steps = steps[steps != 0]
        if len(steps) >= STAIRS and (abs(steps) < STEP).all() and np.ptp(np.sign(steps)) == 0:
            warn(
                self.label,
                f"its sections change in {len(steps)} steps along the line, as those of a smooth"
                " taper cut into pieces do: errors fall with h^2, whatever the order; if it is"
                " one, give it a SectionTaper, a SectionTable or a function of the arc length",
                ModelWarning,
            )

    def _field(self, name: str, value: NodalField) -> Floats:
        nodes = self.basis.nodes
        if value is None:
            return np.zeros_like(nodes)
        given = value(nodes) if callable(value) else value
        array = shaped(self.label, name, given, (3,), nodes.shape)
        return np.broadcast_to(array, nodes.shape).copy()

    def _elements(self) -> BeamElements:
        basis = self.basis
        out = BeamElements.create(
            self.gather(self.reference),
            basis.lengths,
            basis.tabulated,
            self.section_points(np.arange(self.mesh.nelements), basis.tabulated.points),
            None if (self.rotations == np.eye(3)).all() else self.rotations,
        )
        out.reference += self.strains_at(np.arange(self.mesh.nelements), out.points)
        return out

    def __getstate__(self) -> dict[str, Any]:
        """Without functions, which need not reach other processes; sections as arrays."""
        kind = self.basis.interpolation
        every = np.arange(self.mesh.nelements)
        even = np.linspace(0.0, 1.0, kind.order + 1)
        xi = np.concatenate([kind.nodes, kind.full.points, self.elements.points, even, [0.5]])
        xi = np.unique(xi.round(14))
        sampled = SectionSampled(xi, self.sections_at(every, xi))
        sections = {
            name: sampled if isinstance(each, SectionField) else each
            for name, each in self.sections.items()
        }
        return self.__dict__ | {"_orientation": None, "_sections": sections}

    def refined(self, marked: Any = (), order: int | Interpolation | None = None) -> Self:
        """Copy of the beam with some elements halved, or of another order.

        Parameters
        ----------
        marked : int, array or str
            Elements to halve: numbers, a mask or the name of a part; an integer is the number of
            times that all are halved. See :meth:`MeshCurve.refined`.
        order : int or Interpolation, optional
            Of all its elements: a beam has one order; parts of different orders are beams of
            their own, joined by :class:`skfem_cosserat.JointFixed`.

        Returns
        -------
        Beam
            In no model yet. New nodes lie on the curves of the mesh; parts, named nodes, sections,
            directors and twist are the same, and so are initial velocities, which are interpolated
            in between. :func:`skfem_cosserat.carry_state` takes states along.

        Raises
        ------
        MeshError
            If there is no such element or part.
        InputError
            For an impossible order, or if the beam came from another process, where its twist is
            not known any more.

        Examples
        --------
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="rod"), section)
        >>> finer = beam.refined([0, 3], order=3)
        >>> finer.mesh.nelements, finer.node("rod.end").position.tolist()
        (6, [0.0, 2.0, 0.0])
        """
        return self.on_mesh(self.mesh.refined(marked), order)

    def on_mesh(
        self,
        mesh: MeshCurve,
        order: int | Interpolation | None = None,
        theory: Theory | None = None,
    ) -> Self:
        """Copy of the beam on another mesh of its lines, finer or coarser, or with another theory.

        Parameters
        ----------
        mesh : MeshCurve
            From :meth:`MeshCurve.refined` or :func:`skfem_cosserat.mesh.divided`.
        order : int or Interpolation, optional
            Of the elements; default: as it was.
        theory : Theory, optional
            Which strains are modelled; default: as it was.

        Returns
        -------
        Beam
            In no model yet, as from :meth:`refined`.

        Raises
        ------
        MeshError
            If the mesh does not divide the same lines in the same order.

        Examples
        --------
        >>> from skfem_cosserat.mesh import divided
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 20), section)
        >>> len(beam.on_mesh(divided(beam.mesh, 2), order=3).vertices())
        7
        """
        if self._orientation is None:
            raise InputError(self.label, "came from another process: refine it where it was made")
        director, twist, strain = self._orientation
        sections = self.sections
        beam = loosened(copy(self))  # with what a class of its own adds
        beam.name = None
        Beam.__init__(
            beam,
            mesh,
            sections["section"] if self._one_section else sections,
            order=self.basis.interpolation if order is None else order,
            director=director,
            twist=twist,
            lumped=self.lumped,
            theory=self.theory if theory is None else theory,
            strain=strain,
        )
        e, xi = places_in(self.mesh, mesh, beam.basis.interpolation.nodes)
        shape = self.basis.shape(xi)
        nodes = self.basis.connectivity[e]
        for name in ("velocity", "angular_velocity"):
            rates = np.zeros_like(beam.basis.nodes)
            old = getattr(self, name)[nodes]
            rates[beam.basis.connectivity] = np.einsum("aef,efai->efi", shape, old)
            vars(beam)[name] = rates
        return seal(beam)

    def rigid_body(self) -> RigidBody:
        """The body that this beam is if nothing strains it: one node in place of all.

        Mass, centre and inertia are exactly those of the elements; its frame is that of the first
        node, with the velocities there. Places on it: ``body.at(beam.node(...).position)``.

        Examples
        --------
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=3.0, inertia=(0.1, 0.2))
        >>> body = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section).rigid_body()
        >>> body.mass, body.center.round(12).tolist()   # along its d3
        (6.0, [0.0, 0.0, 1.0])
        """
        origin = self.basis.nodes[0]
        triad = self.triads[0]
        # phi and directors of each node by those of the first one
        carried = np.zeros((len(self.triads), 4, 4))
        carried[:, 0, 0] = 1
        carried[:, 0, 1:] = (self.basis.nodes - origin) @ triad.T
        carried[:, 1:, 1:] = self.triads @ triad.T
        nodes = self.basis.connectivity
        L = carried[nodes].reshape(len(nodes), -1, 4)
        M = np.einsum("eai,eab,ebj->ij", L, self.scalar_mass(), L)
        center = M[0, 1:] / M[0, 0]
        E = M[1:, 1:] - M[0, 0] * np.outer(center, center)
        return RigidBody(
            float(M[0, 0]),
            np.trace(E) * np.eye(3) - E,
            position=origin,
            triad=triad,
            center=center,
            velocity=self.velocity[0],
            angular_velocity=self.angular_velocity[0],
        )

    # -- scikit-fem side -----------------------------------------------------------------------

    def gather(self, q: Array) -> Array:
        """Coordinates of each element's nodes: (12 N,) -> (ne, 12 nn)."""
        return q.reshape(-1, 12)[self.basis.connectivity].reshape(len(self.basis.connectivity), -1)

    def internal_force_form(self) -> ElementLoad:
        """Internal force as a scikit-fem form: ``form.assemble(beam.basis, q=q)`` -> (12 N,).

        Examples
        --------
        >>> from skfem import asm
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section)
        >>> float(abs(asm(beam.internal_force_form(), beam.basis, q=beam.reference)).max())
        0.0
        """

        def internal_force(basis: DirectorBasis, q: Array) -> Array:
            eps, B = beam_strain(self.elements, self.gather(q))
            return beam_force(self.elements, B, beam_stress(self.elements, eps))

        return ElementLoad(internal_force)

    def tangent_form(self) -> ElementMatrix:
        """Derivative of the internal force as a scikit-fem form: ``assemble(beam.basis, q=q)``."""

        def tangent(basis: DirectorBasis, q: Array) -> Array:
            eps, B = beam_strain(self.elements, self.gather(q))
            stress = beam_stress(self.elements, eps)
            moduli = beam_moduli(self.elements, eps)
            return beam_tangent(self.elements, B, B, stress, 1.0, 1.0, moduli)

        return ElementMatrix(tangent)

    def mass_form(self) -> ElementMatrix:
        """Mass matrix (114) as a scikit-fem form: ``assemble(beam.basis)``."""

        def mass(basis: DirectorBasis) -> Array:
            return mass_blocks(self.scalar_mass())

        return ElementMatrix(mass)

    def linear(self) -> tuple[csr_matrix, csr_matrix]:
        """Stiffness K and mass M (6 N, 6 N) of small motions about the reference.

        Unknowns are those of ``beam.basis.linear()``: displacement and rotation of each node.
        Initial stress (``strain=``) counts.

        Raises
        ------
        InputError
            If the theory of the beam holds strains: these need a :class:`Model`.

        Examples
        --------
        Frequency of a cantilever in Hz (3.516 / (2 pi) sqrt(EI / m) at length 1):

        >>> from scipy.sparse.linalg import eigsh
        >>> section = Section([1e7, 1e7, 1e7, 500, 500, 500], mass=1.0, inertia=(1e-4, 1e-4))
        >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="rod")
        >>> beam = Beam(mesh, section, order=2)
        >>> free = beam.basis.linear().complement_dofs(beam.basis.linear().get_dofs("rod.start"))
        >>> K, M = (each[free][:, free] for each in beam.linear())
        >>> square = eigsh(K, 1, M, sigma=0.0)[0][0]
        >>> round(float(np.sqrt(square)) / (2 * np.pi), 2), round(3.516 * 500**0.5 / (2 * np.pi), 2)
        (12.51, 12.51)
        """
        q = self.reference
        basis = self.basis
        force = self.internal_force_form().assemble(basis, q=q)
        K, _ = self.reduce(self.tangent_form().assemble(basis, q=q), force, q)
        P = self._motions(q)
        return K, csr_matrix(P.T @ self.mass_form().assemble(basis) @ P)

    def reduce(self, K: Any, r: ArrayLike, q: ArrayLike) -> tuple[csr_matrix, Floats]:
        """Matrix and residual of Newton's method for displacements and rotations of nodes.

        The residual is ``P(q)^T r`` (69), which is free of the forces that keep directors
        orthonormal; the matrix is its derivative by a change as :meth:`update` takes it.

        Parameters
        ----------
        K : sparse (12 N, 12 N) matrix
            Derivative of r by q, such as that of ``beam.tangent_form()``.
        r : (12 N,) array
            Residual: internal less external forces.
        q : (12 N,) array
            Where they are taken.

        Returns
        -------
        K : csr_matrix
            (6 N, 6 N).
        r : (6 N,) array
            Forces (N) and moments (N m).

        Raises
        ------
        InputError
            If shapes do not fit, or the theory of the beam holds strains.

        Examples
        --------
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="rod"), section)
        >>> K = beam.tangent_form().assemble(beam.basis, q=beam.reference)
        >>> beam.reduce(K, np.zeros(beam.basis.N), beam.reference)[0].shape
        (30, 30)
        """
        n = self.basis.N
        if self.theory.held:
            raise InputError(self.label, f"its {self.theory!r} holds strains: put it into a Model")
        if np.shape(K) != (n, n):
            raise InputError("argument K", f"has shape {np.shape(K)}, expected ({n}, {n})")
        forces = shaped("argument", "r", r, (n,)).reshape(-1, 4, 3)[:, 1:]
        P = self._motions(q)
        d = shaped("argument", "q", q, (n,)).reshape(-1, 4, 3)[:, 1:]
        # directors turn with the rotation: d_i x r_i changes by (theta x d_i) x r_i
        turned = np.zeros((len(d), 6, 6))
        turned[:, 3:, 3:] = np.einsum("nia,nib->nab", d, forces)
        turned[:, 3:, 3:] -= (d * forces).sum((1, 2))[:, None, None] * np.eye(3)
        return csr_matrix(P.T @ K @ P + _diagonal(turned)), P.T @ np.asarray(r, float)

    def update(self, q: ArrayLike, du: ArrayLike) -> Floats:
        """Coordinates (12 N,) after displacements and rotations of the nodes.

        Parameters
        ----------
        q : (12 N,) array
        du : (6 N,) array
            Displacements (m) and rotation vectors in space, of any size.

        Raises
        ------
        InputError
            If shapes do not fit.

        Examples
        --------
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 1), section)
        >>> du = np.zeros(12)
        >>> du[8] = 0.5  # the second node goes up
        >>> beam.update(beam.reference, du)[12:15].tolist()
        [0.0, 2.0, 0.5]
        """
        n = self.basis.N
        new = shaped("argument", "q", q, (n,)).reshape(-1, 4, 3).copy()
        change = shaped("argument", "du", du, (n // 2,)).reshape(-1, 2, 3)
        new[:, 0] += change[:, 0]
        new[:, 1:] = new[:, 1:] @ rotation_matrix(exp_quaternion(change[:, 1])).transpose(0, 2, 1)
        return new.ravel()

    def _motions(self, q: ArrayLike) -> bsr_matrix:
        """``P(q)``: rates of coordinates by those of displacements and rotations of the nodes."""
        directors = shaped("argument", "q", q, (self.basis.N,)).reshape(-1, 4, 3)[:, 1:]
        return _diagonal(null_space_blocks(directors))

    # -- protocol of structural items ------------------------------------------------------------

    def counterpart(self, place: Place) -> Place:
        """Node of this mesh for a place: by arc length on the other mesh, or by position."""
        other = place.item
        if not isinstance(other, Beam):
            a = self.basis.node(place.position)
        else:
            e, k = (int(x[0]) for x in np.nonzero(other.basis.connectivity == place.vertex))
            elements, xi = places_in(self.mesh, other.mesh, other.basis.interpolation.nodes)
            near = abs(self.basis.interpolation.nodes - xi[e, k])
            if near.min() > 1e-9:
                raise InputError(
                    self.label,
                    f"has no node at {other.basis.nodes[place.vertex].tolist()}, where something"
                    " is attached: keep it when the mesh is divided, or name it",
                )
            a = int(self.basis.connectivity[elements[e, k], near.argmin()])
        triad = self.triads[a].copy()
        X = triad @ (place.position - self.basis.nodes[a])
        X[abs(X) < 1e-12 * self.mesh.size] = 0.0
        return Place(self, a, place.position, X, triad, None, place.note)

    def vertices(self) -> Vertices:
        """Its nodes."""
        return Vertices(self.basis.nodes, self.triads, self.velocity, self.angular_velocity)

    def scalar_mass(self) -> Floats:
        """Element mass without the factor I_3: (ne, 4 nn, 4 nn), rows (phi, d1, d2, d3) a node."""
        kind = self.basis.interpolation
        measure = self.basis.elemental_load()
        points = kind.nodes
        values = np.eye(len(kind.nodes))
        if not self.lumped:
            points = kind.full.points
            values = kind.full.values
            measure = self.basis.lengths[:, None] * kind.full.weights
        ne, nn = self.basis.connectivity.shape
        kinds, number = distinct(self.sections_at(np.arange(ne), points))
        density = np.array([each.density for each in kinds])[number]
        weighted = np.einsum("eg,ag,bg,egkl->eabkl", measure, values, values, density)
        # (phi, d1, d2) of the section by those of the node: d_k = Lambda_kj d_j
        own = np.zeros((ne, nn, 3, 4))
        own[:, :, 0, 0] = 1
        own[:, :, 1:, 1:] = self.rotations[:, :, :2]
        out = np.einsum("eaki,eabkl,eblj->eaibj", own, weighted, own, optimize=True)
        out = out.reshape(ne, 4 * nn, 4 * nn)
        return 0.5 * (out + out.transpose(0, 2, 1))

    def part(self, name: str | None = None) -> IndexArray:
        """Elements of a named part of the mesh, or all."""
        if name is None:
            return np.arange(self.mesh.t.shape[1], dtype=np.int64)
        return self.mesh.elements_of(name)

    def along(self, s: ArrayLike, part: str | None = None) -> tuple[IndexArray, Floats]:
        """Elements and reference coordinates at arc lengths, for :func:`diagnostics.evaluate`.

        Parameters
        ----------
        s : float or (m,) array
            Arc lengths in the reference from the start of the part (m).
        part : str, optional
            Name of a part of the mesh that does not branch; default: the whole beam.

        Returns
        -------
        elements : (m,) int array
            Where two elements meet: the one that starts there.
        xi : (m,) array
            Places in them, in [0, 1].

        Raises
        ------
        MeshError
            If the part is unknown, branches or has gaps, or `s` is beyond its ends.

        Examples
        --------
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="rod"), section)
        >>> elements, xi = beam.along([0.0, 0.75, 2.0], "rod")
        >>> elements.tolist(), xi.tolist()
        ([0, 1, 3], [0.0, 0.5, 1.0])
        """
        return places_along(self.mesh, s, part)

    def node(self, which: str | int | VectorLike, offset: VectorLike = (0.0, 0.0, 0.0)) -> Place:
        """The place of a node, for joints, loads and what is attached, or a point rigid with it.

        Parameters
        ----------
        which : str, int or (3,) array
            Name (``"NAME.start"``, ``"NAME.end"`` or one given in the mesh), number among the
            nodes of the elements, or reference position (m).
        offset : (3,) array
            Material coordinates ``X_i`` of the point in the node's triad (m): an eccentric end.

        Returns
        -------
        Place
            Its triad is that of the node in the reference.

        Raises
        ------
        MeshError
            If there is no such node; the message lists the names known.
        InputError
            If the offset is not three finite numbers.

        Examples
        --------
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="rod"), section)
        >>> beam.node("rod.end").position.tolist()
        [0.0, 2.0, 0.0]
        >>> beam.node((0, 1, 0)).vertex
        2
        >>> beam.node("rod.end", offset=(0, 0, 0.1)).position.tolist()   # 0.1 m further along d3
        [0.0, 2.1, 0.0]
        """
        a = self.basis.node(which)
        note = f" node {which!r}" if isinstance(which, str) else f" node {a}"
        X = vector(self.label, "offset", offset)
        triad = self.triads[a].copy()
        return Place(self, a, self.basis.nodes[a] + X @ triad, X, triad, None, note)


def _diagonal(blocks: Floats) -> bsr_matrix:
    """Matrix with blocks (n, k, m) on its diagonal."""
    n, k, m = blocks.shape
    return bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(n * k, n * m))
