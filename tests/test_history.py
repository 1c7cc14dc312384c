"""History: container, streaming writer, and a file format that survives kills and tells of harm."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from skfem_cosserat.errors import HistoryError, InputError
from skfem_cosserat.history import History, HistoryWriter, read_meta

HERE = Path(__file__).resolve().parent
MAGIC = len(b"SKFEM-COSSERAT HISTORY 1\n")
HEAD = MAGIC + 30


def assert_equal(a: History, b: History, n: int | None = None):
    assert a.static.keys() == b.static.keys()
    assert a.series.keys() == b.series.keys()
    for name, value in a.static.items():
        np.testing.assert_array_equal(value, b.static[name])
        assert value.dtype == b.static[name].dtype
    for name, value in a.series.items():
        np.testing.assert_array_equal(value[:n], b.series[name])
        assert value.dtype == b.series[name].dtype


def stream(scene, path, states, block=10):
    writer = HistoryWriter(scene.meta, scene.static, path, block)
    for k in range(states):
        writer.append(scene.row(k))
    return writer


# -- container -------------------------------------------------------------------------------


def test_container(make_scene):
    history = make_scene().history(7)
    assert len(history) == 7
    assert history.status == "completed"
    np.testing.assert_allclose(history.times, 0.1 * np.arange(7), rtol=1e-15)
    assert history["q"].shape == history["p"].shape
    assert history["step"].dtype == np.int64
    assert history.last()["t"] == history.row(6)["t"] == history.times[-1]
    history.row(0)["q"][:] = 7.0  # rows are copies
    assert not (history["q"][0] == 7.0).any()
    cut = history.truncated(3)
    assert len(cut) == 3
    assert len(history.truncated(0)) == 0
    cut.add_series("drift", np.zeros((3, 2)))
    assert "drift" in cut
    assert "drift" not in history
    assert "7 states" in repr(history)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda h: h["nothing"], "nothing"),
        (lambda h: h.add_series("x", np.zeros(4)), "x"),
        (lambda h: h.add_series("x", 3.0), "x"),
        (lambda h: h.add_series("q", np.zeros((3, 1))), "q"),
        (lambda h: h.add_series("x", [None, None, None]), "object"),
        (lambda h: h.row(3), "3 states"),
        (lambda h: h.row(-4), "3 states"),
        (lambda h: h.truncated(4), "argument n"),
        (lambda h: h.truncated(0).last(), "0 states"),
        (lambda h: History({"a": {1: 2}}, {}, h.series), r"meta\['a'\]"),
        (lambda h: History({"a": [Path()]}, {}, h.series), r"meta\['a'\]\[0\]"),
        (lambda h: History({}, {}, {"t": [1.0], "q": [[1.0]]}), "step, p"),
    ],
)
def test_container_refuses(make_scene, call, words):
    with pytest.raises(InputError, match=words):
        call(make_scene().history(3))


# -- writer ----------------------------------------------------------------------------------


@pytest.mark.parametrize("states", [0, 1, 9, 10, 11, 20, 25])
@pytest.mark.parametrize("streamed", [False, True])
def test_writer_any_number_of_rows(make_scene, tmp_path, states, streamed):
    scene, path = make_scene(), tmp_path / "run.history" if streamed else None
    writer = stream(scene, path, states)
    assert len(writer) == len(writer.history()) == states
    assert writer.history().status == "running"
    writer.close(steps=states)
    history = writer.history()
    assert (history.status, history.meta["steps"]) == ("completed", states)
    for k in range(states):
        for name, value in scene.row(k).items():
            np.testing.assert_array_equal(history[name][k], value)
    if path:
        assert_equal(history, History.load(path))
        assert History.load(path).meta == history.meta


@pytest.mark.parametrize("streamed", [False, True])
def test_amend_changes_the_last_row_only(make_scene, tmp_path, streamed):
    scene, path = make_scene(), tmp_path / "run.history" if streamed else None
    writer = HistoryWriter(scene.meta, scene.static, path, block=5)
    for k in range(11):  # also at the last row of a block, which must wait for the next append
        writer.append(scene.row(k))
        writer.amend(energy=float(k), **{"joint/pin/force": np.full(3, float(k))})
    writer.close()
    history = writer.history()
    np.testing.assert_array_equal(history["energy"], np.arange(11.0))
    np.testing.assert_array_equal(history["joint/pin/force"][:, 2], np.arange(11.0))


def test_writer_refuses(make_scene, tmp_path):
    scene = make_scene()
    writer = HistoryWriter(scene.meta, scene.static)
    row = scene.row(0)
    with pytest.raises(InputError, match="no row"):
        writer.amend(energy=1.0)
    with pytest.raises(InputError, match="misses p"):
        writer.append({name: value for name, value in row.items() if name != "p"})
    writer.append(row)
    for change, words in [
        ({"q": row["q"][:-1]}, "'q'.*shape"),
        ({"step": 1.0}, "'step'.*float64.*int64"),
        ({"new": 1.0}, "'new'.*is new"),
        ({"energy": None}, "'energy'.*object"),
    ]:
        with pytest.raises(InputError, match=words):
            writer.append({**row, **change})
    short = {name: value for name, value in row.items() if name != "energy"}
    with pytest.raises(InputError, match=r"'energy'.*missing"):
        writer.append(short)
    with pytest.raises(InputError, match="'other'"):
        writer.amend(other=1.0)
    with pytest.raises(InputError, match=r"'energy'.*shape"):
        writer.amend(energy=np.zeros(2))
    assert len(writer) == len(writer.history()) == 1
    writer.close()
    for call in (lambda: writer.append(row), lambda: writer.amend(energy=1.0), writer.close):
        with pytest.raises(InputError, match="closed"):
            call()
    with pytest.raises(InputError, match="block"):
        HistoryWriter({}, {}, block=0)
    with pytest.raises(InputError, match="static array 'a'"):
        HistoryWriter({}, {"a": [object()]})


def test_context_manager_says_how_it_ended(make_scene, tmp_path):
    scene, path = make_scene(), tmp_path / "run.history"
    with HistoryWriter({}, {}, path) as writer:
        writer.append(scene.row(0))
    assert read_meta(path) == {"status": "completed", "states": 1}

    def interrupted_run():
        with HistoryWriter({}, {}, path) as writer:
            writer.append(scene.row(0))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_run()
    assert History.load(path).status == "interrupted"
    with HistoryWriter({}, {}, path) as writer:
        writer.append(scene.row(0))
        writer.close("diverged", reason="too fast")
    assert read_meta(path) == {"status": "diverged", "reason": "too fast", "states": 1}


def test_only_the_current_block_is_in_memory(tmp_path):
    import tracemalloc

    zeros = np.zeros(10_000)
    tracemalloc.start()
    with HistoryWriter({}, {}, tmp_path / "run.history", block=5) as writer:
        for k in range(100):
            writer.append({"t": 0.1 * k, "step": k, "q": zeros, "p": zeros})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (tmp_path / "run.history").stat().st_size > 100 * 2 * zeros.nbytes
    assert peak < 0.3 * 100 * 2 * zeros.nbytes


# -- files -----------------------------------------------------------------------------------


def test_save_and_load_keep_everything(make_scene, tmp_path):
    history = make_scene().history(5)
    history.add_series("work", np.arange(10.0).reshape(5, 2))
    history.add_series("label", np.array(["a", "b", "ccc", "", "e"]))
    history.add_series("flag", np.array([True, False, True, False, True]))
    history.add_series("none", np.zeros((5, 0)))
    history.add_series("complex", np.array([1j, 2, np.inf, -0.0, 5e-324]))
    history.static["extra"] = np.arange(3, dtype=np.int32)
    history.static["big"] = np.arange(3.0, dtype=">f8").astype("<f8")
    history.meta |= {"note": "äöü ✓", "nan": float("nan"), "inf": [-float("inf")], "none": None}
    history.meta["tuple"] = (1, np.float32(0.5), np.arange(2))
    history.save(tmp_path / "run.history")
    loaded = History.load(tmp_path / "run.history")
    assert_equal(history, loaded)
    assert np.isnan(loaded.meta["nan"])
    assert loaded.meta["inf"] == [-np.inf]
    assert loaded.meta["tuple"] == [1, 0.5, [0, 1]]
    assert (loaded.meta["note"], loaded.status) == ("äöü ✓", "completed")
    loaded["q"][0] = 1.0  # arrays can be changed
    loaded.static["extra"][0] = 1
    assert os.listdir(tmp_path) == ["run.history"]
    loaded.truncated(0).save(tmp_path / "run.history")  # over an older one
    empty = History.load(tmp_path / "run.history")
    assert len(empty) == 0
    assert empty["q"].shape == (0, history["q"].shape[1])
    assert empty["label"].dtype == history["label"].dtype


def test_save_in_several_blocks(tmp_path, monkeypatch, make_scene):
    monkeypatch.setattr("skfem_cosserat.history.file._SAVE_BYTES", 20_000)
    history = make_scene().history(60)
    history.save(tmp_path / "run.history")
    assert (tmp_path / "run.history").read_bytes().count(b'"kind": "rows"') > 5
    assert_equal(history, History.load(tmp_path / "run.history"))


def test_nothing_is_left_of_a_failed_save(tmp_path, make_scene, monkeypatch):
    history = make_scene().history(2)
    path = tmp_path / "run.history"
    history.save(path)
    before = path.read_bytes()
    history.meta["bad"] = object()
    with pytest.raises(InputError, match="bad"):
        history.save(path)
    del history.meta["bad"]

    def no_space(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("skfem_cosserat.history.file.FileWriter.sync", no_space)
    with pytest.raises(OSError, match="No space"):
        history.save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["run.history"]


def test_bad_places_are_named_before_any_work(make_scene, tmp_path):
    history = make_scene().history(1)
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "no" / "run.history", tmp_path / "file" / "run.history", tmp_path):
        for call in (history.save, lambda path: HistoryWriter({}, {}, path)):
            with pytest.raises(InputError) as caught:
                call(path)
            assert str(path) in str(caught.value)
            assert ".tmp" not in str(caught.value)
        with pytest.raises(HistoryError, match="cannot be read"):
            History.load(path)


def test_no_pickle(tmp_path):
    """A file that asks for objects is refused, whatever its checksums say."""
    import zlib

    from skfem_cosserat.history.file import FileWriter

    path = tmp_path / "run.history"
    writer = FileWriter(path)
    writer.append({"kind": "head", "meta": {}}, {"a": np.zeros(1)})
    writer.close()
    data = path.read_bytes()
    old = data[HEAD + 56 :]
    text = old[:-8].replace(b'"<f8"', b'"|O8"')
    line = b"BLOCK %010d %020d %08x %08x\n" % (len(text), 8, zlib.crc32(text), zlib.crc32(bytes(8)))
    path.write_bytes(data[:HEAD] + line + text + bytes(8))
    with pytest.raises(HistoryError, match="type object"):
        History.load(path)


RUN = """
import sys
from conftest import Scene
from skfem_cosserat.history import HistoryWriter
scene = Scene()
writer = HistoryWriter(scene.meta, scene.static, sys.argv[1], block=7)
k = 0
while True:
    writer.append(scene.row(k))
    k += 1
"""


def start(code: str, *args: str) -> subprocess.Popen:
    path = os.pathsep.join([str(HERE), str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-c", code, *args], env={**os.environ, "PYTHONPATH": path}
    )


def test_killed_run_can_be_read(make_scene, tmp_path):
    path = tmp_path / "run.history"
    process = start(RUN, str(path))
    try:
        limit = time.monotonic() + 30.0
        while not path.exists() or path.stat().st_size < 200_000:
            assert process.poll() is None
            assert time.monotonic() < limit
            time.sleep(0.01)
        assert read_meta(path)["status"] == "killed"  # cannot be told from a run that goes on
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    history = History.load(path)
    assert history.status == "killed"
    assert len(history) >= 14
    assert len(history) % 7 == 0
    assert read_meta(path)["states"] == len(history)
    scene = make_scene()
    for k in (0, len(history) - 1):
        for name, value in scene.row(k).items():
            np.testing.assert_array_equal(history[name][k], value)


def test_uncommitted_bytes_are_ignored(make_scene, tmp_path, caplog):
    """Whatever a killed writer left behind its last committed block."""
    scene, path = make_scene(), tmp_path / "run.history"
    stream(scene, path, 25)._file.close()  # two blocks are committed, no tail
    whole = path.read_bytes()
    for rest in (b"BL", b"BLOCK 0000000100 00000000000000001000 00000000", bytes(1000)):
        path.write_bytes(whole + rest)
        caplog.clear()
        with caplog.at_level(logging.INFO, "skfem_cosserat"):
            history = History.load(path)
        assert len(history) == 20
        assert history.status == "killed"
        assert f"{len(rest)} uncommitted bytes" in caplog.text


def test_file_cut_short(make_scene, tmp_path):
    scene, path = make_scene(), tmp_path / "run.history"
    writer = stream(scene, path, 25)
    writer.close()
    whole = path.read_bytes()
    blocks = [i for i in range(len(whole)) if whole.startswith(b"BLOCK ", i)]
    sound = scene.history(25)
    states = {1: 0, 2: 10, 3: 20, 4: 25}
    for k, n in states.items():
        for cut in (blocks[k], blocks[k] + 30):
            path.write_bytes(whole[:cut])
            with pytest.raises(HistoryError) as caught:
                History.load(path)
            message = str(caught.value)
            for word in (str(path), f"{cut} bytes found", f"{len(whole)} bytes expected"):
                assert word in message
            assert f"recover=True gives {n} states" in message
            history = History.load(path, recover=True)
            assert (len(history), history.status) == (n, "killed")
            if n:
                assert_equal(sound, history, n)
            with pytest.raises(HistoryError, match="cut short"):
                read_meta(path)
    path.write_bytes(whole[: blocks[1] - 1])  # not even the head
    for recover in (False, True):
        with pytest.raises(HistoryError, match=r"cut short.*nothing can be recovered"):
            History.load(path, recover=recover)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"SKFEM", "not a history"),
        (b"PK\x03\x04" + bytes(100), "not a history"),
        (b"SKFEM-COSSERAT HISTORY 2\n" + bytes(100), "version '2'"),
        (b"SKFEM-COSSERAT HISTORY 1\n", "nothing can be recovered"),
    ],
)
@pytest.mark.parametrize("recover", [False, True])
def test_not_our_file(tmp_path, data, words, recover):
    path = tmp_path / "run.history"
    path.write_bytes(data)
    with pytest.raises(HistoryError, match=words) as caught:
        History.load(path, recover=recover)
    assert str(path) in str(caught.value)
    with pytest.raises(HistoryError):
        History.load(tmp_path / "missing")


def test_every_flipped_byte_is_noticed(tmp_path):
    path = tmp_path / "run.history"
    with HistoryWriter({"step": 0.1}, {"a": np.arange(2.0)}, path, block=1) as writer:
        for k in range(3):
            writer.append({"t": 0.1 * k, "step": k, "q": np.zeros(1), "p": np.ones(1)})
    whole = path.read_bytes()
    sound = History.load(path)
    head_end = whole.index(b"BLOCK ", HEAD + 1)
    for i in range(len(whole)):
        for bit in (1, 128):
            path.write_bytes(whole[:i] + bytes([whole[i] ^ bit]) + whole[i + 1 :])
            with pytest.raises(HistoryError, match=r"run\.history"):
                History.load(path)
        if MAGIC <= i < HEAD or i >= head_end:
            part = History.load(path, recover=True)
            assert len(part) == 3 or i >= head_end
            if len(part):
                assert_equal(sound, part, len(part))


def test_long_history_loads_fast(tmp_path):
    with HistoryWriter({}, {}, tmp_path / "run.history") as writer:
        q = np.zeros(250)
        for k in range(5000):
            writer.append({"t": 0.1 * k, "step": k, "q": q, "p": q})
    begin = time.perf_counter()
    assert len(History.load(tmp_path / "run.history")) == 5000
    assert time.perf_counter() - begin < 2.0
