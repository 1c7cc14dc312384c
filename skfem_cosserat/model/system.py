"""A frozen scene: numbering, constant mass matrix, patterns, constraint graph. No time, no solver.

Coordinates: ``q`` (n,) is ``y[:rows]`` flattened, where ``y`` (rows + ground, 3) holds phi, d1, d2,
d3 of each frame and phi of each mass point in the order of adding, then the ground's frames (one
at rest, one for each place in prescribed motion). Joints thus always connect two frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, issparse

from ..arguments import checked
from ..coupling import Coupling
from ..damping import RayleighDamping
from ..errors import InputError
from ..frames import Item, Place, is_beam
from ..frozen import Replacements, lock_arrays
from ..joint import Joint, JointDrive
from ..kernels import cross
from ..load import Load
from ..notebook import Shown
from ..pattern import product_form, sum_at
from ..relative import Expression, Form, Product, Zero
from ..types import (
    Array,
    ArrayLike,
    FilePath,
    Floats,
    IndexArray,
    check_kind,
    names_known,
    numbers,
    real,
)
from ..warn import Notice, Notices
from .checks import (
    JointRows,
    check_drives,
    check_mobility,
)
from .closure import Closure
from .force_elements import Couplings
from .ground import Ground, Placed
from .groups import BeamGroup, Group, Structure, assemble_mass, damping_factors, nodal_group
from .kinematics import Kinematics
from .loading import Loading
from .loops import (
    almost_redundant,
    close_loops,
    null_space_matrix,
)
from .parts import connected_parts
from .plane import Plane, guard_of
from .quadratic import ConstraintBuilder, QuadraticConstraints
from .theories import Spanning, TheoryRows, add_theory_rows, rigid_elements
from .tree import Edge, End, Spot, Tree, build_tree

if TYPE_CHECKING:
    from ..beam import Beam

#: labels in one line
SHOWN = 6
FROM = ", as from beam.node(name), body.at(x), point.place() or ground(x)"


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Coordinates of a scene in space, as kernels have them.

    Attributes
    ----------
    system : System
    tree : Tree
        Of the joints whose rows its coordinates fulfil.
    kinematics : Kinematics
    left_rows : int array
        Constraint rows that they do not fulfil by themselves.
    joint_edges : sequence of Edge
        Of the tree that goes along all joints.
    closure : Closure
        Rows of closed loops, in the coordinates of that tree.
    """

    system: System
    tree: Tree
    kinematics: Kinematics
    left_rows: IndexArray
    joint_edges: Sequence[Edge]
    closure: Closure


class Pictured(Shown):
    """A scene that can be looked at before it runs."""

    def plot(
        self,
        path: FilePath | None = None,
        *,
        names: bool = False,
        camera: str | Sequence[Sequence[float]] = "iso",
        window: tuple[int, int] = (1600, 900),
    ) -> Any:
        """Picture of the scene in its reference, before a run.

        Beams with their sections and section directors d1 and d2, bodies, joints by what they
        leave free, the ground, springs and cables as lines. Forces and moments are arrows, as they
        are at the start; those that are zero then are shown for a factor of one.

        Parameters
        ----------
        path : path-like, optional
            Image file (``.png``). Default: shown in the notebook, or in a window.
        names, camera, window
            As for :meth:`History.picture`.

        Returns
        -------
        Path
            The image file; without one what a notebook shows.

        Raises
        ------
        InputError, ImportError, CosseratError
            As :meth:`History.picture`.

        Examples
        --------
        >>> model.plot("scene.png", names=True)  # doctest: +SKIP
        """
        from ..picture import Look, picture_of_scene

        return picture_of_scene(self, path, Look(camera, names=names, window=window))


@checked
class System(Pictured):
    """Arrays of a frozen scene; made by :meth:`Model.freeze`.

    A frame is ``(phi, d1, d2, d3)``, 12 coordinates (55); a mass point has 3.

    Attributes
    ----------
    n, m : int
        Coordinates and constraint rows (internal ones (56), 6 a frame, first; then joints in the
        order of adding, then strains that beams hold).
    rank : int
        Independent constraint rows.
    redundant : (m - rank,) int array
        Constraint rows that depend on the others; by joints: :meth:`redundancies`.
    unknowns : int
        ``n - rank``: motions that are free, the unknowns of the null space method. Strains that a
        beam holds off closed loops add two for each row: they have multipliers.
    q0, v0 : (n,) array
        Reference configuration (m, -) and initial velocity (m/s, 1/s).
    mass, inertia : (n/3, n/3) sparse matrix; the same in full if it is small, for products
        Constant mass matrix (64), (114) without the factor I_3 (kg, kg m, kg m^2).
    drag : (n/3, n/3) sparse matrix or None
        Drag against space per velocity, likewise (kg/s, ...), of Rayleigh damping.
    damped : bool
        Whether there is a drag, or a viscous section: see ``beam_groups[k].damping(B)``.
    constraints : QuadraticConstraints
        ``g(y)`` and its Jacobian ``G(y)``, y from :meth:`extend`.
    length : float
        Extent of the scene (m).
    plane : Plane or None
        To which all is confined.
    warnings : list of dict
        What was doubtful when it was made, as in the ``meta["warnings"]`` of its runs.

    Examples
    --------
    >>> from skfem_cosserat import JointRevolute, Model, RigidBody, ground
    >>> model = Model()
    >>> link = model.add("link", RigidBody.box(2.0, (0.1, 0.1, 1.0)))
    >>> hinge = JointRevolute(ground((0, 0, 0.5)), link.local((0, 0, 0.5)), axis=(1, 0, 0))
    >>> hinge = model.add("hinge", hinge)
    >>> model.freeze()   # doctest: +NORMALIZE_WHITESPACE
    <System of rigid body 'link'; n = 12, m = 11 (rank 11),
     unknowns 23 with multipliers, 1 with the null space>
    """

    def __init__(
        self,
        structures: Sequence[Structure],
        joints: Sequence[Joint],
        loads: Sequence[Load],
        drives: Sequence[JointDrive] = (),
        couplings: Sequence[Coupling] = (),
        dampings: Sequence[RayleighDamping] = (),
        placed: Placed | None = None,
        scene: dict[str, Item] | None = None,
        copies: Replacements | None = None,
    ):
        #: what was doubtful when it was made, as ``history.meta["warnings"]`` of its runs repeats
        self.warnings: list[Notice] = []
        self.scene = scene
        #: of joints' coordinates, made when they are asked for
        self.readings: dict[tuple[int, str | None], Any] = {}
        #: finds what stands for places of the model that this scene was rebuilt from
        self.copies = copies
        self.placed = placed
        self.since = 0.0 if placed is None else placed.t
        self.structures, self.joints, self.loads = list(structures), list(joints), list(loads)
        self.drives = list(drives)
        self.dampings = list(dampings)
        self._number()
        self._place_ground(couplings)
        self._group(dampings)
        places = self.first, self.rows, self.mass, self.origin_rows
        self.loading = Loading(self.loads, *places, self.beam_groups, self.frame_group)
        check_drives(self.drives)
        self._constrain()
        start = self.extend(self._y0, 0.0)
        self.couplings = Couplings(couplings, self.row_of, start, self.rows, self.length)
        self.couplings.check(start)
        self.plane: Plane | None = None
        self._build_tree()
        self._lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled are the items: arrays, numbers by identity and caches are made anew."""
        items = (
            self.structures,
            self.joints,
            self.loads,
            self.drives,
            self.couplings.all,
        )
        return _made, ((*items, self.dampings, self.placed, self.scene), self.plane, self.warnings)

    @cached_property
    def vertex_coordinates(self) -> Coordinates:
        """Coordinates in space with no joint in the tree: all vertices free, all rows left."""
        tree = build_tree(self.is_frame.tolist(), [])
        kinematics = Kinematics(tree, self.vertex_rows, self.is_frame, self.total)
        rows = np.arange(self.internal, self.m)
        tied = self.joint_coordinates
        return Coordinates(self, tree, kinematics, rows, tied.joint_edges, tied.closure)

    def _lock(self) -> None:
        """Make arrays read-only: a change would not reach all that share them."""
        matrices = [each for each in (self.mass, self.inertia, self.drag) if issparse(each)]
        for arrays in (self, *matrices):
            lock_arrays(arrays)

    # -- construction ------------------------------------------------------------------------------

    def _number(self) -> None:
        self.first: dict[int, tuple[int, int]] = {}
        framed = []
        y = []
        rates = []
        self.owner: list[Structure] = []
        row = 0
        for item in self.structures:
            vertices = item.vertices()
            if vertices is None:
                continue
            count = len(vertices)
            self.first[id(item)] = (len(self.owner), row)
            self.owner += [item] * count
            framed.append(np.full(count, vertices.triads is not None))
            if vertices.triads is None:
                y.append(vertices.positions)
                rates.append(vertices.velocities)
                row += count
                continue
            turning = np.cross(vertices.angular_velocities[:, None], vertices.triads)
            for rows, origins, directors in (
                (y, vertices.positions, vertices.triads),
                (rates, vertices.velocities, turning),
            ):
                rows.append(np.concatenate([origins[:, None], directors], 1).reshape(-1, 3))
            row += 4 * count
        self.rows = row
        self.n = 3 * row
        self.is_frame = np.concatenate(framed)
        size = np.where(self.is_frame, 4, 1)
        self.origin_rows: IndexArray = size.cumsum() - size
        self._y0 = np.concatenate(y)
        self._v0 = np.concatenate(rates)

    def _place_ground(self, couplings: Sequence[Coupling]) -> None:
        places = [place for joint in self.joints for place in (joint.a, joint.b)]
        places += [place for item in couplings for place in item.sides()]
        self._sides = [place.position for place in places]
        places += [drive.place for drive in self.drives]
        places += [place for load in self.loads for place in load.places()]
        places += [place for item in couplings if item.own_law for place in item.places()]
        self.grounds = Ground(places) if self.placed is None else self.placed.ground
        self.moving = self.grounds.moving
        self.total = self.rows + self.grounds.rows
        self.vertex_rows = np.r_[self.origin_rows, np.arange(self.rows, self.total, 4)]
        self.spanned = self.extend(self.q0 if self.placed is None else self.placed.q, self.since)

    def spot(self, place: Place) -> Spot:
        """Number of a place's vertex, with its material coordinates."""
        offset = tuple(place.offset.tolist())
        if place.item is not None:
            if id(place.item) not in self.first and self.copies is not None:
                place = self.copies.of(place)
                offset = tuple(place.offset.tolist())
            if id(place.item) not in self.first:
                known = listed([i.label for i in self.structures])
                raise InputError("place", f"{place.label} is not in this system, which has {known}")
            return Spot(self.first[id(place.item)][0] + place.vertex, offset)
        return Spot(len(self.origin_rows) + self.grounds.number(place), offset)

    def row_of(self, place: Place) -> int:
        """First row of y of a place's vertex."""
        return int(self.vertex_rows[self.spot(place).vertex])

    def _group(self, dampings: Sequence[RayleighDamping]) -> None:
        alpha, beta = damping_factors(self.structures, dampings)
        masses = {id(item): item.scalar_mass() for item in self.structures}
        drags = {item: factor * masses[item] for item, factor in alpha.items() if item in masses}
        where = self.first, self.rows
        self.mass, self.nodal_masses = assemble_mass(self.structures, masses, *where)
        self.inertia = product_form(self.mass)
        drag, nodal_drags = assemble_mass(self.structures, drags, *where) if alpha else (None, [])
        self.drag: csr_matrix | None = drag
        kinds: dict[object, list[tuple[Beam, int, int]]] = {}
        self.beams = [item for item in self.structures if is_beam(item)]
        for b in sorted(self.beams, key=lambda b: b.basis.order):
            kinds.setdefault(b.basis.interpolation, []).append((b, *self.first[id(b)]))
        self.beam_groups = [BeamGroup(group, masses, drags, beta) for group in kinds.values()]
        self.damped = bool(alpha) or any(g.viscous for g in self.beam_groups)
        single = {v for v, _, framed in self.nodal_masses if framed}
        frames = [term.frame for load in self.loads for term in load.made_of]
        single |= {self.spot(place).vertex for place in frames if place is not None}
        points = {v for v, _, framed in self.nodal_masses if not framed}
        self.frame_group, self.point_group = (
            nodal_group(sorted(each), size, self.origin_rows, self.nodal_masses, nodal_drags)
            for each, size in ((single, 4), (points, 1))
        )
        lumped = [each for each in (self.frame_group, self.point_group) if each]
        self.groups: list[Group] = [*self.beam_groups, *lumped]

    def _constrain(self) -> None:
        build = ConstraintBuilder(self.origin_rows[self.is_frame])
        self.internal = build.size
        self.joint_rows: list[JointRows] = []
        items: list[Joint | JointDrive] = [*self.joints, *self.drives]
        for item in items:
            item.check(0.0, self.length)
            start = build.size
            for row in item.rows():
                self._add_row(build, row)
            ends = self.spot(item.a), self.spot(item.b)
            self.joint_rows.append(JointRows(item, slice(start, build.size), *ends))
        self.theory_rows: list[TheoryRows] = add_theory_rows(build, self.structures, self.first)
        self.constraints = QuadraticConstraints(build, self.spanned, self.rows)
        self.m = build.size
        cosines = ConstraintBuilder()
        self.of_cosine: list[Joint | JointDrive] = []
        for jr in self.joint_rows:
            for cosine in jr.joint.branch_cosines():
                self._add_row(cosines, cosine)
                self.of_cosine.append(jr.joint)
        self.branch_cosines = QuadraticConstraints(cosines, self.spanned, self.rows)

    def terms(self, expression: Expression) -> list[tuple[int, float]]:
        """Rows of y and factors whose sum is the expression."""
        return [(int(self.vertex_rows[self.spot(p).vertex]) + k, c) for p, k, c in expression.terms]

    def _add_row(self, build: ConstraintBuilder, row: Zero | Product | Form) -> None:
        if isinstance(row, Zero):
            build.zero(self.terms(row.expression))
            return
        for p in (row,) if isinstance(row, Product) else row:
            amplitude = None
            if p.amplitude is not None:
                amplitude = (self.row_of(p.amplitude.place), p.amplitude.component)
            build.add(self.terms(p.left), self.terms(p.right), p.factor, amplitude)
        build.end_row()

    def _build_tree(self) -> None:
        driven: dict[int, dict[str, int]] = {}
        for drive in self.drives:
            frame = self.spot(drive.place).vertex
            driven.setdefault(id(drive.joint), {})[drive.coordinate.name] = frame
        ends = [
            End(joint, self.spot(joint.a), self.spot(joint.b), driven.get(id(joint), {}))
            for joint in self.joints
        ]
        elements = rigid_elements(self.theory_rows)
        self.tree = build_tree(self.is_frame.tolist(), ends, elements, self.plane)
        self.kinematics = Kinematics(self.tree, self.vertex_rows, self.is_frame, self.total)
        #: what cannot leave the reference rightly, and why: of beams that hold too many strains
        self.immovable: tuple[str, str] | None = None
        self.closure: Closure
        self.spanning: Spanning
        self.held_rows: IndexArray
        self.redundant: IndexArray
        close_loops(self)
        #: constraint rows that the tree's coordinates do not fulfil by themselves
        self.left_rows: IndexArray = np.union1d(self.closure.rows, self.held_rows)
        self.unknowns = self.kinematics.unknowns - (self.closure.rank + len(self.held_rows))
        self.rank = self.coordinates - self.unknowns
        check_mobility(self, almost_redundant(self))
        if self.plane is None:
            #: coordinates in space with all joints in the tree
            self.joint_coordinates = Coordinates(
                self, self.tree, self.kinematics, self.left_rows, self.tree.edges, self.closure
            )

    def confine(self, plane: Plane) -> None:
        """Take away what leads out of a plane that nothing leaves; see :class:`Planar`."""
        self.plane = plane
        self.loading = copy(self.loading)
        self.loading.guard = guard_of(self.loading, plane)
        self.grounds = self.grounds.confined(plane, [drive.place for drive in self.drives])
        self._build_tree()
        self._lock()

    @property
    def coordinates(self) -> int:
        """Coordinates that change: n, or those along the plane that all is confined to."""
        plane = self.plane
        return self.n if plane is None else 2 * len(plane.moving(self._y0, self.origin_rows))

    # -- use -------------------------------------------------------------------------------------

    @property
    def q0(self) -> Floats:
        """Reference configuration (n,), not to be written to: take ``q0.copy()`` for that."""
        return self._y0.ravel()

    @property
    def v0(self) -> Floats:
        """Initial velocity (n,) given with the items, not to be written to."""
        return self._v0.ravel()

    def counts(self) -> dict[str, int]:
        """Coordinates n, constraint rows m, their rank, unknowns of the null space method.

        Examples
        --------
        >>> from skfem_cosserat import Model, RigidBody
        >>> model = Model()
        >>> body = model.add("body", RigidBody.sphere(1.0, 1.0))
        >>> model.freeze().counts()
        {'n': 12, 'm': 6, 'rank': 6, 'unknowns': 6}
        """
        return {"n": self.n, "m": self.m, "rank": self.rank, "unknowns": self.unknowns}

    def summary(self) -> dict[str, Any]:
        """Its items, motions that are free, and mass."""
        items = [item.label for item in (*self.structures, *self.joints, *self.couplings.items)]
        mass = float(self.mass[self.origin_rows][:, self.origin_rows].sum())
        about = {"items": ", ".join(items), "parts": str(connected_parts(self))}
        return about | {"degrees of freedom": self.unknowns, "mass in kg": mass}

    def __repr__(self) -> str:
        names = listed([i.label for i in self.structures])
        c = self.counts()
        return (
            f"<System of {names}; n = {c['n']}, m = {c['m']} (rank {c['rank']}),"
            f" unknowns {self.coordinates + c['rank']} with multipliers,"
            f" {c['unknowns'] + 2 * len(self.held_rows)} with the null space>"
        )

    def __str__(self) -> str:
        count = len(self.joints)
        joints = f"{count or 'no'} joint{'s' * (count != 1)}"
        return f"{self!r}\n{connected_parts(self)}; {joints}"

    def redundancies(self) -> dict[str, list[int]]:
        """Redundant constraint rows: numbers within each joint or drive that has some.

        Which of the rows around a closed loop count as redundant is a choice; how many is not.

        Examples
        --------
        A door on two hinges: the second one could go without.

        >>> from skfem_cosserat import JointRevolute, Model, RigidBody, ground
        >>> model = Model()
        >>> door = model.add("door", RigidBody.box(20.0, (0.8, 0.04, 2.0), position=(0.4, 0, 1)))
        >>> for name, x in (("low", (0, 0, 0.3)), ("high", (0, 0, 1.7))):
        ...     hinge = model.add(name, JointRevolute(ground(x), door.at(x), axis=(0, 0, 1)))
        >>> model.freeze().redundancies()
        {'high': [0, 1, 2, 3, 4]}
        """
        out = {}
        for jr in self.joint_rows:
            inside = np.intersect1d(self.redundant, np.arange(jr.rows.start, jr.rows.stop))
            if len(inside):
                out[jr.joint.name or ""] = (inside - jr.rows.start).tolist()
        return out

    def independent_rows(self, y: Floats) -> NDArray[np.bool_]:
        """Mask (m,) of the constraint rows to keep at a configuration: others depend on them.

        In a singular position they are fewer than elsewhere.

        Parameters
        ----------
        y : (total, 3) array
            All rows, from :meth:`extend`.

        Examples
        --------
        >>> from skfem_cosserat import Model, RigidBody
        >>> model = Model()
        >>> body = model.add("body", RigidBody.sphere(1.0, 1.0))
        >>> system = model.freeze()
        >>> system.independent_rows(system.extend(system.q0, 0.0)).tolist()
        [True, True, True, True, True, True]
        """
        keep = np.ones(self.m, bool)
        closure = self.joint_coordinates.closure
        if len(closure.rows):
            keep[closure.rows] = False
            for s in closure.select(y, closure.kin.values_at(y)):
                keep[s.independent] = True
        return keep

    def wrong_branch(self, y: Floats) -> str | None:
        """Message about an item on a wrong branch of its constraints at y; None: there is none.

        The item is reflected, or off by half or a third of a turn. Quadratic rows cannot tell this;
        Newton's method may run into it in large steps.
        """
        cosines = 1 + self.branch_cosines.values(y)
        if len(cosines) and cosines.min() < 0.5:  # -1 half a turn off, 0 a third
            turned = "half" if cosines.min() < -0.5 else "a third of"
            return f"{self.of_cosine[cosines.argmin()].label} by {turned} a turn"
        D = self.kinematics.directors(y)
        wrong = np.flatnonzero((cross(D[:, 0], D[:, 1]) * D[:, 2]).sum(1) < 0)
        if len(wrong):
            return f"triad of {self.owner[self.kinematics.frames[wrong[0]]].label}"
        return None

    def null_space(self, q: ArrayLike, t: float = 0.0) -> Floats:
        """Null space matrix ``P(q)`` (n, unknowns) with ``G P = 0``, dense.

        Parameters
        ----------
        q : (n,) array
            Configuration that fulfils the constraints.
        t : float
            Time (s), for prescribed motion.

        Raises
        ------
        InputError
            If q is not of this shape or not finite, or the time is no number.

        Notes
        -----
        ``P = P_int T Z``: (68), (69), the joints of the tree, and an orthonormal basis of what the
        loops leave free. For diagnostics: the solvers never form it.

        Examples
        --------
        >>> from skfem_cosserat import Model, RigidBody
        >>> model = Model()
        >>> body = model.add("body", RigidBody.sphere(1.0, 1.0))
        >>> system = model.freeze()
        >>> system.null_space(system.q0).shape
        (12, 6)
        """
        array = numbers("argument q", "q", q)
        if array.shape != (self.n,) or not np.isfinite(array).all():
            raise InputError(
                "argument q",
                f"has shape {array.shape}, finite = {bool(np.isfinite(array).all())}, expected"
                f" {self.n} finite numbers",
            )
        time = real("argument t", "t", t, "a time (s)")
        return null_space_matrix(self, self.extend(array, time)).toarray()

    def ground(self, t: float) -> Floats:
        """Rows of the ground's frames at time `t`, (total - rows, 3)."""
        return self.grounds.at(t)

    def ground_rate(self, t: float) -> Floats:
        """Time derivative of :meth:`ground`."""
        return self.grounds.rate_and_error(t)[0]

    def ground_rate_and_error(self, t: float) -> tuple[Floats, float]:
        """Time derivative of :meth:`ground` by differences of the callables, and its error."""
        return self.grounds.rate_and_error(t)

    def extend(self, q: Array, t: float) -> Array:
        """All rows ``y`` (total, 3): coordinates q (n,) and the ground at time t (s).

        Examples
        --------
        >>> from skfem_cosserat import MassPoint, Model
        >>> model = Model()
        >>> ball = model.add("ball", MassPoint(1.0, position=(1, 2, 3)))
        >>> system = model.freeze()
        >>> system.extend(system.q0, 0.0)[0].tolist()
        [1.0, 2.0, 3.0]
        """
        if q.size != self.n:
            raise InputError("argument q", f"has shape {q.shape}, expected ({self.n},)")
        y = np.empty((self.total, 3), q.dtype)
        y[: self.rows] = q.reshape(-1, 3)
        y[self.rows :] = self.grounds.at(t)
        return y

    def frame_place(self, name: str) -> int:
        """First number in q of the item `name` (of its first node if it is a beam).

        Raises
        ------
        InputError
            If no item of this name has coordinates; the message lists those that have.

        Examples
        --------
        >>> from skfem_cosserat import MassPoint, Model, RigidBody
        >>> model = Model()
        >>> body = model.add("body", RigidBody.sphere(1.0, 1.0))
        >>> ball = model.add("ball", MassPoint(1.0, position=(1, 2, 3)))
        >>> model.freeze().frame_place("ball")
        12
        """
        for item in self.structures:
            if item.name == name and id(item) in self.first:
                return 3 * self.first[id(item)][1]
        known = [i.name for i in self.structures if id(i) in self.first]
        raise InputError("system", f"unknown name {name!r}; {names_known(name, known)}")

    def offset(self, place: Place) -> int:
        """First number in q of the frame or point that carries a place."""
        return int(self.dofs(place)[0])

    def split(self, q: ArrayLike) -> dict[str, Floats]:
        """Coordinates, velocities or forces of the beams, in the order of their bases.

        Parameters
        ----------
        q : (..., n) array

        Returns
        -------
        dict of str to (..., basis.N) array
            By the names of the beams.

        Raises
        ------
        InputError
            If it is not as long as the coordinates of the system.

        Examples
        --------
        >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
        >>> section = Section([1e4, 1e4, 1e4, 5, 5, 5], mass=1.0, inertia=(1.0, 1.0))
        >>> model = Model()
        >>> rod = model.add("rod", Beam(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2), section))
        >>> system = model.freeze()
        >>> bool((system.split(system.q0)["rod"] == rod.reference).all())
        True
        """
        given = numbers("argument q", "q", q)
        if given.shape[-1:] != (self.n,):
            raise InputError("argument q", f"has shape {given.shape}, expected (..., {self.n})")
        starts = ((beam, 3 * self.first[id(beam)][1]) for beam in self.beams)
        return {str(b.name): given[..., start : start + b.basis.N] for b, start in starts}

    def dofs(self, place: Place) -> IndexArray:
        """Numbers in q of the frame or point that carries a place.

        Where the place is, is another thing if it is off the origin of its frame: see
        :meth:`skfem_cosserat.History.position`.

        Parameters
        ----------
        place : Place
            As from ``beam.node(name)``, ``body.at(x)`` or ``point.place()``.

        Returns
        -------
        (12,) or (3,) int array
            Of phi, d1, d2, d3 of a frame; of a mass point.

        Raises
        ------
        InputError
            For places of the ground, which has no coordinates, and of items that are not in this
            system.

        Examples
        --------
        >>> from skfem_cosserat import MassPoint, Model, RigidBody
        >>> model = Model()
        >>> body = model.add("body", RigidBody.sphere(1.0, 1.0))
        >>> ball = model.add("ball", MassPoint(1.0, position=(1, 2, 3)))
        >>> system = model.freeze()
        >>> system.dofs(ball.place()).tolist(), len(system.dofs(body.at((0, 0, 1))))
        ([12, 13, 14], 12)
        """
        check_kind("argument place", place, Place, FROM)
        if place.item is None:
            raise InputError("argument place", f"the {place.label} has no coordinates in q")
        spot = self.spot(place)
        first = 3 * int(self.vertex_rows[spot.vertex])
        return first + np.arange(12 if self.is_frame[spot.vertex] else 3, dtype=np.int64)

    @property
    def coupled_rows(self) -> IndexArray:
        """Pairs (k, 2) of rows of y that couplings connect by 3x3 blocks."""
        return self.couplings.pairs

    @property
    def dead_only(self) -> bool:
        """Whether no load, nor force by an own law, depends on the motion."""
        return self.loading.dead_only and not self.couplings.own

    def couplings_of(self, items: Sequence[Coupling]) -> Couplings:
        """Some of its force elements as arrays."""
        return Couplings(items, self.row_of, self.extend(self.q0, 0.0), self.rows, self.length)

    @cached_property
    def length(self) -> float:
        """Extent of the scene (m), the scale of displacements and gaps; 1 if it is a point."""
        x = np.vstack([self._y0[self.origin_rows], *self._sides])
        return float(np.linalg.norm(x.max(0) - x.min(0))) or 1.0

    # -- forces ------------------------------------------------------------------------------------

    def strain(self, y: Array) -> list[tuple[Array, Array]]:
        """(strains, B) of each beam group."""
        return [g.strain(y) for g in self.beam_groups]

    def internal_force(self, Bs: list[Array], stresses: list[Array]) -> Array:
        """``sum int B^T S ds`` as rows (rows, 3)."""
        if not self.beam_groups:
            return np.zeros((self.rows, 3))
        groups = self.beam_groups
        forces = [g.force(B, S).ravel() for g, B, S in zip(groups, Bs, stresses, strict=True)]
        every = np.concatenate(forces) if len(forces) > 1 else forces[0]
        return sum_at(self._force_dofs, every, self.n).reshape(-1, 3)

    @cached_property
    def _force_dofs(self) -> IndexArray:
        return np.concatenate([g.dofs.ravel() for g in self.beam_groups])

    def empty_tangent(self) -> list[Array]:
        """Zeros as blocks of the groups; fresh arrays, to be added to."""
        return [0.0 * g.mass for g in self.groups]


def listed(labels: Sequence[str]) -> str:
    """Labels in one line: the first ones, and how many more there are."""
    more = len(labels) - SHOWN
    return ", ".join(labels[:SHOWN]) + (f" and {more} more" if more > 0 else "") or "nothing"


def _made(items: Sequence[Any], plane: Plane | None, known: Sequence[Notice] = ()) -> System:
    with Notices(quiet=True, alone=True):  # said when it was made first
        system = System(*items)
        if plane is not None:
            system.confine(plane)
    system.warnings = [dict(notice) for notice in known]
    return system
