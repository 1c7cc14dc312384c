"""Frequencies and shapes about deformed, prestressed and turning states; the tangent below them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import vibration_modes
from helpers_scenes import everything, random_state, random_tree
from scipy.spatial.transform import Rotation
from test_closed_loops import SCENES, frozen, hinges
from test_couplings import zoo

import skfem_cosserat as sc
from collection import m04_ring as rings
from collection import vibration
from skfem_cosserat import Spin
from skfem_cosserat.diagnostics.stacked import null_space_matrix, reduced_tangent
from skfem_cosserat.model.balance import amplitudes_at, balance
from skfem_cosserat.model.loops import closed, null_basis
from skfem_cosserat.model.reparametrisation import Reparametrisation

REFERENCES = json.loads(
    (Path(__file__).parents[1] / "data" / "modal_references.json").read_text(encoding="utf-8")
)
STEEL = sc.Material(210e9, 0.3, 7850.0)
RHO, E = 7850.0, 210e9

# -- the tangent -----------------------------------------------------------------------------------


def held(system, y, amplitudes, seed=0):
    """Balance at y with a dead force that makes it an equilibrium, with constraint forces."""
    at = balance(system, y, amplitudes)
    multipliers = np.random.default_rng(seed).standard_normal(system.m)
    carried = system.constraints.jacobian(y).T @ multipliers
    dead = at.R + carried.reshape(-1, 3)
    return replace(at, R=at.R - dead), dead


def along_chart(system, y, amplitudes, dead):
    """Derivative of ``P(y)^T R(y)`` along the coordinates by the complex step; no closed loops."""
    bound = sc.NullSpace().bind(system, 1.0)
    bound.begin(y, y[system.rows :], 1.0)
    bound.guess(False)
    sought = bound.sought
    out = np.empty((system.unknowns,) * 2)
    for k in range(system.unknowns):
        increment = np.zeros(system.unknowns, dtype=complex)
        increment[k] = 1e-40j
        bound.move(increment)
        y1 = bound.configure()
        R = balance(system, y1, amplitudes, before=y).R - dead
        out[:, k] = bound.reduce(R, y1).imag / 1e-40
        bound.sought = sought
    return out


def along_loops(system, y, amplitudes, dead, step=1e-3):
    """The same by differences of fourth order, loops closed anew.

    P at the displaced configurations is the nearest to the old one there is: a basis of its own
    in each of them may jump.
    """
    P0 = null_space_matrix(system, y)
    nodal = Reparametrisation(system.kinematics)
    chosen = system.closure.select(y, system.kinematics.values_at(y))
    Z = null_basis(system, y)

    def residual(increment):
        nodal.begin(y, y[system.rows :])
        nodal.add(Z @ increment)
        y1, _ = closed(system, nodal, chosen)
        basis = np.linalg.qr(null_space_matrix(system, y1).toarray())[0]
        R = balance(system, y1, amplitudes, before=y).R - dead
        return P0.T @ (basis @ (basis.T @ R.ravel()))

    out = np.empty((system.unknowns,) * 2)
    for k, e in enumerate(step * np.eye(system.unknowns)):
        near, far = residual(e) - residual(-e), residual(2 * e) - residual(-2 * e)
        out[:, k] = (8 * near - far) / (12 * step)
    return out


TURNING = Spin((0.7, -1.1, 2.3), (0.2, 0.1, -0.4))
TREES = {
    "every item, turning": (lambda: everything(1), TURNING),
    "random tree": (lambda: random_tree(3), None),
    "springs, turning": (lambda: zoo(1, moving=True), TURNING),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", TREES)
def test_reduced_tangent_on_trees(scene):
    """With couplings, follower loads and a turning frame, by complex steps along coordinates."""
    make, spin = TREES[scene]
    system = make()
    y = system.extend(random_state(system, np.random.default_rng(2), 0.3, 0.2), 0.3)
    amplitudes = replace(amplitudes_at(system, 0.3), spin=spin)
    at, dead = held(system, y, amplitudes)
    tangent = reduced_tangent(system, y, amplitudes, at)
    wanted = along_chart(system, y, amplitudes, dead)
    assert abs(tangent.K.toarray() - wanted).max() < 1e-12 * abs(wanted).max()
    assert abs(tangent.residual).max() < 1e-11
    assert (null_space_matrix(system, y) != tangent.P).nnz == 0


@pytest.mark.one_quick
@pytest.mark.parametrize("scene", SCENES)
def test_reduced_tangent_with_closed_loops(scene):
    """Redundant rows as well: whichever multipliers balance the forces give the same."""
    system = frozen(scene)
    y = system.extend(system.q0, 0.0)
    amplitudes = replace(amplitudes_at(system, 0.0), spin=TURNING)
    at, dead = held(system, y, amplitudes)
    tangent = reduced_tangent(system, y, amplitudes, at)
    wanted = along_loops(system, y, amplitudes, dead)
    assert abs(tangent.K.toarray() - wanted).max() < 1e-8 * abs(wanted).max()
    K = tangent.K
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()


# -- scenes ----------------------------------------------------------------------------------------


def square(h):
    return sc.SectionRectangle(h, h, STEEL)


def straight(elements, order, ends, section, pull=0.0, extra=()):
    """A beam of 1 m along e1 with clamped (C), simply supported (S) or free (F) ends."""
    model, beam = vibration.beam(1.0, elements, order, section)
    vibration.supported(model, beam, ends, 1.0)
    if pull:
        model.add("pull", sc.LoadForce(beam.node("b"), (pull, 0, 0)))
    for name, item in extra:
        model.add(name, item(beam) if callable(item) else item)
    return model.freeze()


def off(found, wanted):
    """Relative errors of pairs of equal frequencies: of the worse of the two nearest ones."""
    return np.array([np.sort(abs(found / w - 1))[1] for w in np.atleast_1d(wanted)])


# -- beams against exact solutions -----------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("case", ["-0.9", "0", "1", "100"])
def test_prestressed_beams(case):
    """M3: about the exactly stretched straight state, its constraint forces included."""
    data, h = REFERENCES["M3"]["values"][case], 0.05
    system = straight(16, 3, "SS", square(h), pull=data["T"])
    y = system.q0.copy().reshape(-1, 3)
    y[system.origin_rows] *= 1 + data["T"] / (E * h**2)
    found = sc.modes(system, y.ravel(), 16)
    assert (off(found.omega, data["omega_bending"][:3]) < 7e-7).all()
    assert found.rigid == 0


def ring(elements, order):
    return rings.scene(elements, order, rings.given(None, None))


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_orders_of_the_ring(order):
    """Frequencies converge with h^(2p): M4; those of straight beams in test_collection_modal.py."""
    wanted = REFERENCES["M4"]["values"]["n=2"]["outplane_omega"][0]
    counts = {1: (64, 128), 2: (32, 64), 3: (24, 48), 4: (16, 32)}[order]
    found = [sc.modes(ring(n, order), count=8).omega for n in counts]
    coarse, fine = (off(omega, wanted)[0] for omega in found)
    assert abs(np.log2(coarse / fine) - 2 * order) < 0.15


@pytest.mark.parametrize("slenderness", [1e3, 1e4, 1e5])
def test_slender_beams_keep_their_digits(slenderness):
    """The first frequency of a thin cantilever, against the one ten times as thick."""
    exact = 3.5160152685 * np.sqrt(E / (12 * RHO)) / slenderness  # Euler-Bernoulli
    found = sc.modes(straight(16, 3, "CF", square(1 / slenderness)), count=6)
    assert abs(found.omega[:2] / exact - 1).max() < 8 / slenderness**2 + 3e-10
    assert abs(found.omega[0::2] / found.omega[1::2] - 1).max() < 1e-9


# -- steady rotation -------------------------------------------------------------------------------


INERTIA = (1.0, 1.4, 2.0)


def top(inertia, gravity=0.0, arm=0.0, held=True):
    model = sc.Model()
    body = model.add("top", sc.RigidBody(1.0, inertia, position=(0, 0, arm)))
    if held:
        model.add("tip", sc.JointSpherical(sc.ground((0, 0, 0)), body.at((0, 0, 0))))
    if gravity:
        model.add("gravity", sc.LoadGravity((0, 0, -gravity)))
    return model.freeze()


def test_free_rotation_about_principal_axes():
    """Euler's equations: stable about the largest inertia, a saddle about the middle one."""
    A, B, C = INERTIA
    spin = Spin((0, 0, 3.0))
    found = sc.modes(top((A, B, C)), count=3, spin=spin)
    nutation = 3.0 * np.sqrt((C - A) * (C - B) / (A * B))
    assert abs(found.eigenvalues - 1j * np.array([0, nutation, 3.0])).max() < 1e-12
    assert found.rigid == 1
    found = sc.modes(top((A, C, B)), count=3, spin=spin)
    growth = 3.0 * np.sqrt((C - B) * (B - A) / (A * C))
    assert not found.stable
    assert abs(np.sort(found.growth) - [-growth, 0, growth]).max() < 1e-12
    free = sc.modes(top((A, B, C), held=False), count=6, spin=spin)
    assert abs(free.eigenvalues - nutation * 1j).min() < 1e-9


@pytest.mark.parametrize("speed", [30.0, 5.0])
def test_sleeping_top(speed):
    """Lagrange's top upright: ``A l^2 - C Omega l + m g h = 0``, less Omega seen from the frame."""
    system = top((0.1, 0.1, 0.05), 9.81, 0.5)
    found = sc.modes(system, system.q0, 3, spin=Spin((0, 0, speed)))
    roots = np.roots([0.1 + 0.25, -0.05 * speed, 9.81 * 0.5]) - speed  # motion exp(i root t)
    both = np.concatenate([1j * roots, -1j * roots.conj()])
    assert found.rigid == 1
    assert found.eigenvalues[0] == 0
    for s in found.eigenvalues[1:]:
        assert abs(both - s).min() < 1e-11 * abs(s)
    assert found.stable == (0.05 * speed > 2 * np.sqrt(0.35 * 9.81 * 0.5))


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_rotor_with_inner_damping(speed):
    """A mass on springs that turn with the frame: unstable beyond the critical speed 2 rad/s."""
    model = sc.Model()
    point = model.add("point", sc.MassPoint(1.0, (0, 0, 0)))
    for k, axis in enumerate(10 * np.eye(3)):
        model.add(f"spring {k}", sc.SpringDamper(sc.ground(axis), point.place(), 4.0, 0.1, 10.0))
    found = sc.modes(model, count=3, spin=Spin((0, 0, speed)))
    whirl = np.roots([1, 0.1 + 2j * speed, 4 - speed**2])
    wanted = np.array([*whirl, *whirl.conj(), *np.roots([1, 0.1, 4])])
    for s in found.eigenvalues:
        assert abs(wanted - s).min() < 1e-12
    assert found.stable == (speed < 2)


def test_pendulum_in_a_turning_frame():
    """Out at ``cos(theta) = m g l / (Omega^2 (B - C))``, with frequencies of closed form."""
    m, arm, g, speed = 2.0, 0.5, 9.81, 7.0
    A, difference = 0.3 + m * arm**2, 0.25 + m * arm**2 - 0.1
    theta = np.arccos(m * g * arm / (speed**2 * difference))
    out = Rotation.from_rotvec((theta, 0, 0)).as_matrix()
    model = sc.Model()
    bar = sc.RigidBody(m, (0.3, 0.25, 0.1), position=out @ (0, 0, -arm), triad=out.T)
    model.add("bar", bar)
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), bar.at((0, 0, 0)), axis=(1, 0, 0)))
    model.add("gravity", sc.LoadGravity((0, 0, -g)))
    system = model.freeze()
    found = sc.modes(system, system.q0, 1, spin=Spin((0, 0, speed)))
    wanted = speed * np.sin(theta) * np.sqrt(difference / A)
    assert found.omega[0] == pytest.approx(wanted, rel=1e-13)


# -- joints, bodies, loops, springs ----------------------------------------------------------------

G = 9.81


def hung(*links):
    """A chain of bars in the plane, hanging or up: mass, length, inertia about the centre each."""
    model, z, above = sc.Model(), 0.0, None
    for k, (mass, length, inertia) in enumerate(links):
        shape = (inertia, inertia, 0.1 * inertia)
        bar = model.add(f"bar {k}", sc.RigidBody(mass, shape, position=(0, 0, z - length / 2)))
        pivot = (0, 0, z)
        side = sc.ground(pivot) if above is None else above.at(pivot)
        model.add(f"pin {k}", sc.JointRevolute(side, bar.at(pivot), axis=(1, 0, 0)))
        above, z = bar, z - length
    model.add("gravity", sc.LoadGravity((0, 0, -G)))
    return model.freeze()


def test_double_pendulum():
    (m, a, I), (n, b, J) = links = (1.3, 0.8, 0.09), (0.7, 0.5, 0.03)  # noqa: E741
    M = np.array([[m * a**2 / 4 + I + n * a**2, n * a * b / 2], [n * a * b / 2, n * b**2 / 4 + J]])
    K = np.diag([(m / 2 + n) * G * a, n * G * b / 2])
    wanted = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K))))
    system = hung(*links)
    found = sc.modes(system, system.q0, 2)
    assert abs(found.omega / wanted - 1).max() < 1e-13
    assert sc.modes(system, count=2).rigid == 2  # without loads nothing holds it


def test_an_inverted_pendulum_grows():
    """Reported as such: a positive eigenvalue and a negative square, no frequency."""
    system = hung((1.3, -0.8, 0.09))
    found = sc.modes(system, system.q0, 1)
    square_ = 1.3 * G * 0.4 / (0.09 + 1.3 * 0.16)
    assert found.squares[0] == pytest.approx(-square_, rel=1e-13)
    assert found.growth[0] == pytest.approx(np.sqrt(square_), rel=1e-13)
    assert found.omega[0] == 0
    assert found.damping_ratios[0] == pytest.approx(-1)
    assert not found.stable
    assert "grows" in str(found)


def parallelogram(last=sc.JointRevolute):
    """Two cranks hanging from the ground and a coupler: spatial hinges, three rows too many."""
    model, axis = sc.Model(), (1.0, 0, 0)
    coupler = model.add("coupler", sc.RigidBody(1.7, (0.4, 0.1, 0.4), position=(0, 1.0, -1.0)))
    for y, kind in ((0.0, sc.JointRevolute), (2.0, last)):
        crank = model.add(f"crank {y}", sc.RigidBody(1.1, (0.2, 0.2, 0.05), position=(0, y, -0.5)))
        high, low = (0, y, 0), (0, y, -1)
        model.add(f"high {y}", sc.JointRevolute(sc.ground(high), crank.at(high), axis))
        model.add(f"low {y}", kind(crank.at(low), coupler.at(low), axis))
    model.add("gravity", sc.LoadGravity((0, 0, -G)))
    return model.freeze()


@pytest.mark.parametrize("last", [sc.JointRevolute, sc.JointPointOnLine])
def test_four_bar(last):
    """A closed loop: the coupler only translates."""
    system = parallelogram(last)
    found = sc.modes(system, system.q0, 1)
    wanted = np.sqrt(G * (1.1 + 1.7) / (2 * (0.2 + 1.1 * 0.25) + 1.7))
    assert found.omega[0] == pytest.approx(wanted, rel=1e-13)
    assert found.reduced.shape == (1, 1)


def test_body_on_a_beam():
    """A heavy body on the tip of a light beam: the flexibility of Timoshenko's cantilever."""
    mass, inertia = 5.0, 0.3
    light = sc.Section([80.0, 80, 5e3, 2.0, 3.0, 1.5], mass=1e-9, inertia=(1e-12, 1e-12))

    def lump(beam):
        return sc.RigidBody(mass, (inertia,) * 3, on=beam.node("b"))

    found = sc.modes(straight(1, 3, "CF", light, extra=[("lump", lump)]), count=6)
    M, wanted = np.diag([mass, inertia]), [np.sqrt(5e3 / mass), np.sqrt(1.5 / inertia)]
    for EI in (2.0, 3.0):
        flexibility = np.array([[1 / 3 / EI + 1 / 80, 0.5 / EI], [0.5 / EI, 1 / EI]])
        wanted += np.sqrt(np.linalg.eigvals(np.linalg.inv(flexibility @ M)).real).tolist()
    assert abs(found.omega / np.sort(wanted) - 1).max() < 1e-8


def test_springs_and_loads_between_bodies():
    """Two masses and a spring, free: five motions without stiffness and one frequency.

    Across the spring there is none either: it is at its length. Stretched by forces it is stiff
    across, too.
    """
    model = sc.Model()
    a, b = (model.add(n, sc.MassPoint(m, (0, 0, z))) for n, m, z in (("a", 2.0, 0), ("b", 3.0, 1)))
    model.add("spring", sc.SpringDamper(a.place(), b.place(), 50.0, length=1.0))
    pull = [sc.LoadForce(p.place(), (0, 0, s * 10.0)) for p, s in ((a, -1), (b, 1))]
    for k, load in enumerate(pull):
        model.add(f"pull {k}", load)
    system = model.freeze()
    found = sc.modes(system)
    assert found.rigid == 5
    assert found.omega[5] == pytest.approx(np.sqrt(50 / 1.2), rel=1e-14)
    q = system.q0.copy()
    q[5] += 0.2
    found = sc.modes(system, q)
    assert found.rigid == 3  # dead forces do not turn with the spring
    assert found.omega[3:5] == pytest.approx(np.sqrt(10 / 1.2 / 1.2), rel=1e-13)
    assert found.omega[5] == pytest.approx(np.sqrt(50 / 1.2), rel=1e-13)


def test_follower_forces_flutter():
    """Beck's column: stable below 20.05 EI/L^2, flutter above; K is not symmetric."""
    section = sc.Section([1e6, 1e6, 1e6, 1.0, 50.0, 40.0], mass=1.0, inertia=(1e-8, 1e-8))
    growth = []
    for load in (20.0, 20.1):

        def push(beam, load=load):
            return sc.LoadForce(beam.node("b"), (0, 0, -load), follower=True)

        system = straight(8, 3, "CF", section, extra=[("push", push)])
        y = system.q0.copy().reshape(-1, 3)
        y[system.origin_rows] *= 1 - load / 1e6
        found = sc.modes(system, y.ravel(), 4)
        growth.append(found.growth.max())
    assert abs(growth[0]) < 1e-6
    assert growth[1] > 0.1
    assert not found.stable


# -- damping ---------------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("elements", [4, 40])
def test_rayleigh_damping(elements):
    """Free: drag lets rigid motions decay with alpha; ratios ``alpha/(2 omega) + beta omega/2``."""
    alpha, beta = 30.0, 1e-4
    damping = sc.RayleighDamping(mass=alpha, stiffness=beta)
    still = sc.modes(straight(elements, 3, "FF", square(0.01)), count=12)
    system = straight(elements, 3, "FF", square(0.01), extra=[("damping", damping)])
    found = sc.modes(system, count=18)
    assert found.rigid == 6
    assert (found.eigenvalues[:6] == 0).all()
    assert abs(found.eigenvalues[6:12] + alpha).max() < 1e-7 * alpha
    omega = still.omega[6:]
    ratio = alpha / (2 * omega) + beta * omega / 2
    assert abs(found.damping_ratios[12:] / ratio - 1).max() < 1e-8
    assert abs(abs(found.eigenvalues[12:]) / omega - 1).max() < 1e-8


def test_dampers_and_viscous_sections():
    """A damped spring, overdamped too; a Kelvin-Voigt bar."""
    for c in (0.3, 9.0):
        model = sc.Model()
        point = model.add("point", sc.MassPoint(2.0, (0, 0, -1)))
        spring = sc.SpringDamper(sc.ground((0, 0, 0)), point.place(), 8.0, c, 1.0)
        model.add("spring", spring)
        found = sc.modes(model, count=3)
        roots = np.roots([2.0, c, 8.0])
        assert found.rigid == 2
        assert abs(roots - found.eigenvalues[2]).min() < 1e-12
    cable = sc.Model()
    point = cable.add("point", sc.MassPoint(2.0, (0, 0, -1)))
    cable.add("cable", sc.Cable(sc.ground((0, 0, 0)), point.place(), 8.0, 0.3, length=1.5))
    assert sc.modes(cable, count=3).rigid == 3  # slack: it neither pulls nor damps


# -- size ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_large_scenes():
    """5040 unknowns: exact to more digits than a reference has."""
    system = straight(280, 3, "CF", square(0.01))
    assert system.unknowns == 5040
    found = sc.modes(system)
    wanted = REFERENCES["M1"]["values"]["h=0.01,CF"]["omega"][:3]
    assert (off(found.omega, wanted) < 1e-11).all()


# -- states ----------------------------------------------------------------------------------------


def test_ways_to_give_a_state():
    system = hung((1.3, 0.8, 0.09))
    wanted = sc.modes(system, system.q0, 1).omega
    state = sc.initial_state(system)
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, until=0.02)
    for given in (state, history, (history, 0), system.q0.tolist()):
        assert sc.modes(system, given, 1).omega == pytest.approx(wanted, rel=1e-10)
    assert sc.modes(system, count=1, t=0.0).omega == wanted
    double = replace(amplitudes_at(system, 0.0), loads=np.array([2.0]))
    found = sc.modes(system, count=1, amplitudes=double)
    assert found.omega == pytest.approx(np.sqrt(2) * wanted, rel=1e-14)
    assert found.rigid == 0


def test_shapes_are_orthonormal_and_keep_the_constraints():
    system = bent_arc_clamped()
    found = sc.modes(system, count=8)
    mass = np.kron(system.mass.toarray(), np.eye(3))
    y = system.extend(system.q0, 0.0)
    masses = found.shapes @ mass @ found.shapes.T
    assert abs(masses - np.eye(8)).max() < 1e-10
    assert abs(system.constraints.jacobian(y) @ found.shapes.T).max() < 1e-12
    P = system.null_space(system.q0)
    assert abs(P @ found.reduced.T - found.shapes.T).max() < 1e-13


# -- animation -------------------------------------------------------------------------------------


def test_animation_of_a_closed_loop():
    """Triads stay orthonormal, loops and joints closed."""
    system = parallelogram()
    found = sc.modes(system, system.q0, 1)
    history = found.animation(0, amplitude=0.2, frames=16, periods=2)
    assert history.times[16] == pytest.approx(2 * np.pi / found.omega[0])
    assert history["constraint_violation"].max() < 1e-13
    rows = found.system.origin_rows
    moved = history["q"].reshape(33, -1, 3)[:, rows] - found.q.reshape(-1, 3)[rows]
    assert abs(moved[0] - moved[16]).max() < 1e-12
    assert np.linalg.norm(moved, axis=2).max() == pytest.approx(0.2 * found.system.length, rel=0.05)
    assert abs(moved[4]).max() < 1e-12  # a quarter later


def test_animation_of_a_rigid_motion_and_of_whirl():
    free = sc.modes(straight(2, 2, "FF", square(0.1)), count=6).animation(3)
    assert free.times[-1] == 1.0  # no period of its own
    found = sc.modes(top(INERTIA), count=3, spin=Spin((0, 0, 3.0)))
    whirl = found.animation(1, frames=12)
    assert whirl["constraint_violation"].max() < 1e-13
    axis = whirl["q"].reshape(13, 4, 3)[:, 3, :2]
    assert (np.linalg.norm(axis, axis=1) > 0.01).all()  # round, never back through the middle


# -- bad input -------------------------------------------------------------------------------------


def bad(call, *words):
    with pytest.raises(sc.InputError) as caught:
        call()
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_bad_counts_and_models():
    system = hung((1.0, 1.0, 0.1))
    for count in (0, 2, 1.5):
        bad(lambda count=count: sc.modes(system, count=count), "count", repr(count), "1 to 1")
    bad(lambda: sc.modes("scene"), "str", "Model")
    bad(lambda: sc.modes(system, count=1, tolerance=0.0), "tolerance", "0.0")
    bad(lambda: sc.modes(system, count=1, t=np.nan), "argument t", "nan")
    bad(lambda: sc.modes(system, count=1, spin=(0, 0, 1.0)), "spin", "Spin")
    found = sc.modes(system, system.q0, 1)
    for index in (1, True, 0.0):
        bad(lambda index=index: found.animation(index), "index", repr(index))
    bad(lambda: found.animation(0, amplitude=-1.0), "amplitude", "-1.0")
    bad(lambda: found.animation(0, frames=0), "frames", "0")
    rocker = sc.modes(hinges([(0, 0, 0), (0.9, 1.8, 0), (2.1, 1.8, 0), (3, 0, 0)], 3), count=1)
    assert rocker.rigid == 1
    bad(lambda: rocker.animation(0, amplitude=1.0), "amplitude", "smaller")


def test_modes_are_shown_in_one_line():
    """Printed, they gave all their arrays."""
    system = straight(8, 2, "CF", square(0.05))
    found = sc.modes(system, count=4)
    assert repr(found) == "<Modes: 4 about t = 0 s, {:.6g}, {:.6g}, {:.6g}, ... Hz>".format(
        *found.frequencies[:3]
    )
    assert len(str(found).splitlines()) == 5


def test_bad_states():
    system = hung((1.0, 1.0, 0.1))
    other = hung((1.0, 1.0, 0.2))
    bad(lambda: sc.modes(system, np.zeros(5), 1), "shape (5,)", "(12,)")
    bad(lambda: sc.modes(system, np.full(12, np.nan), 1), "not finite at [0")
    bad(lambda: sc.modes(system, 1.1 * system.q0, 1), "violates")
    history = sc.simulate(other, sc.Variational(), sc.NullSpace(), 0.01, until=0.01)
    bad(lambda: sc.modes(system, history, 1), "another model", "mass")
    bad(lambda: sc.modes(other, (history, 5), 1), "5", "2 states")
    wrong = replace(amplitudes_at(system, 0.0), loads=np.zeros(3))
    bad(lambda: sc.modes(system, count=1, amplitudes=wrong), "loads", "(3,)", "(1,)")


def test_no_equilibrium_is_refused_by_name():
    """With what is left over, and where."""
    system = straight(2, 2, "CF", square(0.1), pull=3e6)
    bad(lambda: sc.modes(system, system.q0), "not in equilibrium", "beam 'beam'")
    assert sc.modes(system, count=2).rigid == 0  # without loads it is one
    y = system.q0.copy().reshape(-1, 3)
    y[system.origin_rows] *= 1 + 3e6 / (E * 0.01) * (1 + 1e-5)
    bad(lambda: sc.modes(system, y.ravel()), "relative to all forces 5.0e-06")
    sc.modes(system, y.ravel(), count=2, tolerance=6e-6)
    windy = straight(2, 2, "CF", square(0.1), extra=[("drag", sc.RayleighDamping(mass=1.0))])
    with pytest.raises(sc.IncompatibleError, match="drag against space"):
        sc.modes(windy, spin=Spin((1.0, 0, 0)))


def test_a_singular_position_is_refused():
    """A parallelogram laid flat: its loop may open into either of two branches."""
    with pytest.warns(sc.ModelWarning, match="the reference configuration is a singular position"):
        system = hinges([(0, 0, 0), (1, 0, 0), (3, 0, 0), (2, 0, 0)], 3).freeze()
    bad(lambda: sc.modes(system, count=1), "singular position")


# -- paths of statics, and the example -------------------------------------------------------------


@pytest.mark.slow
def test_modes_along_a_static_path():
    """Loads are those of the load factor; from both treatments, and from a state of the path."""
    system = bent_arc_clamped()
    found = []
    for treatment in (sc.NullSpace(), sc.Multipliers()):
        path = sc.static(system, treatment)
        found.append(sc.modes(system, path).omega)
        state = sc.equilibrium(system, path)
        assert abs(sc.modes(system, state).omega / found[-1] - 1).max() < 1e-12
        sc.modes(system, (path, len(path) // 2))
        bad(lambda path=path: sc.modes(system, path, t=0.5), "not in equilibrium")
    assert abs(found[1] / found[0] - 1).max() < 1e-7
    assert abs(sc.modes(system).omega / found[0] - 1).max() > 0.02


@pytest.mark.slow
def test_a_clamp_at_the_origin_may_be_off_by_rounding():
    """Its rows have no terms there that this would be small against."""
    system = bent_arc_clamped()
    state = sc.equilibrium(system, sc.static(system))
    state.q[:3] += [1e-17, -2e-17, 0.0]
    assert sc.modes(system, state, count=1).omega[0] > 0


def bent_arc_clamped():
    arc = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, np.pi / 4, 3, "arc")
    model = sc.Model()
    section = sc.Section([90.0, 80, 200, 1.5, 2.5, 1.2], mass=1.3, inertia=(0.02, 0.03))
    beam = model.add("arc", sc.Beam(arc, section, director=(0, 0, 1), order=3))
    model.add("root", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("arc.start")))
    model.add("force", sc.LoadForce(beam.node("arc.end"), (0.5, -0.4, 2.0)))
    return model.freeze()


@pytest.mark.slow
def test_modes_of_a_rotor_found_by_statics():
    system, spin = straight(3, 3, "CF", square(0.05)), Spin((0, 0, 300.0), (-0.5, 0, 0))
    path = sc.static(system, spin=spin)
    by_path = sc.modes(system, path, 4, spin=spin)
    assert sc.modes(system, path, 4).omega.tolist() == by_path.omega.tolist()  # it knows its spin
    slower = Spin((0, 0, 150.0), (-0.5, 0, 0))
    bad(lambda: sc.modes(system, path, 4, spin=slower), "not in equilibrium")


@pytest.mark.slow
def test_example(tmp_path):
    pytest.importorskip("matplotlib")
    found = vibration_modes.main(quick=True, out=str(tmp_path))
    errors = {(r["order"], r["elements"]): np.abs(r["errors"]) for r in found["cantilever"]}
    assert errors[4, 6].max() < 1e-6 < errors[1, 24].max()
    assert found["ring"]["rigid"] == 6
    loads = found["column"]
    assert loads["zero_frequency"] == pytest.approx(loads["buckling"], rel=2e-2)
    assert (np.diff(found["blade"]["omega"], axis=0)[:, 0] > 0).all()
    assert (tmp_path / "vibration_modes.png").exists() and (tmp_path / "blade.csv").exists()


def test_a_free_scene_under_stress_of_its_own():
    """A spring stretched along a rigid rod: its force and the rod's cancel when both turn."""
    model = sc.Model()
    a, b = (model.add(n, sc.MassPoint(1.0, (0, 0, z))) for n, z in (("a", 0.0), ("b", 1.0)))
    model.add("rod", sc.JointDistance(a.place(), b.place()))
    model.add("spring", sc.SpringDamper(a.place(), b.place(), 1e3, length=0.3))
    found = sc.modes(model, count=5)
    assert found.rigid == 5
    assert (found.eigenvalues == 0).all()


@pytest.mark.slow
def test_frequencies_do_not_depend_on_the_place_of_the_origin():
    """Coordinates of 100 km are rounded by 1e-11 m, a force of 1 mN in a strip of steel.

    Beside its weight that is no equilibrium; the increment to one is of the size of rounding.
    """
    found = []
    for o in (np.zeros(3), 1e5 * np.array([1.0, 0.7, 0.1])):
        mesh = sc.MeshCurve.init_line(o, o + (1, 0, 0), 4, name="strip")
        section = sc.SectionRectangle(0.002, 0.03, sc.Material(210e9, 0.3, 7850.0))
        model = sc.Model()
        strip = model.add("strip", sc.Beam(mesh, section, order=3, director=(0, 0, 1)))
        model.add("clamp", sc.JointFixed(sc.ground(o), strip.node("strip.start")))
        model.add("weight", sc.LoadGravity((0, 0, -9.81)))
        path = sc.static(model)
        found.append(sc.modes(model, path, 3).omega)
        with pytest.raises(sc.InputError, match="is not in equilibrium"):
            sc.modes(model, sc.initial_state(model), 3)
    assert np.allclose(found[1], found[0], rtol=1e-8)
