"""History: container, streaming writer, and a file format that survives kills and tells of harm."""

from __future__ import annotations

import logging
import os
import pickle
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import History, HistoryError, IncompleteWarning, InputError, StorageError
from skfem_cosserat.history import HistoryWriter, file, read_meta

HERE = Path(__file__).resolve().parents[1]
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


def test_rows_that_are_expected_are_written_to_one_array(make_scene):
    """Memory for them is taken once; more rows than that are no error."""
    scene = make_scene()
    writer = HistoryWriter(scene.meta, scene.static, block=2, expected=11)
    for k in range(11):
        writer.append(scene.row(k))
    first = writer.history()
    bases = {id(first["q"].base), id(writer.history()["q"].base)}
    assert len(bases) == 1 and None not in bases
    for k in range(3):
        writer.append(scene.row(k))
    assert len(first) == 11 and len(writer.history()) == 14
    np.testing.assert_array_equal(writer.history()["q"][:11], first["q"])


def test_a_history_of_an_open_writer_stays_as_it_is(make_scene, tmp_path):
    """The memory of a streamed block is written to again."""
    scene = make_scene()
    writer = HistoryWriter(scene.meta, scene.static, path=tmp_path / "run.history", block=3)
    for k in range(2):
        writer.append(scene.row(k))
    first = writer.history()
    before = first["q"].copy()
    for k in range(2, 6):
        writer.append(scene.row(k))
    np.testing.assert_array_equal(first["q"], before)
    writer.close()


def test_writer_refuses(make_scene, tmp_path):
    scene = make_scene()
    writer = HistoryWriter(scene.meta, scene.static)
    row = scene.row(0)
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
    assert len(writer) == len(writer.history()) == 1
    writer.close()
    for call in (lambda: writer.append(row), writer.close):
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
    with pytest.raises(ValueError, match="read-only"):  # others follow from them
        loaded["q"][0] = 1.0
    loaded.static["extra"][0] = 1
    assert os.listdir(tmp_path) == ["run.history"]
    loaded.truncated(0).save(tmp_path / "run.history")  # over an older one
    empty = History.load(tmp_path / "run.history")
    assert len(empty) == 0
    assert empty["q"].shape == (0, history["q"].shape[1])
    assert empty["label"].dtype == history["label"].dtype


def test_save_in_several_blocks(tmp_path, monkeypatch, make_scene):
    monkeypatch.setattr("skfem_cosserat.history.file.SAVE_BYTES", 20_000)
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
    with pytest.raises(HistoryError, match=r"an array of type '.O8'"):
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
            with pytest.warns(IncompleteWarning, match=f"{n} states recovered"):
                history = History.load(path, recover=True)
            assert (len(history), history.status) == (n, "killed")
            assert f"{n} states recovered" in history.meta["warnings"][0]["text"]
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


# each damaged file gives a warning of its own
@pytest.mark.filterwarnings("ignore::skfem_cosserat.IncompleteWarning")
def test_every_flipped_byte_is_noticed(tmp_path):
    """And costs no more than the block it is in."""
    path = tmp_path / "run.history"
    with HistoryWriter({"step": 0.1}, {"a": np.arange(2.0)}, path, block=1) as writer:
        for k in range(3):
            writer.append({"t": 0.1 * k, "step": k, "q": np.zeros(1), "p": np.ones(1)})
    whole = path.read_bytes()
    blocks = [i for i in range(len(whole)) if whole.startswith(b"BLOCK ", i)]
    for i in range(len(whole)):
        for bit in (1, 128):
            path.write_bytes(whole[:i] + bytes([whole[i] ^ bit]) + whole[i + 1 :])
            with pytest.raises(HistoryError, match=r"run\.history"):
                History.load(path)
            if i < MAGIC or HEAD <= i < blocks[1]:
                continue
            with pytest.warns(IncompleteWarning, match="states recovered"):
                part = History.load(path, recover=True)
            lost = [k for k in range(3) if blocks[k + 1] <= i < blocks[k + 2]]
            assert part["step"].tolist() == [k for k in range(3) if k not in lost]
            assert part.meta.get("missing", []) == [[k, k] for k in lost]
            assert part.status == ("completed" if i < blocks[4] else "killed")


def flipped(path, place):
    data = bytearray(path.read_bytes())
    data[place] ^= 4
    path.write_bytes(data)


def long_history(states, instants=20_000):
    """With sensors, two segments and an event."""
    t = 0.01 * np.arange(states)
    static = {"outline": np.arange(8.0)}
    series = {
        "t": t,
        "step": np.arange(states),
        "q": np.outer(t, np.ones(3)),
        "p": np.ones((states, 3)),
    }
    meta = {
        "status": "completed",
        "sensors": {"tip": {"unit": "m", "derivative": 0}},
        "segments": [{"row": 0}, {"row": 650}],
        "events": [sc.history.EventRecord(6.5, "catch", 0.0, 649, 649, 0.0, "stop")._asdict()],
    }
    seen = np.linspace(0, t[-1], instants)
    sensors = {"tip/t": seen, "tip/x": np.outer(seen, [1.0, 2.0])}
    return History(meta, static, series, sensors)


def test_a_flipped_bit_takes_at_most_a_hundred_states(tmp_path):
    path, history = tmp_path / "run.history", long_history(1030)
    history.save(path)
    whole = path.read_bytes()
    assert_equal(history, History.load(path))
    for place in range(60, len(whole), len(whole) // 23):
        path.write_bytes(whole)
        flipped(path, place)
        with pytest.raises(HistoryError, match=r"recover=True gives (9|10)\d\d states"):
            History.load(path)
        with pytest.warns(IncompleteWarning, match=r"run\.history.*states recovered"):
            part = History.load(path, recover=True)
        assert 930 <= len(part) <= 1030
        kept = part["step"]
        assert np.array_equal(part["q"], history["q"][kept])
        lost = sorted(set(range(1030)) - set(kept.tolist()))
        ranges = part.meta.get("missing", [])
        assert [k for a, b in ranges for k in range(a, b + 1)] == lost
        (second,) = [start for start, _ in part.segments if start]
        assert part["step"][second] == max(650, 700 * (650 in lost))
        assert part["step"][part.events[0].row] == (649 if 649 not in lost else 599)
        seen = part.sensors["tip"]
        assert len(seen.times) >= 20_000 - 4096
        assert np.array_equal(seen.values[:, 1], 2 * seen.times)
        assert part.static["outline"].tolist() == list(range(8))


def test_it_is_said_which_states_are_missing(tmp_path):
    path = tmp_path / "run.history"
    long_history(1000).save(path)
    data = path.read_bytes()
    blocks = [i for i in range(len(data)) if data.startswith(b"BLOCK ", i)]
    flipped(path, blocks[4] + 8)  # in the header of the fourth block of states
    flipped(path, blocks[8] - 8)  # in the numbers of the seventh
    with pytest.warns(IncompleteWarning) as said:
        History.load(path, recover=True)
    text = str(said[0].message)
    assert "800 states recovered, missing: states 300 to 399 (after t = 2.99 and before t" in text
    assert "states 600 to 699" in text


def test_files_of_the_first_version_still_load(tmp_path):
    """Their blocks do not say which states they hold."""
    from skfem_cosserat.history.file import FileWriter

    path, rows = tmp_path / "run.history", np.arange(30)
    writer = FileWriter(path)
    writer.append({"kind": "head", "meta": {"status": "running"}}, {})
    for part in np.split(rows, 3):
        values = {"t": part * 0.1, "step": part, "q": np.ones((10, 2)), "p": np.ones((10, 2))}
        writer.append({"kind": "rows", "rows": 10}, values)
    writer.append({"kind": "tail", "status": "completed", "meta": {"steps": 29}}, {})
    writer.close()
    history = History.load(path)
    assert history["step"].tolist() == rows.tolist()
    assert (history.status, history.meta["steps"]) == ("completed", 29)
    data = path.read_bytes()
    blocks = [i for i in range(len(data)) if data.startswith(b"BLOCK ", i)]
    flipped(path, blocks[2] + 80)
    with pytest.warns(IncompleteWarning, match=r"an unknown number of states \(after t = 0.9 and"):
        part = History.load(path, recover=True)
    assert part["step"].tolist() == [*range(10), *range(20, 30)]


def rewritten(path, data, k, change):
    """Block `k` of a file with its header and payload changed, and sums that fit."""
    import zlib

    blocks = [i for i in range(len(data)) if data.startswith(b"BLOCK ", i)] + [len(data)]
    line = data[blocks[k] : blocks[k] + 56].split()
    size = int(line[1])
    text, payload = change(
        data[blocks[k] + 56 : blocks[k] + 56 + size], data[blocks[k] + 56 + size : blocks[k + 1]]
    )
    sums = len(text), len(payload), zlib.crc32(text), zlib.crc32(payload)
    block = b"BLOCK %010d %020d %08x %08x\n" % sums + text + payload
    out = data[: blocks[k]] + block + data[blocks[k + 1] :]
    digits = b"%020d" % len(out)
    path.write_bytes(out[:MAGIC] + b"%s %08x\n" % (digits, zlib.crc32(digits)) + out[HEAD:])


def looked_at(history):
    """What a user looks at first."""
    for record in history.sensors.values():
        assert len(record.times) == len(record.values)
    for name in history:
        assert len(history[name]) == len(history)
        history[name].tolist()
    return len(history.segments), len(history.events), repr(history), history.meta


@pytest.mark.parametrize("seed", range(2))
def test_damage_with_right_sums_gives_one_kind_of_error(tmp_path, seed):
    """Bits, bytes, words and values of headers, by whoever computed the sums anew."""
    rng = np.random.default_rng(seed)
    path, history = tmp_path / "run.history", long_history(110, 9)
    history.add_series("label", np.full(110, "äb"))
    history.add_series("flag", np.arange(110) % 2 == 0)
    history.save(path)
    data = path.read_bytes()
    words = [b"null", b"-1", b"1e400", b"[]", b"{}", b'"x"', b"true", b"9" * 400, b"[" * 3000]

    def change(text, payload):
        kind = rng.integers(5)
        if kind == 0 and payload:
            bad = bytearray(payload)
            for _ in range(20):
                bad[rng.integers(len(bad))] = rng.integers(256)
            return text, bytes(bad)
        if kind == 1:
            bad = bytearray(text)
            bad[rng.integers(len(bad))] ^= 1 << rng.integers(8)
            return bytes(bad), payload
        tokens = re.findall(rb'"[^"]*"|[\w.+-]+|\W', text)
        places = [k for k, token in enumerate(tokens) if re.match(rb'["\w-]', token)]
        one, two = rng.choice(places, 2)
        if kind == 2:
            tokens[one], tokens[two] = tokens[two], tokens[one]
        elif kind == 3:
            tokens[one] = words[rng.integers(len(words))]
        else:
            del tokens[one : one + rng.integers(1, 4)]
        return b"".join(tokens), payload

    refused = 0
    for _ in range(120):
        rewritten(path, data, rng.integers(data.count(b"BLOCK ")), change)
        for recover in (False, True):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", IncompleteWarning)
                    looked_at(History.load(path, recover))
            except HistoryError as error:  # no other one
                refused += "run.history" in str(error)
    assert refused > 60


# -- full disks ------------------------------------------------------------------------------


@pytest.fixture
def disk(monkeypatch):
    """A disk that takes so many more bytes; ``disk(None)`` takes all."""
    from skfem_cosserat.history.file import FileWriter

    write, left = FileWriter._write, [np.inf]

    def limited(self, offset, data):
        fits = int(min(left[0], len(data)))
        write(self, offset, data[:fits])  # part of it is written, as in truth
        left[0] -= fits
        if fits < len(data):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(FileWriter, "_write", limited)
    return lambda size: left.__setitem__(0, np.inf if size is None else size)


@pytest.mark.parametrize("room", [None, 0, 10_000, 30_000, 60_000])
@pytest.mark.parametrize("streamed", [False, True])
def test_several_states_at_once_are_the_same_ones(make_scene, tmp_path, disk, streamed, room):
    """Across blocks; a disk that gets full in their midst is told after all are recorded."""
    scene, path = make_scene(), tmp_path / "run.history"
    writer = HistoryWriter(scene.meta, scene.static, path if streamed else None, 10)
    rows = [scene.row(k) for k in range(25)]
    disk(room)
    writer.append(rows[0])
    for part in (rows[1:8], rows[8:24]):
        arrays = {name: np.array([row[name] for row in part]) for name in part[0]}
        try:
            writer.extend(arrays)
        except StorageError as error:
            assert streamed and room is not None
            assert_equal(scene.history(part[-1]["step"] + 1), error.history)
    for odd in ({**arrays, "q": arrays["q"][:, 1:]}, {**arrays, "t": arrays["step"]}):
        with pytest.raises(InputError, match="as in the first row"):
            writer.extend(odd)
    with pytest.raises(InputError, match="row entry 'q': is missing"):
        writer.extend({name: array for name, array in arrays.items() if name != "q"})
    try:
        writer.append(rows[24])
    except StorageError:
        assert streamed and room is not None
    assert len(writer) == 25
    assert_equal(scene.history(25), writer.history())
    disk(None)
    writer.close()


@pytest.mark.parametrize("room", [0, 10_000, 30_000, 60_000, 68_500])
def test_a_full_disk_loses_nothing(make_scene, tmp_path, disk, room):
    scene, path = make_scene(), tmp_path / "run.history"
    writer = HistoryWriter(scene.meta, scene.static, path, 10)
    disk(room)

    def record():
        for k in range(25):
            writer.append(scene.row(k))
        writer.close()

    with pytest.raises(StorageError, match=r"run\.history.*No space left") as caught:
        record()
    error = caught.value
    assert isinstance(error, OSError) and error.errno == 28 and error.path == str(path)
    count = len(error.history)
    assert error.time == error.history.times[-1] == scene.row(count - 1)["t"]
    assert_equal(scene.history(count), error.history)
    disk(None)
    kept = History.load(path)  # what was written is sound
    assert f"{len(kept)} states are in the file, all states in .history" in str(error)
    if not writer.closed:  # it goes on in memory, and says nothing more
        for k in range(count, 25):
            writer.append(scene.row(k))
        writer.close()
    assert_equal(scene.history(25), writer.history())
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.time) == (str(error), error.time)


def test_a_disk_that_is_full_at_once_is_refused(tmp_path, disk):
    for room in (0, 60):
        disk(room)
        with pytest.raises(InputError, match=r"run\.history.*cannot be written: No space"):
            HistoryWriter({}, {"a": np.zeros(100)}, tmp_path / "run.history")


@pytest.mark.parametrize("part", [0.5, 0.9])
def test_saving_to_a_full_disk(make_scene, tmp_path, disk, part):
    history, path = make_scene().history(60), tmp_path / "run.history"
    history.save(path)
    before = path.read_bytes()
    disk(int(part * len(before)))
    with pytest.raises(StorageError, match="what was there before is as it was") as caught:
        history.save(path)
    assert caught.value.history is history
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["run.history"]


def falling():
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    return model.freeze(), {"place": sc.SensorPosition(ball.place())}


@pytest.mark.parametrize("part", [0.3, 0.6, 0.999, 1.5])
def test_a_run_on_a_full_disk_keeps_its_history(tmp_path, disk, part):
    """In a step, at the end, and when all is written again with energies."""
    system, sensors = falling()
    path = tmp_path / "run.history"

    def run(**more):
        return sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 2.0, sensors=sensors, **more
        )

    truth = run(path=path, derive=False)
    disk(int(part * path.stat().st_size))
    with pytest.raises(StorageError, match="No space left on device") as caught:
        run(path=path)
    history = caught.value.history
    assert caught.value.time == pytest.approx(history.times[-1], abs=0.011)
    if part < 1:  # the run adds the state that it was at, so no number of all is said
        disk(None)
        kept = len(sc.History.load(path))
        assert f"; {kept} states are in the file, all states" in str(caught.value)
    whole = len(history) == 201
    assert whole == (part > 0.9) and "energy" in history
    assert history.status == ("completed" if whole else "failed")
    assert len(history) > 50
    assert np.array_equal(history["q"], truth["q"][: len(history)])
    seen = history.sensors["place"].values
    assert len(seen) >= len(history)
    assert np.array_equal(seen, truth.sensors["place"].values[: len(seen)])


def test_a_path_on_a_full_disk_keeps_its_points(tmp_path, disk):
    model = sc.Model()
    box = model.add("box", sc.RigidBody.box(1.0, (1, 1, 1)))
    model.add("bed", sc.Bushing(sc.ground((0, 0, 0)), box.at((0, 0, 0)), 100 * np.eye(6)))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    disk(8_000)
    with pytest.raises(StorageError) as caught:
        sc.static(model.freeze(), sc.NullSpace(), path=tmp_path / "path.history")
    assert caught.value.history["load_factor"][-1] == 1.0


def test_a_file_that_cannot_be_begun_leaves_what_was_there(tmp_path, disk):
    disk(10)
    old, new = tmp_path / "old.history", tmp_path / "new.history"
    old.touch()  # or a device, such as /dev/full
    for path in (old, new):
        with pytest.raises(InputError, match="cannot be written"):
            file.FileWriter(path)
    assert old.exists() and not new.exists()


def test_an_error_of_a_callback_stays_what_it_is_on_a_full_disk(tmp_path, disk):
    system, _ = falling()

    def fail(report):
        if report.state.index == 20:
            disk(0)
            raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine") as caught:
        sc.simulate(
            *(system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 3.0),
            callbacks=[fail],
            path=tmp_path / "run.history",
        )
    assert len(caught.value.history) == 21
    assert any("No space" in note for note in caught.value.__notes__)


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")
def test_a_limit_of_the_system(make_scene, tmp_path):
    """The system's own refusal, as a quota or a full disk gives it."""
    import resource

    scene, path = make_scene(), tmp_path / "run.history"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
    try:
        with pytest.raises(StorageError, match=r"run\.history.*at t = 2\.?.*: File too large"):
            stream(scene, path, 40).close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(History.load(path)) == 10


def test_each_block_of_a_long_history_is_read_once(tmp_path, monkeypatch):
    read, times = file._arrays, []
    monkeypatch.setattr(file, "_arrays", lambda *a: times.append(a[1].start) or read(*a))
    with HistoryWriter({}, {}, tmp_path / "run.history") as writer:
        q = np.zeros(250)
        for k in range(5000):
            writer.append({"t": 0.1 * k, "step": k, "q": q, "p": q})
    assert len(History.load(tmp_path / "run.history")) == 5000
    assert len(set(times)) == len(times) >= 50


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"step": 1e-300}, "argument step: 1e-300 s gives 5e.299 steps"),
        ({"step": 10**400}, "step = 1000.*, expected a positive finite number"),
        ({"until": 10**400}, "until = 1000.*, expected a finite number of seconds"),
        ({"until": 10**15}, "argument step: 0.1 s gives 1e.16 steps"),
        ({"at": [10**400]}, "argument at: at = .*, too large for a number"),
    ],
)
def test_runs_of_huge_numbers_are_refused_at_once(change, words):
    system, _ = falling()
    with pytest.raises(InputError, match=words):
        sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), **{"step": 0.1, "until": 0.5} | change
        )


def test_a_history_of_version_0_1_is_read_and_gone_on_with():
    """data/run_of_0.1.history: the scene below, five steps, written by the last commit of 0.1."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    section = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 0, 1)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("pin", pin)
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0)))
    system, scheme = model.freeze(), (sc.EnergyMomentum(), sc.NullSpace(), 1e-2)
    old = History.load(Path(__file__).parents[1] / "data" / "run_of_0.1.history")
    assert old.meta["versions"]["skfem_cosserat"] == "0.1.0" and len(old) == 6
    new = sc.simulate(system, *scheme, 0.05, kernels="numpy")
    before = [name for name in old.series if name != "constraint_point"]  # forces at midpoints
    since = ("at_jump", "doubtful_step", "dissipated_by_scheme")
    assert [name for name in new.series if name not in since] == before
    assert np.allclose(new["q"], old["q"], rtol=0, atol=1e-12)
    end = rod.node("rod.end")
    assert np.allclose(new.position(end), old.position(end), rtol=0, atol=1e-12)
    start = sc.restart(system, old, *scheme[::2])
    on = sc.simulate(system, *scheme, 0.1, start=start, kernels="numpy")
    whole = sc.simulate(system, *scheme, 0.1, kernels="numpy")
    assert np.allclose(on["q"][-1], whole["q"][-1], rtol=0, atol=1e-11)
