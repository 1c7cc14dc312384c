"""Forms of scikit-fem in runs: the same as built-in loads, closed forms, energies, errors."""

import numpy as np
import pytest
import skfem
from helpers_schemes import KINDS, treatments
from numpy.testing import assert_allclose

import skfem_cosserat as sc

SECTION = sc.SectionCircle(0.02, sc.Material(E=1e8, nu=0.3, rho=1000))


def scene(add, order=2, clamped=True, velocity=None):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    model = sc.Model()
    beam = model.add(
        "rod", sc.Beam(mesh, SECTION, order=order, director=(0, 1, 0), velocity=velocity)
    )
    if clamped:
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    model.add("load", add(beam))
    return model, beam


def run(add, scheme=None, treatment=None, step=2e-3, until=0.04, **more):
    model, beam = scene(add, **more)
    given = scheme or sc.EnergyMomentum(), treatment or sc.NullSpace()
    return sc.simulate(model, *given, step, until=until), beam


def ramp(t):
    return 1.0 + 10.0 * t


@skfem.LinearForm
def wind(v, w):
    return 3.0 * (1.0 + 10.0 * w.t) * (1.0 + w.s) * v[1]


@treatments
@pytest.mark.parametrize("scheme", KINDS, ids=lambda each: each.name)
def test_a_form_moves_a_beam_as_a_line_load(scheme, treatment):
    """A load that grows along the line and in time."""
    own, _ = run(lambda beam: sc.LoadForm(beam, wind), scheme, treatment)
    built = lambda beam: sc.LoadLine(beam, lambda s: (0, 3.0 * (1 + s), 0), ramp)  # noqa: E731
    other, _ = run(built, scheme, treatment)
    # the mean of a load that is linear in time is that at the midpoint
    assert_allclose(own["q"], other["q"], rtol=0, atol=1e-11 * abs(other["q"]).max())
    assert_allclose(own["work_loads"], other["work_loads"], rtol=0, atol=1e-12)
    total = own["load/load/force"].sum(axis=1)[:, 1]
    assert_allclose(total, 4.5 * ramp(own.times), rtol=1e-12)


def test_a_follower_form_and_a_bed_are_those_of_the_package():
    def pressure(v, w):
        return 5.0 * (w.d1 * v[:3]).sum(0)

    pair = [
        run(lambda beam: sc.LoadForm(beam, pressure))[0],
        run(lambda beam: sc.LoadLine(beam, (5.0, 0, 0), follower=True))[0],
    ]
    assert_allclose(pair[0]["q"], pair[1]["q"], rtol=0, atol=1e-11)

    def bed(w):
        return 20.0 * ((w.phi - w.x) ** 2).sum(0)

    # the bed of the package is lumped at the nodes: the same as a rigid motion sees it
    own, _ = run(lambda b: sc.EnergyForm(b, bed), clamped=False, velocity=(0, 1.0, 0), until=0.2)
    lumped, _ = run(
        lambda b: sc.Foundation(b, 40.0), clamped=False, velocity=(0, 1.0, 0), until=0.2
    )
    assert_allclose(own["q"], lumped["q"], rtol=0, atol=1e-9)
    assert np.ptp(own["energy"]) < 1e-11
    assert own["coupling_energy"][-1] > 0.1


def test_gravity_as_a_form_is_gravity_in_statics_too():
    def weight(v, w):
        return -9.81 * SECTION.mass * w.t * v[2]

    def tip(add):
        model, beam = scene(add)
        path = sc.static(model, control=sc.LoadControl(steps=2))
        return path.position(beam.node("rod.end"))

    assert_allclose(
        tip(lambda beam: sc.LoadForm(beam, weight)),
        tip(lambda beam: sc.LoadGravity((0, 0, -9.81))),
        rtol=0,
        atol=1e-9,
    )


@pytest.mark.parametrize("kernels", ["numpy", "numba"])
def test_drag_along_a_falling_rod(kernels):
    """v = w tanh(g t/w), given the derivative and without it."""
    drag = 30.0

    def law(v, w):
        speed = np.sqrt((w.velocity**2).sum(0))
        return -drag * speed * (w.velocity * v[:3]).sum(0) - 9.81 * SECTION.mass * v[2]

    def slope(u, v, w):
        return 0.0 * w.s  # it does not depend on places

    final, ends = np.sqrt(9.81 * SECTION.mass / drag), []
    for derivative in (None, slope):
        model, beam = scene(lambda b: sc.LoadForm(b, law, derivative=derivative), clamped=False)  # noqa: B023
        history = sc.simulate(
            model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, until=0.2, kernels=kernels
        )
        ends.append(history.velocity(beam.node("rod.end"))[-1])
        assert_allclose(history["energy_balance"], 0.0, rtol=0, atol=1e-11)
    speed = -final * np.tanh(9.81 * 0.2 / final)
    assert ends[0][2] == pytest.approx(speed, rel=2e-6)
    assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)
    fine = sc.Composition(sc.Variational(), 6)
    history = sc.simulate(model, fine, sc.NullSpace(), 5e-3, until=0.2, kernels=kernels)
    assert history.velocity(beam.node("rod.end"))[-1, 2] == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize(
    ("form", "text"),
    [
        (lambda v, w: np.zeros(7), r"gives an array \(7,\)"),
        (lambda v, w: v.grad[0], "takes the gradient of v"),
        (lambda v, w: v[1] * np.where(w.s > 0.7, np.nan, 1.0), r"law in element 2 is .*not finite"),
        (lambda v, w: v[1] * abs(w.phi[1]), "derivatives differ"),
        (lambda v, w: v[1] * w.nothing, "nothing"),
        (lambda v, w: v[1] ** 2, "not linear in v"),
        (lambda v, w: v[1] + 1.0, "not linear in v"),
        (lambda v, w: np.multiply(w.phi[1], 2.0, out=w.phi[1]) * v[1], "read-only"),
        (3.0, "expected a form"),
    ],
)
def test_wrong_forms_are_named(form, text):
    with pytest.raises(sc.InputError, match=text):
        scene(lambda beam: sc.LoadForm(beam, form))[0].freeze()


def test_a_wrong_derivative_is_named():
    def law(v, w):
        return -2.0 * w.phi[1] * v[1]

    def made(k):
        return scene(lambda b: sc.LoadForm(b, law, lambda u, v, w: -k * u[1] * v[1]))[0]

    wrong, right = made(1.0), made(2.0)
    with pytest.raises(sc.InputError, match="form 'load': its derivatives differ"):
        wrong.freeze()
    right.freeze()
