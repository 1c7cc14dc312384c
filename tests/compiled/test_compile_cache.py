"""How kernels are compiled: once for all sizes, kept on disk, made anew where that is damaged."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers_kernels import chain, corner, tree
from helpers_scenes import swing_model
from test_planar import TURNED, mechanism

import skfem_cosserat as sc
from skfem_cosserat.compiled import kept, structures
from skfem_cosserat.compiled.kept import NotKept, Source

pytest.importorskip("numba")
from skfem_cosserat.compiled import jit
from skfem_cosserat.compiled.jit import part


def kernels_of(*names):
    """How many of these kernels this process has, for different kinds."""
    return [sum(key[1] == name for key in kept._ADDRESSES) for name in names]


@pytest.fixture
def elsewhere(monkeypatch, tmp_path):
    """An empty folder for kernels, in a process that has none."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kept, "_ADDRESSES", {})
    return tmp_path


@part
def half(o, flag):
    """A kernel that is compiled in no time: half of some numbers."""
    for k in range(len(o.x)):
        o.x[k] *= 0.5
    return 0.0


named = jit.function_named
jit.function_named = lambda family, name: half if family == "halving" else named(family, name)


def halved(source):
    """By that kernel, from where it may come."""
    x = np.array([2.0, 4.0, 6.0])
    kept.entry("halving", "half", structures.structure("halving", {"x": x}), source)()
    return x.tolist()


@pytest.mark.slow
def test_kernels_are_looked_for_before_they_are_compiled(elsewhere, monkeypatch):
    with pytest.raises(NotKept):
        halved(Source.DISK)
    assert kept.cold("halving", "half")
    assert halved(Source.COMPILER) == [1.0, 2.0, 3.0]
    (file,) = elsewhere.rglob("*.kernel")
    monkeypatch.setitem(sys.modules, "skfem_cosserat.compiled.jit", None)  # cannot be imported
    for _ in range(2):
        assert halved(Source.DISK) == [1.0, 2.0, 3.0]
        kept._ADDRESSES.clear()  # the next one is read
    # nothing that is not whole is read, nor what needs a function that is not there
    whole = file.read_bytes()
    about, code = whole.split(b"\n", 1)
    for wrong in (
        *(b"", whole[:-9], about, code, whole[:-1] + bytes([whole[-1] ^ 1])),
        about.replace(b'"needs": [', b'"needs": ["no_such_function"') + b"\n" + code,
    ):
        file.write_bytes(wrong)
        with pytest.raises(NotKept):
            halved(Source.DISK)
    file.write_bytes(whole)
    assert halved(Source.DISK) == [1.0, 2.0, 3.0]


def test_kernels_of_other_sources_and_processors_are_others(elsewhere, monkeypatch):
    """Code of one file is compiled into functions of another: all of them make up the name."""
    assert halved(Source.COMPILER) == [1.0, 2.0, 3.0]
    (file,) = elsewhere.rglob("*.kernel")
    for name in ("stamp", "_processor"):
        with monkeypatch.context() as other:
            other.setattr(kept, name, lambda: "another")
            kept._ADDRESSES.clear()
            with pytest.raises(NotKept):
                halved(Source.DISK)
            assert halved(Source.COMPILER) == [1.0, 2.0, 3.0]
        assert file.exists() == (name != "stamp")  # older sources are cleared away
        if not file.exists():
            kept._ADDRESSES.clear()
            halved(Source.COMPILER)


def test_a_folder_that_takes_no_files_costs_time_only(elsewhere, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/dev/null/none")
    assert halved(Source.COMPILER) == [1.0, 2.0, 3.0]
    assert not kept.cold("step", "solve") and not kept.promising()  # no helper, no hope


@pytest.mark.slow
def test_processes_compile_a_kernel_once(elsewhere):
    """Of several that start on an empty disk, as the workers of a study, one does; others wait."""
    code = (
        "import sys; sys.path[:] = sys.argv[1:]\n"
        "import test_compile_cache as t\n"
        "t.halved(t.Source.COMPILER)\n"
        "print(len(t.half.signatures))"
    )
    command = [sys.executable, "-c", code, *sys.path]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    counts = [int(each.communicate()[0].split()[-1]) for each in started]
    assert sorted(counts) == [0, 0, 1]
    assert [path.suffix for path in elsewhere.rglob("*") if path.is_file()] == [".kernel"]


def test_a_full_disk_keeps_no_part_of_a_kernel(elsewhere, monkeypatch):
    write = Path.write_bytes

    def full(path, data):
        write(path, data[: len(data) // 2])
        raise OSError("No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert halved(Source.COMPILER) == [1.0, 2.0, 3.0]
    assert not [path for path in elsewhere.rglob("*") if path.is_file()]


def test_a_user_without_a_home(elsewhere, monkeypatch):
    """As in a container: nothing is kept."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)

    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nowhere)
    kept._folder.cache_clear()
    try:
        assert halved(Source.COMPILER) == [1.0, 2.0, 3.0]
        assert not kept.cold("step", "solve") and not kept.promising()  # no helper, no hope
    finally:
        kept._folder.cache_clear()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_fork_while_a_thread_loads_kernels(elsewhere):
    """It had the lock, but not the thread that would give it free."""
    code = (
        "import os, threading, sys; sys.path[:] = sys.argv[1:]\n"
        "import test_compile_cache as t\n"
        "from skfem_cosserat.compiled import kept\n"
        "kept.BINDING.acquire(); kept._LOADING.acquire()\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    with kept.BINDING: os._exit(t.halved(t.Source.COMPILER) != [1.0, 2.0, 3.0])\n"
        "sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, *sys.path]
    assert subprocess.run(command, check=False, timeout=120).returncode == 0


@pytest.mark.parametrize("planar", [None, sc.Planar()], ids=["space", "plane"])
def test_sizes_do_not_compile_again(planar):
    """The same code serves every mesh, section and scene of one order."""
    counts = []
    for scene in (swing_model(4), swing_model(6), mechanism(TURNED, 0.4)):
        run = scene.freeze(planar=planar), sc.EnergyMomentum(), sc.NullSpace(), 5e-3, 0.01
        sc.simulate(*run, kernels="numba", derive=False)
        counts.append(kernels_of("solve", "beam_force", "joint_move"))
    assert counts[0] == counts[1] == counts[2] and min(counts[0]) > 0


@pytest.mark.slow
def test_runs_after_those_of_other_scenes_give_the_same_bits(kernels):
    """Of structures that are nearly the same: what is kept of them is told apart."""
    scenes = [corner(1), tree(1), chain(3), corner(2), tree(2), corner(1)]
    run = sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 4e-3
    found = [sc.simulate(scene, *run, kernels=kernels)["q"] for scene in scenes]
    assert np.array_equal(found[0], found[-1])


@pytest.mark.slow
def test_cold_warm_and_damaged_caches_give_the_same_numbers(tmp_path):
    """The second process compiles nothing; cut files, as of a full disk, cost time only."""
    code = """
import skfem_cosserat as sc
model = sc.Model()
model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
run = sc.Variational(), sc.NullSpace(), 0.1, 0.3
print(sc.simulate(model.freeze(), *run, kernels="numba")["q"].tolist())
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", code]

    def run():
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)

    first = run().stdout
    files = [*tmp_path.rglob("*.kernel")]
    assert len(files) > 5
    made = [path.stat().st_mtime_ns for path in files]
    assert run().stdout == first
    assert made == [path.stat().st_mtime_ns for path in files]
    for path in files:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run().stdout == first


@pytest.mark.slow
def test_kernels_are_compiled_ahead(capsys):
    """By `python -m skfem_cosserat warm`, for beams of the orders that are asked for."""
    from skfem_cosserat.__main__ import main

    assert main(["warm"]) == 0 and capsys.readouterr().out == "kernels are compiled\n"
    assert not kept.cold("step", "solve") and not kept.cold("tree", "begin")
    with pytest.raises(SystemExit):
        main(["warm", "--orders", "high"])
