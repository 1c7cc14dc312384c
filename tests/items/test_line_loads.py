"""Loads and moments per length that vary along a beam: closed forms, resultants, bad input."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import forces_along

EI, GJ = 200.0, 150.0
SECTION = sc.Section.from_constants(
    EA=1e8, GA=1e8, EI=(EI, EI), GJ=GJ, mass=1.0, inertia=(1e-5, 1e-5)
)


def cantilever(order=3, elements=2):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, SECTION, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    return model, rod


def growing(follower):
    """A load that grows from the clamp to 0.006 N/m, and a torque, in three ways to give both."""
    if follower:
        return {"value": lambda s: (-6e-3 * s, 0, 0), "moment": (0, 0, 9e-3), "follower": True}
    return {"value": ([0, 1], [(0, 0, 0), (0, 0, -6e-3)]), "moment": lambda s: (9e-3, 0, 0)}


@pytest.mark.parametrize("follower", [False, True])
def test_tip_and_forces_of_a_cantilever(follower, kernels):
    """Tip q L^4 11/(120 EI), turned by m L^2/(2 GJ); resultants by the part beyond each place."""
    model, rod = cantilever()
    model.add("load", sc.LoadLine(rod, **growing(follower)))
    path = sc.static(model, kernels=kernels, watch=False)
    end = rod.node("rod.end")
    turn = path.rotation(end)[-1]
    assert path.position(end)[-1, 2] == pytest.approx(-6e-3 * 11 / (120 * EI), rel=2e-5)
    assert np.arctan2(-turn[0, 1], turn[0, 2]) == pytest.approx(9e-3 / (2 * GJ), rel=1e-9)
    s = np.array([0.0, 0.3, 0.8])
    found = forces_along(model, path, rod, s)[-1]
    assert found[:, 0] == pytest.approx(-6e-3 * (1 - s**2) / 2, rel=1e-6)
    assert found[:, 5] == pytest.approx(9e-3 * (1 - s), abs=2e-8)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 6])
def test_resultants_of_polynomials_up_to_the_order_are_exact(order):
    """What the clamp takes of a force, of a torque: the integral of s^p is 1/(p + 1)."""
    for load, kind, axis in (("value", "force", 1), ("moment", "moment", 0)):
        model, rod = cantilever(order, elements=1)
        direction = 1e-3 * np.eye(3)[axis]
        model.add("load", sc.LoadLine(rod, **{load: lambda s: s**order * direction}))  # noqa: B023
        found = sc.static(model, watch=False)[f"joint/clamp/{kind}"][-1]
        assert abs(found[axis]) == pytest.approx(1e-3 / (order + 1), rel=1e-9)


def test_arc_lengths_count_along_a_line_of_several_parts():
    """A force s along 2 m in two parts: 2 N; on a part alone it starts there: 1/2 N."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="a")
    mesh = mesh + sc.MeshCurve.init_line((1, 0, 0), (2, 0, 0), 2, name="b")
    for part, total in ((None, 2.0), ("b", 0.5)):
        model = sc.Model()
        rod = model.add("rod", sc.Beam(mesh, SECTION))
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("a.start")))
        model.add("load", sc.LoadLine(rod, lambda s: (s, 0, 0), part=part))
        found = sc.static(model, watch=False)["joint/clamp/force"][-1]
        assert abs(found[0]) == pytest.approx(total)


def test_functions_in_a_plane_stay_there():
    """Neither component of space lies in the plane alone."""
    model, rod = cantilever()
    across = np.array([0, 0.6, 0.8])
    model.add("load", sc.LoadLine(rod, lambda s: (1 + s) * across))
    system = model.freeze(planar=sc.Planar((0, 0.8, -0.6)))
    tip = sc.static(system, watch=False).position(rod.node("rod.end"))[-1]
    assert tip @ (0, 0.8, -0.6) == pytest.approx(0.0, abs=1e-18)  # the rounding of three products


def test_moving_beams_take_functions_of_arc_length(kernels):
    """A free rod under a force 6 s(1 - s) along it: its centre falls as a body of its mass."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1)))
    load = sc.LoadLine(rod, lambda s: (0, 6 * s * (1 - s), 0), amplitude=lambda t: 1 + t)
    model.add("load", load)
    history = sc.simulate(
        model, sc.Variational(), sc.NullSpace(), 1e-3, 0.02, kernels=kernels, derive=True
    )
    momentum = history["linear_momentum"][:, 1]
    t = history.times
    assert momentum[1:] == pytest.approx((t + 0.5 * t**2)[1:], rel=1e-8)


ROD = cantilever()[1]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: sc.LoadLine(ROD, lambda s: 3.0), r"value\(0.*\)"),
        (
            lambda: sc.LoadLine(ROD, ([0, 0.5], np.zeros((2, 3)))),
            "table of value: goes from 0 to 0.5 m",
        ),
        (lambda: sc.LoadLine(ROD, ([0, 1], [1.0, 2.0])), "value has shape"),
        (lambda: sc.LoadLine(ROD, moment=(1, 2)), "moment"),
        (lambda: sc.TermLine(ROD, [1.0, 2.0]), "value"),
    ],
)
def test_bad_line_loads(make, text):
    with pytest.raises(sc.InputError, match=text):
        make()
