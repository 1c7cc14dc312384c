"""Adapters of other programs: found by their files, asked by one contract, the same scenes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks" / "peers"))

import dynamic_references
import measuring
import own
import peer_calls
import scenes
import versus_peers

from paper import three_bar_swing

BENCHMARKS = peer_calls.ADAPTERS.parent
#: a stone, of which the answer is known
STONE = """
import sys
sys.path.insert(0, {folder!r})
import common
NAME = "Stone"
REQUIREMENT = ""
def run(scene):
    if scene["joints"]:
        raise common.Refused("it is on no hinge")
    x, v, h = scene["beams"][0]["nodes"][scene["watch"][2]][2], [0.0, 0.0], scene["step"]
    def step(t):
        v[1] += h * (v[0] + h / 2 * scene["gravity"][2])
        v[0] += h * scene["gravity"][2]
    return common.explicit(scene, step, lambda: [0.0, 0.0, x + v[1]])
if __name__ == "__main__":
    common.answer(run)
"""


@pytest.fixture
def stone(tmp_path):
    """An adapter of one file in a folder of its own."""
    (tmp_path / "stone.py").write_text(STONE.format(folder=str(BENCHMARKS / "peers")))
    return peer_calls.peers(tmp_path)["stone"]


def question(name, elements, step, **options):
    return scenes.SCENES[name](elements) | {"step": step, "warm": 2, "options": options}


def positions(name, elements, step, until, **options):
    """Of this package."""
    scene = question(name, elements, step, kernels="numpy", **options)
    return np.array(own.run(scene | {"until": until})["positions"])


def test_adapters_are_found_by_their_files():
    """Not imported; each told in the README, as are the keys of a question."""
    found = peer_calls.peers()
    others = {"exudyn_beam", "exudyn_cable", "exudyn_plane", "mujoco_chain", "pyelastica_rod"}
    assert set(found) == {"own", *others}
    assert all("==" in found[name].requirement for name in others)
    text = (BENCHMARKS / "peers" / "README.md").read_text(encoding="utf-8")
    for name in [*(f"{name}.py" for name in found), *question("four-bar", 2, 0.1)]:
        assert f"`{name}`" in text
    assert not {"exudyn", "elastica", "mujoco"} & set(sys.modules)


@pytest.mark.slow
def test_one_file_is_enough(stone):
    assert (stone.name, stone.requirement) == ("Stone", "")
    python = peer_calls.prepare(stone)
    scene = question("spaghetti", 2, 0.05) | {"gravity": [0, 0, -10.0], "until": 0.3}
    answer = peer_calls.ask(python, stone, scene)
    assert (answer["status"], answer["steps"]) == ("completed", 6)
    instants = 0.1 * np.arange(1, 4)
    np.testing.assert_allclose(np.array(answer["positions"])[:, 2], -5 * instants**2, atol=1e-12)
    assert 0 < answer["seconds"] < answer["process_s"] < 60
    assert answer["wall_s"] > 0
    held = peer_calls.ask(python, stone, question("rod", 2, 0.0125))
    assert held["status"] == "refused: it is on no hinge"


def test_an_adapter_that_fails_says_so(tmp_path):
    for name, text, status in (
        ("talks", "print('hello')", "failed: no JSON"),
        ("breaks", "raise ValueError('no beam')", "failed with exit status 1: ValueError: no beam"),
    ):
        path = tmp_path / f"{name}.py"
        path.write_text(text)
        peer = peer_calls.Peer(name, "", path)
        assert status in peer_calls.ask(Path(sys.executable), peer, {}, 60)["status"]


def test_a_program_that_cannot_be_installed(tmp_path, monkeypatch):
    def refuse(*a, **k):
        raise OSError("no disk")

    monkeypatch.setattr(peer_calls.venv, "create", refuse)
    peer = peer_calls.Peer("x", "nothing==0", tmp_path / "x.py")
    with pytest.raises(peer_calls.Unavailable, match="nothing==0 could not be installed: no disk"):
        peer_calls.prepare(peer, tmp_path)


# the inertia of the swing is as published
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:section. inertia:skfem_cosserat.ModelWarning")
def test_plain_numbers_are_the_scenes_of_the_paper_and_the_collection():
    """The same paths as the scenes built elsewhere; plain numbers survive JSON."""
    for name in scenes.SCENES:
        scene = question(name, 8, 0.1)
        assert json.loads(json.dumps(scene)) == scene
    methods = sc.EnergyMomentum(), sc.NullSpace()
    for name, system, at, step, axes in (
        ("rod", measuring.chain(4, 2), lambda b: b.node("rod.end"), 0.0125, [0, 1, 2]),
        ("swing", three_bar_swing.build(elements=4, order=2), None, 0.025, [1, 2, 0]),
        ("spaghetti", dynamic_references.spaghetti(4, 2).system, None, 0.1, [0, 1, 2]),
    ):
        beam = system.structures[0]
        place = at(beam) if at else beam.node("mid" if name == "swing" else "rod.end")
        history = sc.simulate(system, *methods, step, 4 * step, derive=False, kernels="numpy")
        mine = positions(name, 4, step, 4 * step, order=2)
        np.testing.assert_allclose(mine, history.position(place)[1:, axes], atol=1e-9)


@pytest.mark.slow
def test_the_linkage_stays_closed_and_the_blade_has_its_mass():
    """Crank and rocker keep their lengths; the published blade has 65.25 t."""
    system, place = own.system(json.dumps(question("four-bar", 4, 0.05)), 2, False)
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.025, 0.2, kernels="numpy")
    beam = system.structures[0]
    for node, pin, length in ((0, (0, 0, 0), 0.3), (-1, (1, 0, 0), 0.8)):
        name = "0.start" if node == 0 else "0.end"
        path = history.position(beam.node(name))
        np.testing.assert_allclose(np.linalg.norm(path - pin, axis=1), length, atol=1e-9)
    moved = history.position(place)
    assert np.linalg.norm(moved[-1] - moved[0]) > 1e-3
    assert sum(row[6] for row in scenes.BLADE) * 117 / 8 == pytest.approx(65_250, rel=0.02)
    tip = positions("blade", 8, 0.1, 1.0, order=1)[-1]
    assert 1 < tip[0] < 20 and tip[1] > 0.1


@pytest.mark.slow
def test_a_program_that_is_not_there_is_missed(monkeypatch):
    """In the comparison of steps, with the reason."""

    def refuse(*arguments):
        raise peer_calls.Unavailable("no wheel")

    monkeypatch.setattr(peer_calls, "prepare", refuse)
    result = versus_peers.main()
    assert not result["rows"]
    assert sorted(versus_peers.missed(result)) == [
        f"{peer}: not measured: no wheel"
        for peer in (versus_peers.CABLE, versus_peers.EXACT, versus_peers.ELASTICA)
    ]
