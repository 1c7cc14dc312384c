"""What scenes of one structure share: made once, the same bits as in a process of their own."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from random_scenes import MOTION, random_scene

import skfem_cosserat as sc
from skfem_cosserat import pattern
from skfem_cosserat.compiled import plan
from skfem_cosserat.constraints import null_space
from skfem_cosserat.model.parts import connected_parts
from skfem_cosserat.pattern import FrozenPattern, Shared, shared


def rod(elements=6, order=1, joint=sc.JointRevolute, E=5e6, length=1.0, x=(0, 0, 0), spring=False):
    """A rod on a joint: numbers first, then what makes another structure of it."""
    x = np.array(x, dtype=float)
    mesh = sc.MeshCurve.init_line(x, x + (length, 0, 0), elements, name="rod")
    model = sc.Model()
    section = sc.SectionCircle(0.01, sc.Material(E, 0.5, 1e3))
    beam = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 1, 0)))
    axis = {} if joint is sc.JointSpherical else {"axis": (0, 0, 1)}
    model.add("joint", joint(sc.ground(x), beam.node("rod.start"), **axis))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
    if spring:
        place = sc.ground(x + (length, 1.0, 0))
        model.add("spring", sc.SpringDamper(place, beam.node("rod.end"), stiffness=1.0))
    return model


#: of the same structure, and of others that are nearly the same
SAME = ({"E": 7e6}, {"length": 1.3}, {"x": (0.2, 0.1, -0.3)})
OTHERS = (
    *({"elements": 7}, {"order": 2}, {"joint": sc.JointSpherical}, {"spring": True}),
    {"joint": sc.JointCylindrical},
)


def moved(model, kernels, treatment):
    """Some steps: all that is compared."""
    run = sc.simulate(model, sc.EnergyMomentum(), treatment, 1e-3, 4e-3, kernels=kernels)
    return [run[name] for name in MOTION if name in run]


def assert_same_bits(one, other):
    assert len(one) == len(other) > 0
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a, b, equal_nan=True)


@pytest.mark.slow
@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=repr)
def test_scenes_after_others_give_the_bits_of_scenes_alone(treatment, kernels):
    scenes = [{}, *SAME, *OTHERS]
    alone = []
    for options in scenes:
        shared.clear()
        alone.append(moved(rod(**options), kernels, treatment))
    shared.clear()
    for _ in range(2):  # after all others, the second time
        for options, expected in zip(scenes, alone, strict=True):
            assert_same_bits(moved(rod(**options), kernels, treatment), expected)


def test_a_scene_of_a_known_structure_takes_its_plan_and_patterns(monkeypatch):
    """Other numbers make nothing anew; another structure does."""
    pytest.importorskip("numba")
    made = []

    class Graph(plan._Graph):
        def __init__(self, *arguments):
            made.append("graph")
            super().__init__(*arguments)

    class Counted(FrozenPattern):
        def __init__(self, *arguments):
            made.append("pattern")
            super().__init__(*arguments)

    monkeypatch.setattr(plan, "_Graph", Graph)
    monkeypatch.setattr(null_space, "FrozenPattern", Counted)
    for kernels in ("numba", "numpy"):
        shared.clear()
        for options, some in (({}, True), *((same, False) for same in SAME), (OTHERS[0], True)):
            made.clear()
            stepper = sc.Stepper(
                rod(**options), sc.EnergyMomentum(), sc.NullSpace(), 1e-3, kernels=kernels
            )
            assert stepper.choice.name == kernels and stepper.method
            assert bool(made) == some


def test_what_is_shared_cannot_be_written_to():
    system = rod().freeze()
    known = plan.plan_of(system)
    assert plan.plan_of(rod(E=1e7).freeze()) is known
    with pytest.raises(ValueError, match="read-only"):
        known.order[0] = 1
    with pytest.raises(KeyError, match="no such block"):
        known.slots([0], [6])
    u, v = known.ends.T
    assert known.slots(u, v).tolist() == list(range(len(known.ends)))
    assert known.slots([-1, 0], [0, -1]).tolist() == [-1, -1]


def test_a_frozen_scene_takes_what_follows_from_its_integers_alone():
    """Places of constraint terms, connected parts, chains of elements; not those of others."""

    def shared_by(system):
        (beam,) = system.structures
        return system.constraints._pattern, connected_parts(system), beam.mesh.chain_order

    first = shared_by(rod().freeze())
    for options in SAME[:2]:  # away from the origin there are terms of the ground's directors, too
        for one, other in zip(first, shared_by(rod(**options).freeze()), strict=True):
            assert one is other
    other = shared_by(rod(elements=7).freeze())
    assert not any(one is two for one, two in zip(first, other, strict=True))
    assert other[1].part.tolist() == [0] * 32 and other[2].elements.tolist() == list(range(7))
    with pytest.raises(ValueError, match="read-only"):
        first[1].part[0] = 1


def test_what_is_kept_is_bounded():
    rows = np.arange(100)
    size = pattern._memory(FrozenPattern(rows, rows, (100, 100)))
    some = Shared(3 * size + 100)
    first = some(FrozenPattern, rows, rows, (100, 100))
    for k in (101, 102):
        some(FrozenPattern, rows, rows, (100, k))
    assert some(FrozenPattern, rows, rows, (100, 100)) is first  # used: the last to go
    second = some(FrozenPattern, rows, rows, (100, 103))
    assert some(FrozenPattern, rows, rows, (100, 100)) is first
    assert some(FrozenPattern, rows, rows, (100, 103)) is second
    assert some._size <= 3 * size + 100 and len(some._kept) <= 3
    large = np.arange(1000)
    one, other = (some(FrozenPattern, large, large, (1000, 1000)) for _ in range(2))
    assert one is not other  # too large to be kept
    some.clear()
    assert some._size == 0 and some(FrozenPattern, rows, rows, (100, 100)) is not first


def test_only_integers_tell_structures_apart():
    make = Shared(10**6)
    with pytest.raises(TypeError, match="float is no integer"):
        make(tuple, 1.0)

    def listed(*given):
        return [given]

    made = [
        make(listed, *given)
        for given in (
            *((np.array([1, 2]), np.array([3])), (np.array([1]), np.array([2, 3]))),
            *(((1, 2), (3,)), ((1,), (2, 3)), (1, 2, 3), (np.array([1, 2], dtype=np.int32),)),
        )
    ]
    assert len({id(each) for each in made}) == len(made)
    assert pattern._digest((True,)) != pattern._digest((1,))


def _both(seed):
    """A random scene with plain kernels and compiled ones, where there are some."""
    scene, found = random_scene(seed), []
    for kernels in ("numpy", "numba"):
        try:
            run = scene.run(kernels)
        except (sc.CosseratError, np.linalg.LinAlgError) as error:
            found.append(str(error))
        else:
            found.append([run[name] for name in MOTION if name in run])
    return found


def _compare(seeds):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in seeds:
            shared.clear()
            alone = _both(seed + 1)
            shared.clear()
            _both(seed)
            after, again = _both(seed + 1), _both(seed + 1)
            for other in (after, again):
                for one, two in zip(alone, other, strict=True):
                    if isinstance(one, str):
                        assert one == two
                    else:
                        assert_same_bits(one, two)


@pytest.mark.slow
def test_random_pairs_give_the_same_bits():
    pytest.importorskip("numba")
    _compare(range(6))


@pytest.mark.long
def test_many_random_pairs_give_the_same_bits():
    pytest.importorskip("numba")
    _compare(range(200))


@pytest.mark.slow
def test_a_process_of_its_own_gives_the_same_bits(kernels):
    """Not only what is shared on purpose is the same there."""
    code = (
        "import sys, hashlib; sys.path[:] = sys.argv[2:]\n"
        "import test_shared_structure as t, skfem_cosserat as sc\n"
        "found = t.moved(t.rod(**t.SAME[1]), sys.argv[1], sc.NullSpace())\n"
        "print(hashlib.sha256(b''.join(a.tobytes() for a in found)).hexdigest())"
    )
    path = [str(Path(__file__).parent), *sys.path]
    command = [sys.executable, "-c", code, kernels, *path]
    alone = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    for options in ({}, *OTHERS):
        moved(rod(**options), kernels, sc.NullSpace())
    found = moved(rod(**SAME[1]), kernels, sc.NullSpace())

    assert hashlib.sha256(b"".join(a.tobytes() for a in found)).hexdigest() == alone
