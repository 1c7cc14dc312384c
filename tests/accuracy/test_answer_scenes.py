"""``answer`` on scenes of 22 kinds, drawn from seeds, against runs that share no number with it.

The other run has another integrator, four times the elements (of order 4) and eight times the
steps; a chaotic scene has none. Limits: 97 % within the tolerance, 95 % within twice the band,
and eight times the cost of the run handed back in the median.
"""

from __future__ import annotations

import numpy as np
import pytest
from answer_scenes import KINDS, drawn

import skfem_cosserat as sc
from skfem_cosserat.accuracy.asked import Asked
from skfem_cosserat.accuracy.case import Case, Scene
from skfem_cosserat.accuracy.reading import Reading

SEEDS = (1, 2)


def independent(found, scene):
    """Readings of the other run."""
    asked = Asked(scene.quantities, scene.tolerance)
    method = scene.options.get("integrator") if scene.until is None else scene.other
    other = Scene(scene.model, asked, scene.until, None, method)
    parts = [found.model[n].mesh.nelements // other.pieces[n] for n in other.beams]
    steps = 0 if scene.until is None else 8 * round(scene.until / found.step)
    return other.run(Case(4 * min(parts, default=1), 4, steps)).values


def judged(kind, seed):
    """Whether it is reached, the error in tolerances and in bands, the cost in runs."""
    scene = drawn(kind, seed)
    found = sc.answer(
        *(scene.model, scene.quantities, scene.tolerance, scene.until), **scene.options
    )
    cost = found.cost_s / found.cost_of_run_s
    if not found.reached:
        return False, np.inf, np.inf, cost
    errors, bands = [], []
    jumps = np.array([event.time for event in found.history.events])
    around = np.stack([jumps - 2 * found.step, jumps + 2 * found.step], axis=1)
    for name, exact in independent(found, scene).items():
        own = Reading(found.values[name], None if exact.times is None else found.times)
        error = float(own.distances(exact, around)[1].max())
        errors.append(error / found.tolerance[name])
        bands.append(error / found.band[name])
    return True, max(errors), max(bands), cost


@pytest.mark.slow
@pytest.mark.usefixtures("kept_kernels")
@pytest.mark.filterwarnings("ignore::skfem_cosserat.CosseratWarning")
def test_forty_scenes():
    kinds = [kind for kind in KINDS if kind != "chaos"]
    results = {(kind, seed): judged(kind, seed) for kind in kinds for seed in SEEDS}
    reached, errors, bands, costs = (np.array(each) for each in zip(*results.values(), strict=True))
    assert len(results) == 42
    assert (errors <= 1).mean() >= 0.97, results
    assert (bands <= 2).mean() >= 0.95, results
    assert np.median(costs) <= 8, results
    assert reached.all(), results
