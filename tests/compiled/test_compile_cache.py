"""How kernels are compiled: once for all sizes, kept on disk, made anew where that is damaged."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
import test_joints
from helpers_kernels import both, chain, corner, tree
from helpers_scenes import swing_model
from test_planar import TURNED, mechanism

import skfem_cosserat as sc
from skfem_cosserat.compiled import warm
from skfem_cosserat.integrators.compiled_step import CompiledStep

pytest.importorskip("numba")


def test_nothing_is_compiled_at_import():
    code = (
        "import sys, skfem_cosserat.compiled.step as s;"
        "sys.exit(any(len(f.signatures) for f in vars(s).values() if hasattr(f, 'signatures')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_sizes_do_not_compile_again():
    """The same code serves every mesh, section and scene of one order."""
    from skfem_cosserat.compiled import elements, step

    both(corner(1), "energy-momentum", "null space", 2e-3, 4e-3)
    before = len(step.solve.signatures), len(elements.beam_force.signatures)
    both(test_joints.scene(sc.JointRevolute)[0], "variational", "null space", 2e-3, 4e-3)
    both(chain(3), "variational", "null space", 2e-3, 4e-3)
    assert (len(step.solve.signatures), len(elements.beam_force.signatures)) == before


def test_kernels_are_looked_for_and_not_compiled(monkeypatch):
    from numba import types

    from skfem_cosserat.compiled import jit

    def plain(x: float) -> float:
        return x + 1.0

    kinds = (types.float64,)
    monkeypatch.setattr(jit._Cache, "_load_overload", lambda *_: None)
    monkeypatch.setattr(jit._Cache, "holds", lambda *_: False)
    monkeypatch.setattr(jit._Cache, "_save_overload", lambda *_: None)
    kernel = jit.jit(plain)
    with pytest.raises(warm.NotKept):
        jit.ready(kernel, kinds, warm.Source.DISK)
    assert not kernel.overloads
    jit.ready(kernel, kinds)
    assert jit.ready(kernel, kinds, warm.Source.DISK).entry_point(2.0) == 3.0


def test_threads_compile_one_after_the_other(monkeypatch):
    """Each started a helper process on an empty cache, and all compiled the same."""
    from skfem_cosserat.compiled import bind

    inside, most = [], []

    @contextmanager
    def compiling(*arguments, **options):
        inside.append(None)
        most.append(len(inside))
        time.sleep(0.05)
        yield
        inside.pop()

    monkeypatch.setattr(bind, "compiling", compiling)
    system, settings = tree(1), sc.NewtonSettings()
    with ThreadPoolExecutor(3) as threads:
        made = [
            threads.submit(CompiledStep, system, sc.EnergyMomentum(), 1e-3, settings)
            for _ in range(3)
        ]
    assert [each.result().method for each in made] == ["blocks"] * 3 and most == [1, 1, 1]


def test_sizes_do_not_compile_again_in_a_plane():
    from skfem_cosserat.compiled import step
    from skfem_cosserat.compiled.plane import elements, tree

    counts = []
    for scene in (swing_model(4), swing_model(6), mechanism(TURNED, 0.4)):
        system = scene.freeze(planar=sc.Planar())
        sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), 5e-3, 0.01, kernels="numba", derive=False
        )
        parts = step.solve, elements.beam_force, tree.joint_move
        counts.append([len(part.signatures) for part in parts])
    assert counts[0] == counts[1] == counts[2]


@pytest.mark.slow
def test_cold_and_warm_caches_give_the_same_numbers(tmp_path):
    """To the last bit; the second process compiles nothing."""
    code = (
        "import sys, hashlib; sys.path[:] = sys.argv[1:]\n"
        "import helpers_kernels as t, skfem_cosserat as sc\n"
        "s = t.tree(2); start = t.moving(s)\n"
        "h = sc.simulate(s, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.1, start=start,"
        " kernels='numba', derive=False)\n"
        "print(hashlib.sha256(h['q'].tobytes() + h['p'].tobytes()).hexdigest())"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    found, files = [], []
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", code, *sys.path],
            env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        found.append(run.stdout)
        files.append(sorted(path.name for path in tmp_path.rglob("*.nbc")))
    assert found[0] == found[1] and len(found[0]) > 60
    assert files[0] == files[1]


def test_the_cache_knows_all_sources():
    """Code of one file is compiled into functions of another: all of them make up the key."""
    from skfem_cosserat.compiled import jit, step, tree

    both(corner(1), "energy-momentum", "null space", 2e-3, 4e-3)
    for function in (step.solve, tree.joint_move):
        cache = function._cache
        assert type(cache).__name__ == "_Cache"
        codegen = function.targetctx.codegen()
        assert jit.STAMP in cache._index_key(function.signatures[0], codegen)
        assert list(Path(cache.cache_path).glob("*.nbi"))


@pytest.mark.slow
def test_damaged_cache_is_made_anew(tmp_path):
    """Cut files of the compile cache, as of a full disk or a killed process, cost time only."""
    code = """
import skfem_cosserat as sc
model = sc.Model()
model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
run = sc.Variational(), sc.NullSpace(), 0.1, 0.3
print(sc.simulate(model.freeze(), *run, kernels="numba")["q"][-1])
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", code]

    def run():
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)

    first = run().stdout
    files = [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert files
    for path in files:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run().stdout == first
    assert run().stdout == first
    for path in tmp_path.rglob("*.nbi"):  # of a version with other modules
        path.write_bytes(path.read_bytes().replace(b"compiled.structures", b"compiled.structurez"))
    assert run().stdout == first


@pytest.mark.slow
def test_all_parts_are_compiled_ahead(monkeypatch, capsys):
    """By `python -m skfem_cosserat warm`, for beams of the orders that are asked for."""
    from skfem_cosserat.__main__ import main
    from skfem_cosserat.compiled import bind
    from skfem_cosserat.compiled.numbers import BEAM_PARTS, TREE_PARTS

    asked = {"tree": set(), "plane": set()}
    orders = set()
    given = bind.addresses

    def addresses(names, structures, family="tree", *source, **options):
        asked[family] |= set(names)
        beams = structures[-1]
        orders.update(len(g._values[0][0]) - 1 for g in getattr(beams, "members", [beams]))
        return given(names, structures, family, *source, **options)

    monkeypatch.setattr(bind, "addresses", addresses)
    assert main(["warm"]) == 0 and capsys.readouterr().out == "kernels are compiled\n"
    # only scenes in a plane end with forces by rows in space
    assert asked["tree"] == {*TREE_PARTS, *BEAM_PARTS} - {"beam_finish"}
    in_space = {"load", "couple", "hold", "beam_start", "beam_energy"}
    flow = {name for name in TREE_PARTS if name.startswith("flow")}
    assert {*TREE_PARTS, *BEAM_PARTS} - asked["plane"] <= in_space | flow
    assert orders == {1}
    with pytest.raises(SystemExit):
        main(["warm", "--orders", "high"])
