"""Functions of the user's own that fail in a run: what is told, and what is kept."""

import warnings

import numpy as np
import pytest

import skfem_cosserat as sc

#: when functions begin to fail (s), and the step (s)
LATE, STEP = 0.0605, 1e-3

#: the quadratic energy of a rod, by strains
STIFFNESS = np.array([2e3, 2e3, 5e3, 0.5, 0.5, 0.4])


def quadratic(eps):
    return (STIFFNESS * eps**2).sum(-1) / 2


def boom(*_):
    raise KeyError("boom")


class SensorOwn(sc.Sensor):
    """One number, by a function of time."""

    def __init__(self, item, value):
        self.item, self.value = item, value

    def items(self):
        return [self.item]

    def values(self, system, window):
        return np.array([self.value(t) for t in window.t])


def own_force(place, force=lambda v, t: -0.1 * v, slopes=None):
    """Drag; force or its derivatives by functions of ``(v, t)``."""
    derivative = slopes and (lambda x, v, t: slopes(v, t))
    return sc.Force([place], lambda x, v, t: force(v, t), derivative=derivative)


def drag_slopes(v, t):
    return np.zeros((1, 3, 1, 3)), -0.1 * np.eye(3).reshape(1, 3, 1, 3)


def scene(what, late):
    """A rod on a hinge with a part whose function gives `late` of its value from LATE on."""

    def since(good):
        return lambda *given: (late if given[-1] >= LATE else lambda x: x)(good(*given))

    def energy(eps):
        return (late if clock[0] >= LATE else lambda x: x)(quadratic(eps))

    clock, model, run = [0.0], sc.Model(), {}
    derivatives = {
        "gradient": lambda eps: STIFFNESS * eps,
        "hessian": lambda eps: np.broadcast_to(np.diag(STIFFNESS), (*eps.shape, 6)).copy(),
    }
    section = sc.SectionHyperelastic(energy, mass=0.1, inertia=(1e-5, 1e-5), **derivatives)
    if what != "energy":
        section = sc.Section(STIFFNESS, mass=0.1, inertia=(1e-5, 1e-5))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    motion = sc.Motion(since(lambda t: np.array([0, t**3, 0]))) if what == "motion" else None
    base, end = sc.ground((0, 0, 0), motion), rod.node("rod.end")
    hinge = model.add("hinge", sc.JointRevolute(base, rod.node("rod.start"), axis=(0, 0, 1)))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    if what == "amplitude":
        model.add("push", sc.LoadForce(end, (0, 1, 0), since(lambda t: 0.1)))
    elif what == "value":
        model.add("push", sc.LoadForce(end, since(lambda t: np.array([0, 0.1, 0]))))
    elif what == "force":
        model.add("push", own_force(end, force=since(lambda v, t: -0.1 * v)))
    elif what == "slopes":
        model.add("push", own_force(end, slopes=since(drag_slopes)))
    elif what == "motor":
        model.add("motor", sc.JointActuator(hinge, since(lambda t: 0.01)))
    elif what == "drive":
        model.add("drive", sc.JointDrive(hinge, since(lambda t: 10 * t**3)))
    elif what == "energy":
        run["callbacks"] = [lambda report: clock.__setitem__(0, report.state.time + STEP)]
    elif what == "sensor":
        run["sensors"] = {"eye": SensorOwn(rod, since(lambda t: 1.0))}
    elif what == "event":
        run["events"] = [sc.Event(lambda t, view: since(lambda t: 1.0)(t), name="bell")]
    elif what == "action":
        answer = sc.ActionFunction(lambda t, view: late(1.0))
        run["events"] = [sc.Event(sc.ConditionTime(LATE), answer, name="bell")]
    return model.freeze(), run


def text_of(error):
    return "\n".join([str(error), *getattr(error, "__notes__", [])])


OWNERS = {
    "amplitude": "load 'push': function of time: ",
    "value": "load 'push': ",
    "force": "force 'push': ",
    "slopes": "force 'push': ",
    "motor": "joint actuator 'motor': function of time: ",
    "drive": "drive 'drive': function of time: ",
    "motion": "prescribed motion of the ground at [0.0, 0.0, 0.0]: displacement(",
    "energy": "stored energy: energy of ",
    "event": "event 'bell': ",
    "action": "event 'bell': at t = 0.0605 s: action: ",
}


def imaginary(x):
    return np.asarray(x) * 1j


@pytest.mark.one_quick
@pytest.mark.parametrize("what", OWNERS)
@pytest.mark.parametrize(
    ("late", "scheme", "kernels"),
    [
        (boom, sc.EnergyMomentum(), "numpy"),
        (imaginary, sc.EnergyMomentum(), "numba"),
        (boom, sc.GeneralizedAlpha(0.9), "numba"),
    ],
)
def test_functions_that_fail_are_named_with_the_time_and_the_states_before(
    what, late, scheme, kernels
):
    if kernels == "numba":
        pytest.importorskip("numba")
    if what == "energy" and not scheme.single.name.startswith("energy"):
        pytest.skip("this scheme takes derivatives alone")
    system, run = scene(what, late)
    with pytest.raises(sc.InputError) as caught:
        sc.simulate(system, scheme, sc.NullSpace(), STEP, 0.08, kernels=kernels, **run)
    text, history = text_of(caught.value), caught.value.history
    assert text.startswith(OWNERS[what])
    assert history.status == "failed"
    if (what, kernels) != ("slopes", "numba"):  # these keep factors of steps before
        assert history.times[-1] == pytest.approx(LATE if what == "action" else 0.06)
    assert np.isfinite(history["q"]).all()
    assert "0.06" in text
    assert late is not boom or "KeyError: 'boom'" in text
    assert "np.float64" not in text


@pytest.mark.slow
@pytest.mark.parametrize("until", [0.09, 0.2], ids=["at the end", "on the way"])
@pytest.mark.parametrize(
    ("late", "told"),
    [
        (boom, r"for times up to t = 0\.\d+ s it failed: KeyError: 'boom'"),
        (imaginary, r"values = (.|\n)* expected real numbers"),
    ],
)
def test_sensors_that_fail_are_named_and_the_states_are_kept(late, told, until):
    system, run = scene("sensor", late)
    if until < 0.1:  # nothing is lost but what the sensor would have given
        with pytest.warns(sc.IncompleteWarning, match=rf"sensor 'eye': .*{told}"):
            history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), STEP, until, **run)
        assert history.status == "completed"
        return
    with pytest.raises(sc.InputError, match=rf"sensor 'eye': .*{told}") as caught:
        sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), STEP, until, **run)
    assert len(caught.value.history) > 40


@pytest.mark.slow
def test_sensors_give_one_shape_for_all_instants():
    system, run = scene("sensor", lambda x: x)
    eye = run["sensors"]["eye"]
    scheme = sc.EnergyMomentum(), sc.NullSpace(), STEP
    vars(eye)["values"] = lambda system, window: 1.0
    with pytest.raises(sc.InputError, match=r"sensor 'eye': .*\(\) for 1 instants"):
        sc.simulate(system, *scheme, 0.01, **run)
    vars(eye)["values"] = lambda system, window: np.ones((len(window.t), 1 + (window.t[0] > 0)))
    with pytest.raises(sc.InputError, match=r"sensor 'eye': gives values \(2,\), and \(1,\) b"):
        sc.simulate(system, *scheme, 0.5, **run)


@pytest.mark.slow
def test_a_law_that_fails_only_in_the_energies_of_the_end_costs_nothing_else():
    system, run = scene("energy", boom)  # steps of this scheme need the derivatives alone
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        history = sc.simulate(
            system, sc.GeneralizedAlpha(0.9), sc.NullSpace(), STEP, 0.08, kernels="numpy", **run
        )
    assert history.status == "completed"
    assert any("stored energy: energy" in str(each.message) for each in told)


@pytest.mark.slow
@pytest.mark.parametrize("kernels", ["numpy", "numba"])
def test_energies_that_are_not_finite_are_named_with_the_strains(kernels):
    if kernels == "numba":
        pytest.importorskip("numba")
    system, run = scene("energy", lambda value: value * np.nan)
    pair = sc.EnergyMomentum(), sc.NullSpace()
    told = r"stored energy of beam 'rod' is nan, its stresses \[.*\], at strains \["
    with pytest.raises(sc.Diverged, match=told) as caught:
        sc.simulate(system, *pair, STEP, 0.08, kernels=kernels, **run)
    assert caught.value.history.times[-1] == pytest.approx(0.06)


@pytest.mark.slow
@pytest.mark.parametrize("kernels", ["numpy", "numba"])
def test_energies_that_are_not_finite_are_named_on_paths(kernels):
    if kernels == "numba":
        pytest.importorskip("numba")

    late = [1.0]
    section = sc.SectionHyperelastic(
        lambda eps: late[0] * quadratic(eps), mass=0.1, inertia=(1e-5, 1e-5)
    )
    mesh, model = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod"), sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("push", sc.LoadForce(rod.node("rod.end"), (0, 0, 0.1)))
    run = {"control": sc.LoadControl(2.0), "callbacks": [lambda point: late.__setitem__(0, np.nan)]}
    with pytest.raises(sc.Diverged, match=r"stored energy of beam 'rod' is .*nan, nan") as caught:
        sc.static(model.freeze(), kernels=kernels, **run)
    assert "strains [" in str(caught.value)
