"""Strains in compiled kernels, written out for speed, against the table of forms for every order.

Of each kernel its value, and the first and second derivatives of strains in it: stresses, forces,
predicted stresses, tangents. What is expected is made from ``strain_table`` alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers_kernels import called
from helpers_scenes import FULL, full_section, rotation

import skfem_cosserat as sc
from skfem_cosserat.compiled import bind, elements
from skfem_cosserat.compiled.numbers import END, ENDS, FORCE, NUMBERS, SHARE, START, WEIGHT
from skfem_cosserat.compiled.plan import plan_of
from skfem_cosserat.kernels import null_space_blocks
from skfem_cosserat.strain import strain_table

# linear elements are bent too far; formulas hold all the same
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning"),
]

orders = pytest.mark.parametrize("order", [1, 3])


class Expected(NamedTuple):
    """Of three states, at the start, middle and end of a step."""

    start: np.ndarray  # stresses there
    stress: np.ndarray  # between both ends
    force: np.ndarray  # at the middle, rows of y
    predicted: np.ndarray
    tangent: np.ndarray
    change: np.ndarray  # of rows of y, for what is predicted


def numbers() -> np.ndarray:
    """Shares of both ends that differ, no masses; a share and a factor that are not one."""
    out = np.zeros(len(NUMBERS))
    out[[ENDS, START, END, WEIGHT, SHARE, FORCE]] = 1, 0.4, 0.6, 0.5, 0.7, 1.3
    return out


def scene(order: int) -> tuple[sc.System, sc.Beam]:
    """Five elements, so that one is left of four; parts of the beam meet under an angle."""
    points = [(0, 0, 0), (1, 0, 0), (1.3, 0.9, 0.2)]
    lines = [sc.MeshCurve.init_line(*points[k : k + 2], k + 2, name=f"l{k}") for k in range(2)]
    section = full_section()
    model = sc.Model()
    beam = sc.Beam(
        lines[0].joined(lines[1]),
        {"l0": section, "l1": section},
        order=order,
        director=(0, 0, 1),
    )
    model.add("beam", beam)
    return model.freeze(), beam


def random_state(beam: sc.Beam, seed: int) -> np.ndarray:
    """Rows of y: displaced, and turned."""
    rng = np.random.default_rng(seed)
    q = beam.reference.reshape(-1, 4, 3).copy()
    q[:, 0] += 0.2 * rng.standard_normal((len(q), 3))
    for node in q:
        node[1:] = node[1:] @ rotation(rng, 0.3)
    return q.reshape(-1, 3)


def strain_forms(beam: sc.Beam) -> np.ndarray:
    """Second derivatives (ne, ng, 6, k, k) of the strains by the coordinates of the nodes."""
    basis = beam.basis
    C = strain_table(basis.shape(basis.points), basis.dshape(basis.points))
    ne, nn = basis.connectivity.shape
    Q = np.zeros((ne, nn, 4, 3, nn, 4, 3))  # to the directors of the sections
    for a in range(nn):
        Q[:, a, 0, :, a, 0] = np.eye(3)
        Q[:, a, 1:, :, a, 1:] = np.einsum("eij,cd->eicjd", beam.rotations[:, a], np.eye(3))
    Q = Q.reshape(ne, 12 * nn, 12 * nn)
    return np.einsum("eki,gskl,elj,e->egsij", Q, C, Q, 1 / basis.lengths, optimize=True)


def by_table(beam: sc.Beam, D: np.ndarray, states: list[np.ndarray]) -> Expected:
    forms, basis = strain_forms(beam), beam.basis
    nodes = basis.connectivity
    dofs = (12 * nodes[:, :, None] + np.arange(12)).reshape(len(nodes), -1)
    x0, xm, x1 = (y.ravel()[dofs] for y in states)
    rest = beam.reference[dofs]
    share, factor = numbers()[SHARE], numbers()[FORCE]
    low, high = numbers()[[START, END]]

    def strains(x: np.ndarray) -> np.ndarray:
        return 0.5 * (
            np.einsum("ei,egsij,ej->egs", x, forms, x)
            - np.einsum("ei,egsij,ej->egs", rest, forms, rest)
        )

    def slopes(x: np.ndarray) -> np.ndarray:
        return np.einsum("egsij,ej->egsi", forms, x)

    start = strains(x0) @ D
    stress = low * start + high * strains(x1) @ D
    measure = basis.lengths[:, None] * basis.weights
    force = np.zeros(states[0].size)
    np.add.at(force, dofs, np.einsum("eg,egsi,egs->ei", measure, slopes(xm), stress))
    change = states[2] - states[0]
    rates = np.einsum("egsi,ei->egs", slopes(x1), change.ravel()[dofs])
    blocks = np.einsum("eg,egsi,st,egtj->eij", measure, slopes(xm), D, slopes(x1), optimize=True)
    blocks *= high  # stresses change with the end of the step by its share
    blocks += share * np.einsum("eg,egs,egsij->eij", measure, stress, forms)
    K = np.zeros((force.size, force.size))
    for rows, block in zip(dofs, blocks, strict=True):
        K[np.ix_(rows, rows)] += factor * block
    predicted = stress + high * rates @ D
    return Expected(start, stress, force.reshape(-1, 3), predicted, K, change)


def null_space(y: np.ndarray) -> np.ndarray:
    """P_int of all nodes, (12 nv, 6 nv)."""
    triads = y.reshape(-1, 4, 3)[:, 1:]
    return null_space_blocks(triads[None])[0]


def assert_blocks(A: np.ndarray, ends: np.ndarray, K: np.ndarray) -> None:
    """Blocks at their slots, and nothing elsewhere."""
    found = np.zeros_like(K)
    for k, (u, v) in enumerate(ends):
        rows, cols = (slice(6 * w, 6 * (w + 1)) for w in (u, v))
        found[rows, cols] = A[k]
    assert_near(found, K)


def assert_near(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())


@pytest.mark.slow
@orders
def test_in_space(order):
    system, beam = scene(order)
    states = [random_state(beam, k) for k in (1, 2)]
    states.insert(1, (states[0] + states[1]) / 2)
    expected = by_table(beam, FULL, states)
    plan = plan_of(system.joint_coordinates)
    w, work = bind.bound_work(system.joint_coordinates, plan)
    g, beams = bind.bound_beams(system, system.beam_groups[0], plan)
    assert beams["turned"] and not beams["diagonal"]
    for name, y in zip(("y0", "mid", "y1"), states, strict=True):
        work[name][: system.rows] = y
    work["change"][:] = expected.change
    called(elements.beam_start)(g, w, numbers(), 0)
    assert_near(beams["S0"], expected.start)
    called(elements.beam_force)(g, w, numbers(), 0)
    assert_near(beams["S"], expected.stress)
    assert_near(work["internal"], expected.force)
    called(elements.beam_predicted)(g, w, numbers(), 0)
    assert_near(beams["predicted"], expected.predicted)
    called(elements.beam_tangent)(g, w, numbers(), 0)
    K = null_space(states[1]).T @ expected.tangent @ null_space(states[2])
    assert_blocks(work["A"], plan.ends, K)
