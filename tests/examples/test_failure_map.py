"""Where methods fail: outcomes, the mechanism, the highest frequency, and what a run tells."""

from __future__ import annotations

import csv
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers_scenes import everything, four_bar, full_section, random_state
from scipy.linalg import eigh

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.diagnostics import highest_frequency

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

from paper import failure_map as example
from paper import failure_mechanism, failure_report

swing = example.swing
EVENT_X = 0.6595  # s, of the finest runs


def stiffness(system: sc.System, q: np.ndarray, geometric: float) -> np.ndarray:
    """Dense tangent of the internal force (n, n), with or without the stresses' part."""
    y = system.extend(q, 0.0)
    K = np.zeros((system.n, system.n))
    for group, (eps, B) in zip(system.beam_groups, system.strain(y), strict=True):
        blocks = group.parts(B, B, group.stress(eps), 1.0, geometric).blocks()
        for dofs, block in zip(group.dofs, blocks, strict=True):
            K[np.ix_(dofs, dofs)] += block
    return K


def mass(system: sc.System) -> np.ndarray:
    return np.kron(system.mass.toarray(), np.eye(3))


def bar(elements: int, order: int = 1, size: float = 0.5, clamped: bool = False) -> sc.System:
    """A thick steel bar of 1 m: its highest frequency is that of axial waves."""
    steel = sc.Material(210e9, 0.3, 7850.0)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="bar")
    model = sc.Model()
    beam = sc.Beam(mesh, sc.SectionRectangle(size, size, steel), director=(0, 1, 0), order=order)
    beam = model.add("bar", beam)
    if clamped:
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("bar.start")))
    return model.freeze()


def loop_with_a_beam() -> sc.System:
    """A closed linkage of three bodies that carries a beam."""
    ball, pin = sc.JointSpherical, sc.JointRevolute
    model = four_bar((pin, ball, ball, pin))
    mesh = sc.MeshCurve.init_line((1, 1.2, 0), (1, 1.2, 0.5), 3, name="mast")
    mast = model.add("mast", sc.Beam(mesh, full_section(), director=(1, 0, 0)))
    model.add("foot", sc.JointFixed(model["coupler"].at((1, 1.2, 0)), mast.node("mast.start")))
    return model.freeze()


# -- highest frequency -----------------------------------------------------------------------------

SCENES = {
    "stiff swing": lambda: swing.build("stiff"),
    "everything": lambda: everything(1),
    "closed loop": loop_with_a_beam,
    "slender, of order 3": lambda: bar(5, 3, 0.01, clamped=True),
}


def dense_frequency(system: sc.System, q: np.ndarray) -> float:
    """Highest frequency of the material stiffness, by a dense eigenvalue solver."""
    P = system.null_space(q)
    K = P.T @ stiffness(system, q, 0.0) @ P
    return float(np.sqrt(eigh(K, P.T @ mass(system) @ P, eigvals_only=True)[-1]))


@pytest.mark.one_quick
@pytest.mark.parametrize("name", SCENES)
def test_highest_frequency_against_a_dense_eigenvalue_solver(name):
    system = SCENES[name]()
    assert highest_frequency(system) == pytest.approx(dense_frequency(system, system.q0), rel=1e-5)


def test_highest_frequency_in_a_bent_configuration():
    system = bar(3, 2, 0.1, clamped=True)
    q = random_state(system, np.random.default_rng(2))
    assert highest_frequency(system, q) == pytest.approx(dense_frequency(system, q), rel=1e-5)


@pytest.mark.parametrize("elements", [2, 10])
def test_highest_frequency_of_axial_waves(elements):
    """``2 sqrt(3)/l sqrt(E/rho)`` of the free bar with consistent mass: closed form."""
    exact = 2 * np.sqrt(3) * elements * np.sqrt(210e9 / 7850)
    assert highest_frequency(bar(elements)) == pytest.approx(exact, rel=1e-6)


def test_frequency_without_beams_and_bad_arguments():
    model = sc.Model()
    model.add("ball", sc.MassPoint(1.0))
    assert highest_frequency(model.freeze()) == 0.0
    with pytest.raises(sc.InputError, match="argument q"):
        highest_frequency(bar(2), np.zeros(3))


def test_no_frequency_of_a_motion_without_inertia():
    """A body whose mass lies on its axis d3 turns about that for nothing, where no joint does."""
    model = sc.Model()
    thin = model.add("thin", sc.RigidBody(1.0, euler=(0.0, 0.0, 0.1)))
    axis = sc.ground((0, 0, 0)), thin.at((0, 0, 0))
    model.add("hinge", sc.JointRevolute(*axis, axis=(1, 0, 0)))
    system = model.freeze()
    with pytest.raises(sc.linear.SingularMatrixError, match="a motion has no inertia"):
        diagnostics.constraint_frequency(system, system.q0, np.ones(system.n))


# -- the mechanism is told -------------------------------------------------------------------------

TOLD = "compression drives node rotations of beam 'beam' that alternate from step to step"


def fall(step, until, integrator=None, **options):
    """The stiff swing: its history, failed or not, and all that was said."""
    system, scheme = swing.build("stiff"), integrator or sc.Variational()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.CosseratWarning)
        own = {"kernels": "numpy", "derive": False} | options
        try:
            history, text = sc.simulate(system, scheme, sc.NullSpace(), step, until, **own), ""
        except sc.Diverged as error:
            history, text = error.history, str(error)
    return history, "; ".join([text, *(each["text"] for each in history.meta["warnings"])])


@pytest.mark.slow
def test_growing_alternations_are_told_with_the_energy_they_make():
    history, text = fall(1e-2, 0.65)
    assert history.status == "completed" and "the run gained" in text and text.count(TOLD) == 1
    ratio = history.meta["steps"]["h_omega_c"]
    assert f"the step times their frequency is {ratio:.3g}, and they grow above 2" in text
    system, k = swing.build("stiff"), 1
    exact = 1e-2 * diagnostics.constraint_frequency(
        system, history["q"][k], history["constraint_force"][k]
    )
    assert ratio == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
def test_nothing_is_told_where_they_do_not_grow_and_of_other_schemes():
    """The step times the highest frequency is 1000 and 100 000."""
    for step, until, scheme in ((1e-4, 2e-3, None), (1e-2, 0.1, sc.EnergyMomentum())):
        history, text = fall(step, until, scheme)
        assert "alternate" not in text and "h_omega_c" not in history.meta["steps"]


@pytest.mark.slow
def test_the_longest_part_of_a_composed_step_counts():
    system, scheme = swing.build("stiff"), sc.Composition(sc.Variational(), 4)
    history, _ = fall(1e-2, 0.05, scheme)
    longest = 1e-2 * max(map(abs, scheme.shares))
    found = diagnostics.alternation(system, history, longest)
    assert found is not None and found.item == "beam 'beam'"
    exact = [
        longest * diagnostics.constraint_frequency(system, q, force)
        for q, force in zip(history["q"][1:-1], history["constraint_force"][1:-1], strict=True)
    ]
    assert min(abs(np.array(exact) / found.ratio - 1)) < 1e-9
    assert diagnostics.alternation(system, history, 1.99 / max(exact) * longest) is None


# -- the mechanism ---------------------------------------------------------------------------------


def column(force: float) -> tuple[sc.System, np.ndarray]:
    """A short clamped column of the swing's physical section, and its equilibrium under a load."""
    section = sc.Section(swing.STIFFNESS, 7500.0, swing.INERTIA["physical"])
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 0.1), 4, name="column")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, section, director=(1, 0, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("column.start")))
    model.add("load", sc.LoadForce(beam.node("column.end"), (0, 0, -force)))
    system = model.freeze()
    y = system.q0.reshape(-1, 3).copy()
    y[system.origin_rows, 2] *= 1 - force / swing.STIFFNESS[2]
    return system, y.ravel()


def linear_prediction(
    system: sc.System, q: np.ndarray, load: np.ndarray, h: float
) -> tuple[float, np.ndarray]:
    """Largest growth exponent per step about an equilibrium, and the rates (n,) of its mode.

    Midpoint rule for K, leapfrog for K_c:
    ``M (u_{n+1} - 2 u_n + u_{n-1})/h^2 + K (u_{n+1} + 2 u_n + u_{n-1})/4 + K_c u_n = 0``.
    """
    P = system.null_space(q)
    y = system.extend(q, 0.0)
    ((eps, B),) = system.strain(y)
    group = system.beam_groups[0]
    force = system.internal_force([B], [group.stress(eps)]).ravel() - load
    assert abs(P.T @ force).max() < 1e-9 * abs(force).max()
    # second derivative of force . q(u): of a director theta x (theta x d)
    kin = system.kinematics
    blocks = np.zeros((kin.n_twist, kin.n_twist))
    for rows, twist in zip(kin.director_rows, kin.frame_twist, strict=True):
        A = np.einsum("ia,ib->ab", force.reshape(-1, 3)[rows], q.reshape(-1, 3)[rows])
        blocks[np.ix_(twist[3:], twist[3:])] = (A + A.T) / 2 - np.trace(A) * np.eye(3)
    T = kin.T.matrix(kin.values_at(y)).toarray()
    Kc = T.T @ blocks @ T
    K, M = P.T @ stiffness(system, q, 1.0) @ P, P.T @ mass(system) @ P
    mu, modes = eigh(-(K / 2 - 2 * M / h**2 + Kc), K / 4 + M / h**2)
    return float(np.arccosh(max(1.0, -mu[0] / 2))), P @ modes[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "h", "grows"), [(100, 0.04, False), (100, 0.05, True), (-400, 0.2, False)]
)
def test_alternating_rotations_grow_beyond_the_leapfrog_limit(force, h, grows):
    """A compressed column, disturbed by 1e-8 rad: exactly as the linear analysis says."""
    system, q = column(force)
    load = np.zeros(system.n)
    load[system.offset(system.structures[0].node("column.end")) + 2] = -force
    predicted, mode = linear_prediction(system, q, load, h)
    start = sc.initial_state(system, q + 1e-8 * mode / abs(mode).max(), np.zeros(system.n))
    states, forces = [], []
    for report in sc.steps(system, sc.Variational(), sc.NullSpace(), h, start=start):
        states.append(report.state.q)
        forces.append(report.constraint_force)
        if len(states) == 400 or abs(states[-1] - q).max() > 1e-4:
            break
    theta = failure_mechanism.alternating_rotations(system, np.array(states))
    limit = h * failure_mechanism.constraint_frequency(system, q, forces[1])
    assert (limit > 2) == grows == (predicted > 0)
    largest = abs(theta).max((1, 2))
    if not grows:
        assert largest.max() < 1e-7
        return
    half = len(theta) // 2
    late = np.polyfit(np.arange(half), np.log(largest[-half:]), 1)[0]
    assert late == pytest.approx(predicted, rel=1e-4)
    node, axis = np.unravel_index(np.argmax(abs(theta[-1])), theta.shape[1:])
    assert (np.diff(np.sign(theta[-half:, node, axis])) != 0).all()  # every step


# -- outcomes --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def quick_map(tmp_path_factory):
    """What the program finds with ``--quick``, its rows by integrator and step, its files."""
    folder = tmp_path_factory.mktemp("map")
    with warnings.catch_warnings():  # what fails is warned of
        warnings.simplefilter("ignore", sc.AccuracyWarning)
        found = example.main(quick=True, out=folder)
    by = {(row["integrator"], row["step_s"]): row for row in found["rows"]}
    return {**found, "by": by, "folder": folder}


@pytest.mark.slow
def test_a_full_period_takes_short_steps_of_energy_momentum(quick_map):
    """Those of 3e-3 and 1e-3 s make it, nothing else so coarse."""
    by = quick_map["by"]
    assert quick_map["period"] == pytest.approx(2.90, abs=0.02)
    whole = {key for key, row in by.items() if row["period_s"]}
    assert whole == {("energy-momentum", 3e-3), ("energy-momentum", 1e-3)}
    fine = by["energy-momentum", 3e-3]
    assert fine["outcome"] == "completed" and fine["end_s"] == pytest.approx(3.0)
    assert fine["residuals"] == [] and fine["solver_failed_s"] is None
    late = by["variational", 1e-3]
    assert late["outcome"] != "completed" and late["end_s"] > late["event_x_s"]


@pytest.mark.slow
@pytest.mark.parametrize("step", [3e-2, 1e-2, 3e-3])
def test_variational_blows_up_before_event_x_with_coarse_steps(quick_map, step):
    r = quick_map["by"]["variational", step]
    assert r["outcome"] == "energy blow-up" and 0.5 < r["end_s"] < EVENT_X
    assert r["event_x_s"] is None and r["period_s"] is None
    assert r["energy_error"] > 9
    assert r["energy_error_midpoint"] < 0.03  # what the scheme itself sees
    assert r["solver_failed_s"] > r["end_s"]  # the solver fails later, not first


@pytest.mark.slow
def test_energy_momentum_passes_event_x_and_fails_by_the_solver_alone(quick_map):
    r = quick_map["by"]["energy-momentum", 1e-2]
    assert r["outcome"] == "Newton failed" and r["end_s"] == r["solver_failed_s"]
    assert r["end_s"] > r["event_x_s"] == pytest.approx(EVENT_X, abs=2e-3)
    assert r["energy_error"] < 1e-9


@pytest.mark.slow
def test_alternations_take_the_energy_of_the_failing_swing(quick_map):
    """Nodes alternate and their energy grows; the midpoints' energy does not notice."""
    m = quick_map["mechanism"]
    assert m["growth"] > 5
    assert m["sign_changes"] > 0.8
    assert m["energy_growth"] > 1.5
    assert m["midpoint_change"] < 5e-3
    before = (m["times"] >= m["window"][0]) & (m["times"] <= m["window"][1])
    assert np.median(m["h_omega_c"][before]) > 2


@pytest.mark.slow
def test_every_failure_of_a_table_of_scenes_is_warned_of(quick_map):
    failed = [row for row in quick_map["criterion"] if row["failed_at"] is not None]
    assert failed and all(row["warned"] for row in failed)


@pytest.mark.slow
def test_files_and_report_of_the_map(quick_map):
    tables = {}
    for name in ("csv", "residuals.csv", "energy.csv", "criterion.csv"):
        head, *rows = (quick_map["folder"] / f"failure_map.{name}").read_text().splitlines()
        assert head.startswith("# skfem-cosserat") and "numpy" in head and "20" in head
        tables[name] = list(csv.DictReader(rows))
    rows = quick_map["rows"]
    assert [r["outcome"] for r in tables["csv"]] == [r["outcome"] for r in rows]
    assert len(tables["residuals.csv"]) == sum(len(r["residuals"]) for r in rows) > 0
    assert {r["integrator"] for r in tables["energy.csv"]} == set(failure_report.COLOURS)
    assert "mechanism" in failure_report.report(quick_map)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*may have several solutions")
@pytest.mark.plain
def test_mixed_iteration_solves_steps_that_newton_alone_cannot():
    """And takes half the iterations where both succeed."""
    run = swing.build("stiff"), sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 1.0
    mixed = sc.simulate(*run, derive=False, settings=sc.NewtonSettings(mixed=1e-3))
    with pytest.raises(sc.Diverged) as caught:
        sc.simulate(*run, derive=False, settings=sc.NewtonSettings(mixed=np.inf))
    plain = caught.value.history
    assert 0.7 < caught.value.time < 0.9
    n = len(plain)
    assert 2 * mixed["newton_iterations"][:n].sum() < plain["newton_iterations"].sum()
    assert abs(mixed["q"][50] - plain["q"][50]).max() < 1e-9  # the same solution
    residuals = caught.value.residuals
    assert [len(x) for x in residuals] == [21, 21, 101, 101]
    assert min(map(min, residuals)) == caught.value.residual


def test_bad_integrator():
    with pytest.raises(ValueError, match="integrators = 'euler'"):
        example.main(steps=(1e-1,), integrators=("euler",))
