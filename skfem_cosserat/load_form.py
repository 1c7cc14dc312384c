"""Forms of scikit-fem that act in runs: loads and potentials along beams."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from .errors import InputError
from .force import Force
from .frames import check_beam
from .frozen import Replacements
from .relative import Expression
from .types import Array, Floats

if TYPE_CHECKING:
    from .beam import Beam

#: names of the four vectors at a point of a beam, as forms see them
_FIELDS = "phi", "d1", "d2", "d3"


class _OnBasis(Force):
    """A force at the points of full integration of a beam: line and directors at each."""

    together = 4
    #: arguments beside the beam and the form
    _more: tuple[Any, ...] = ()

    def __init__(self, beam: Beam, form: Any, **law: Any) -> None:
        check_beam(self.label, beam)
        self.beam = beam
        #: the function behind a decorator of scikit-fem
        self.form: Callable[..., Any] = getattr(form, "form", form)
        if not callable(self.form):
            raise InputError(self.label, f"form = {form!r}, expected a form or a function")
        basis = beam.basis
        rule = basis.interpolation.full
        nodes = [beam.node(k) for k in range(basis.n_nodes)]
        vectors = [
            Expression(tuple((nodes[a], i, float(N)) for a, N in zip(own, values, strict=True)))
            for own in basis.connectivity.tolist()
            for values in rule.values.T
            for i in range(4)
        ]
        self._count = len(rule.points)
        self._weights: Floats = basis.lengths[:, None] * rule.weights
        arcs = basis.arc_lengths
        self._s: Floats = arcs[:, :1] + (arcs[:, -1:] - arcs[:, :1]) * rule.points
        origins = np.array([node.origin for node in nodes])[basis.connectivity]
        # of the interpolated line, as phi is
        self._x: Floats = np.einsum("eai,aq->ieq", origins, rule.values)
        super().__init__(vectors, each=True, **law)

    def with_replacements(self, replacements: Replacements) -> Self:
        """The same form on the beam that replaces its own."""
        return type(self)(replacements.of(self.beam), self.form, *self._more)

    @property
    def shown(self) -> range:
        """Numbers of the vectors that are points of the line."""
        return range(0, len(self.points), self.together)

    def where(self, piece: int) -> str:
        """The element of a point."""
        return f" in element {piece // self._count}"

    def _fields(self, x: Array, v: Array | None, t: float | None) -> Any:
        """What a form sees, for x and v (n k, 4, 3): k values at each of the n points."""
        from skfem.assembly.form.form import FormExtraParams

        times = len(x) // self._weights.size
        given = {
            "s": np.tile(self._s, (times, 1)),
            "x": np.tile(self._x, (1, times, 1)),
            **dict(zip(_FIELDS, self._by_points(x), strict=True)),
        }
        if v is not None:
            given |= {"velocity": self._by_points(v)[0], "t": t}
        for array in given.values():
            if isinstance(array, np.ndarray):
                array.flags.writeable = False  # forms are called several times
        return FormExtraParams(given)

    def _by_points(self, x: Array) -> Array:
        """Vectors (n k, 4, 3) as forms take them: (4, 3, k elements, points)."""
        ne, nq = self._weights.shape
        return x.reshape(ne, nq, -1, 4, 3).transpose(3, 4, 2, 0, 1).reshape(4, 3, -1, nq)

    def _by_rows(self, found: Array) -> Array:
        """Values (..., k elements, points) with their weights, (n k, ...)."""
        ne, nq = self._weights.shape
        own = found.reshape(*found.shape[:-2], -1, ne, nq) * self._weights
        return np.moveaxis(own, (-2, -1, -3), (0, 1, 2)).reshape(-1, *found.shape[:-2])

    def _checked(self, found: Any, shape: tuple[int, ...]) -> Array:
        """Values of a form at all points."""
        try:
            return np.broadcast_to(np.asarray(found), shape)
        except ValueError as error:
            text = f"gives an array {np.shape(found)[-2:]}, expected {shape[-2:]} numbers"
            raise InputError(self.label, f"its form {text} (elements, points)") from error


class LoadForm(_OnBasis):
    """A linear form of scikit-fem that acts on a beam in runs and equilibria.

    It is integrated along the line with as many Gauss points as products of shape functions need.

    Parameters
    ----------
    beam : Beam
    form : skfem.LinearForm or callable
        ``form(v, w)`` on the beam's basis: v has twelve components, the virtual displacement of
        the line, ``v[0:3]``, and those of the directors of the nodes. ``w.phi, w.d1, w.d2, w.d3``
        and ``w.velocity`` (of the line, m/s) are (3, elements, points) now, ``w.x`` in the
        reference, ``w.s`` the arc length (m), ``w.t`` the time (s; on a path the load factor).
        Numbers may be complex, as for :class:`Force`.
    derivative : callable, optional
        ``derivative(u, v, w)``: the derivative of the form by ``(phi, d1, d2, d3)`` along u, which
        has twelve components as v. That by the velocity comes from complex steps.

    Raises
    ------
    InputError
        See :class:`Force`; if the form takes the gradient of v, or gives arrays of another shape.

    Examples
    --------
    A cable that hangs in the wind: the drag is in proportion to the square of its speed.

    >>> import numpy as np
    >>> import skfem_cosserat as sc
    >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    >>> section = sc.Section([1e4, 1e4, 1e4, 5, 5, 5], mass=1.0, inertia=(1.0, 1.0))
    >>> model = sc.Model()
    >>> rod = model.add("rod", sc.Beam(mesh, section, velocity=(0, 2.0, 0)))
    >>> def drag(v, w):
    ...     speed = np.sqrt((w.velocity**2).sum(0))
    ...     return -0.5 * speed * (w.velocity * v[:3]).sum(0)
    >>> load = model.add("drag", sc.LoadForm(rod, drag))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=1.0)
    >>> round(float(history.velocity(rod.node("rod.end"))[-1, 1]), 4)   # 2/(1 + 0.5 * 2 t)
    1.0
    """

    kind = "form"

    def __init__(self, beam: Beam, form: Any, derivative: Callable[..., Any] | None = None) -> None:
        self._given = derivative
        self._more = (derivative,)
        more = {} if derivative is None else {"derivative": self._slopes}
        super().__init__(beam, form, law=self._forces, **more)

    #: whether that was looked at
    _linear = False

    def _tested(self, form: Callable[[Any, Any], Any], w: Any) -> Array:
        """Coefficients (12, k elements, points) of the twelve components of v in a form."""
        found = {}
        seen = None
        for k, unit in enumerate(np.eye(12)):
            if seen is None or k in seen:
                v = _Test(unit)
                found[k] = self._checked(form(v, w), w.s.shape)
                seen = seen or v.seen
        if not self._linear:
            twice = self._checked(form(_Test(np.full(12, 2.0)), w), w.s.shape)
            off = abs(twice - 2 * sum(found.values()))
            if (off > 1e-9 * abs(twice)).any():
                raise InputError(self.label, "its form is not linear in v")
            self._linear = True
        out = np.zeros((12, *w.s.shape), dtype=np.result_type(*found.values()))
        for k, values in found.items():
            out[k] = values
        return out

    def _forces(self, x: Array, v: Array, t: float) -> Array:
        return self._by_rows(self._tested(self.form, self._fields(x, v, t))).reshape(-1, 4, 3)

    def _slopes(self, x: Array, v: Array, t: float) -> tuple[Array, Array]:
        assert self._given is not None
        w, given, out = self._fields(x, v, t), self._given, np.zeros((2, len(x), 4, 3, 4, 3))
        for j in range(12):
            u = np.zeros((12, 1, 1))
            u[j] = 1.0
            column = self._tested(lambda test, w: given(u, test, w), w)  # noqa: B023
            out[0, ..., j // 3, j % 3] = self._by_rows(column).reshape(-1, 4, 3)
        for i in range(3):
            faster = v + 1e-20j * np.eye(12)[i].reshape(4, 3)
            out[1, ..., 0, i] = self._forces(x, faster, t).imag / 1e-20
        return out[0], out[1]


class _Test:
    """A unit vector in place of test functions; knows which of its components are asked for."""

    def __init__(self, unit: Floats) -> None:
        self._unit = unit.reshape(12, 1, 1)
        self.seen = set[int]()

    def __getitem__(self, key: Any) -> Array:
        self.seen.update(np.atleast_1d(np.arange(12)[key]).tolist())
        return self._unit[key]

    def __array__(self, *args: Any, **kwargs: Any) -> Array:
        self.seen.update(range(12))
        return np.array(self._unit, *args, **kwargs)

    @property
    def grad(self) -> Any:
        """Refused: forces act by the fields, not by their slopes."""
        raise InputError("form", "takes the gradient of v, expected its components alone")


class EnergyForm(_OnBasis):
    """A potential along a beam, given as a functional of scikit-fem.

    With :class:`EnergyMomentum` its work in a step is its change of energy, exactly.

    Parameters
    ----------
    beam : Beam
    functional : skfem.Functional or callable
        ``functional(w)``: energy per length (J/m) at all points, (elements, points); w is that of
        :class:`LoadForm`, without velocity and time.

    Raises
    ------
    InputError
        See :class:`LoadForm`.

    Examples
    --------
    A bed of springs, 100 N/m for each metre:

    >>> import skfem_cosserat as sc
    >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    >>> section = sc.Section([1e4, 1e4, 1e4, 5, 5, 5], mass=1.0, inertia=(1.0, 1.0))
    >>> model = sc.Model()
    >>> rod = model.add("rod", sc.Beam(mesh, section, velocity=(0, 2.0, 0)))
    >>> bed = model.add("bed", sc.EnergyForm(rod, lambda w: 50.0 * (w.phi - w.x)[1] ** 2))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=0.5)
    >>> bool(abs(history["energy"] - 2.0).max() < 1e-10)
    True
    """

    kind = "energy form"

    def __init__(self, beam: Beam, functional: Any) -> None:
        super().__init__(beam, functional, energy=self._energies)

    def _energies(self, x: Array) -> Array:
        w = self._fields(x, None, None)
        return self._by_rows(self._checked(self.form(w), w.s.shape))
