"""History: container, streaming writer, and a file format that survives kills and tells of harm."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import sqlite3
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import History, HistoryError, IncompleteWarning, InputError, StorageError
from skfem_cosserat.history import HistoryWriter, read_meta
from skfem_cosserat.history.file import FileWriter


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
    cut = history.truncated(3)
    assert len(cut) == 3
    assert len(history.truncated(0)) == 0
    cut.add_series("drift", np.zeros((3, 2)))
    assert "drift" in cut
    assert "drift" not in history
    assert "7 states" in repr(history)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda h: h["nothing"], "nothing"),
        (lambda h: h.add_series("x", np.zeros(4)), "x"),
        (lambda h: h.add_series("q", np.zeros((3, 1))), "q"),
        (lambda h: h.add_series("x", [None, None, None]), "object"),
        (lambda h: h.row(3), "3 states"),
        (lambda h: h.truncated(4), "argument n"),
        (lambda h: h.truncated(0).last(), "0 states"),
        (lambda h: History({"a": [Path()]}, {}, h.series), r"meta\['a'\]\[0\]"),
        (lambda h: History({}, {}, {"t": [1.0], "q": [[1.0]]}), "step, p"),
    ],
)
def test_container_refuses(make_scene, call, words):
    with pytest.raises(InputError, match=words):
        call(make_scene().history(3))


# -- writer ----------------------------------------------------------------------------------


@pytest.mark.parametrize("states", [0, 1, 10, 25])
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
    history.add_series("complex", np.array([1j, 2, np.inf, -0.0, 5e-324]))
    history.static["extra"] = np.arange(3, dtype=np.int32)
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
    assert os.listdir(tmp_path) == ["run.history"]
    loaded.truncated(0).save(tmp_path / "run.history")  # over an older one
    empty = History.load(tmp_path / "run.history")
    assert empty["q"].shape == (0, history["q"].shape[1])


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


def changed(path, statement, *values):
    """The file with an SQL statement done."""
    with contextlib.closing(sqlite3.connect(path)) as db, db:
        db.execute(statement, values)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("dtype = '|O8'", r"array 1: type \|O8"),  # no pickle
        ("shape = '[99999999999]'", "of another size"),  # no more memory than the file has bytes
        ("rows = 99999999999", "of another size"),
        ("data = zeroblob(80)", "of another size"),
    ],
)
def test_a_file_that_asks_for_other_arrays_is_refused(tmp_path, change, words):
    path = tmp_path / "run.history"
    FileWriter(path, {}, {"a": np.zeros(1)}).close()
    changed(path, f"UPDATE blocks SET {change} WHERE id = 1")
    for call in (read_meta, History.load):
        with pytest.raises(HistoryError, match=words):
            call(path)


def test_other_programs_read_it(tmp_path, make_scene):
    """Without this package: the recipe of the guide."""
    history, path = make_scene().history(230), tmp_path / "run.history"
    history.save(path)
    with contextlib.closing(sqlite3.connect(path)) as db:
        (head,) = db.execute("SELECT data FROM blocks WHERE kind = 'head'").fetchone()
        q = [
            np.frombuffer(data, dtype).reshape(-1, *json.loads(shape))
            for dtype, shape, data in db.execute(
                "SELECT dtype, shape, data FROM blocks WHERE name = 'q' ORDER BY first"
            )
        ]
    assert json.loads(head) == history.meta
    np.testing.assert_array_equal(np.concatenate(q), history["q"])


def test_series_are_read_when_they_are_asked_for(tmp_path, make_scene):
    """A file that is another one by then is refused; so is one whose array is damaged."""
    history, path = make_scene().history(230), tmp_path / "run.history"
    history.save(path)
    loaded, other = History.load(path), History.load(path)
    assert_equal(history, pickle.loads(pickle.dumps(loaded)))
    loaded = History.load(path)
    changed(path, "UPDATE blocks SET data = zeroblob(length(data)) WHERE name = 'p' AND first > 50")
    np.testing.assert_array_equal(loaded["q"], history["q"])
    with pytest.raises(HistoryError, match=r"run\.history.*wrong checksum.*recover=True"):
        loaded["p"]
    make_scene().history(100).save(path)
    np.testing.assert_array_equal(loaded["q"], history["q"])  # it was read before
    with pytest.raises(HistoryError, match=r"wrong checksum.*or another file by now"):
        other["q"]


def test_a_transaction_that_a_kill_has_ended_is_taken_back(make_scene, tmp_path):
    """What the writer began is in the journal beside the file."""
    scene, path = make_scene(), tmp_path / "run.history"
    writer = stream(scene, path, 25)
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("PRAGMA cache_size = 1")  # pages go into the file before the end
        db.execute("BEGIN")
        db.execute("UPDATE blocks SET data = zeroblob(length(data))")
        journal = tmp_path / "run.history-journal"
        files = path.read_bytes(), journal.read_bytes()
    writer._file.close()
    path.write_bytes(files[0])
    journal.write_bytes(files[1])
    history = History.load(path)
    assert (len(history), history.status) == (20, "killed")
    assert_equal(scene.history(25), history, 20)
    journal.write_bytes(files[1])
    scene.history(3).save(path)  # over such a file
    assert_equal(scene.history(3), History.load(path))


@pytest.mark.filterwarnings("ignore::skfem_cosserat.IncompleteWarning")
def test_file_cut_short(make_scene, tmp_path):
    scene, path = make_scene(), tmp_path / "run.history"
    stream(scene, path, 25).close()
    whole, sound, found, lost = path.read_bytes(), scene.history(25), set(), []
    for cut in range(len(whole) - 8192, 2 * 8192, -8192):
        path.write_bytes(whole[:cut])
        with pytest.raises(HistoryError, match=r"run\.history.*damaged"):
            History.load(path)
        try:
            part = History.load(path, recover=True)
        except HistoryError as error:  # the head is gone
            lost.append(str(error))
            continue
        found.add(len(part))
        for name, values in part.series.items() if len(part) else ():
            np.testing.assert_array_equal(values, sound[name][: len(part)])
    assert found == {0, 10, 20}
    assert lost and all("nothing can be recovered" in text for text in lost)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"SKFE", "not a history"),
        (b"PK\x03\x04" + bytes(100), "not a history"),
        (b"SKFEM-COSSERAT HISTORY 1\n" + bytes(100), "version 0.2 and older wrote it"),
        (b"SQLite format 3\0" + bytes(100), "run.history"),
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


def test_another_database_and_another_version(tmp_path):
    path = tmp_path / "run.history"
    changed(path, "CREATE TABLE a (b)")
    with pytest.raises(HistoryError, match="another SQLite database"):
        History.load(path)
    FileWriter(path, {}, {}).close()
    changed(path, "PRAGMA user_version = 7")
    with pytest.raises(HistoryError, match=r"another version: \(\d+, 7\), not \(\d+, 1\)"):
        History.load(path)


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


# each damaged file gives a warning of its own
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.IncompleteWarning")
@pytest.mark.parametrize("seed", range(3))
def test_no_damage_gives_a_wrong_number(tmp_path, seed):
    """Single bits, runs of zeros, pages that stand elsewhere: what is read is right, or refused."""
    path, history = tmp_path / "run.history", long_history(1030, 9000)
    history.add_series("label", np.full(1030, "äb"))
    history.save(path)
    whole, rng = path.read_bytes(), np.random.default_rng(seed)
    refused = 0
    for _ in range(170):
        data, place = bytearray(whole), int(rng.integers(len(whole)))
        kind = rng.integers(4)
        if kind == 0:
            data[place] ^= 1 << rng.integers(8)
        elif kind == 1:
            data[place : place + 600] = bytes(len(data[place : place + 600]))
        elif kind == 2:
            other = 4096 * int(rng.integers(len(whole) // 4096))
            page = place // 4096 * 4096
            data[page : page + 4096] = whole[other : other + 4096]
        else:
            del data[place:]
        path.write_bytes(data)
        for recover in (False, True):
            try:
                part = History.load(path, recover)
                for name in part.series if len(part) else ():
                    np.testing.assert_array_equal(part[name], history[name][part["step"]])
                assert recover or len(part) == 1030
                for name, array in part.static.items():
                    assert np.array_equal(array, history.static[name])
                seen = part.sensors.get("tip")
                assert seen is None or np.array_equal(seen.values[:, 1], 2 * seen.times)
            except HistoryError as error:  # no other one
                refused += not recover and "run.history" in str(error)
    assert refused > 100


def test_damage_takes_at_most_a_hundred_states(tmp_path):
    path, history = tmp_path / "run.history", long_history(1030)
    history.save(path)
    changed(
        path, "UPDATE blocks SET data = zeroblob(length(data)) WHERE first = 600 AND name = 'q'"
    )
    for name in ("x", "t"):
        changed(path, f"UPDATE blocks SET crc = 1 WHERE first = 8192 AND name = 'tip/{name}'")
    with pytest.warns(IncompleteWarning, match=r"run\.history.*930 states recovered"):
        part = History.load(path, recover=True)
    assert np.array_equal(part["step"], [*range(600), *range(700, 1030)])
    assert part.meta["missing"] == [[600, 699]]
    (second,) = [start for start, _ in part.segments if start]
    assert part["step"][second] == 700
    assert part["step"][part.events[0].row] == 599
    seen = part.sensors["tip"]
    assert len(seen.times) == 20_000 - 4096
    assert np.array_equal(seen.values[:, 1], 2 * seen.times)
    assert part.static["outline"].tolist() == list(range(8))


def test_it_is_said_which_states_are_missing(tmp_path):
    path = tmp_path / "run.history"
    long_history(1000).save(path)
    changed(path, "UPDATE blocks SET shape = '[' WHERE first = 300 AND name = 'p'")
    changed(path, "DELETE FROM blocks WHERE first = 600")
    with pytest.warns(IncompleteWarning) as said:
        History.load(path, recover=True)
    text = str(said[0].message)
    assert "800 states recovered, missing: states 300 to 399 (next to t = 2.99 and 4)" in text
    assert "states 600 to 699" in text


def summed(path):
    """Sums of a file anew, as whoever changed it may compute them."""
    with contextlib.closing(sqlite3.connect(path)) as db, db:
        columns = "id, data, kind, name, first, rows, dtype, shape"
        for key, data, *own in db.execute(f"SELECT {columns} FROM blocks").fetchall():
            crc = zlib.crc32(data, zlib.crc32(" ".join(map(str, own)).encode()))
            db.execute("UPDATE blocks SET crc = ? WHERE id = ?", [crc, key])
        db.execute("UPDATE sqlite_sequence SET seq = (SELECT count(*) FROM blocks)")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.IncompleteWarning")
@pytest.mark.parametrize("seed", range(2))
def test_damage_with_right_sums_gives_one_kind_of_error(tmp_path, seed):
    """Values of another kind in any column, bytes in numbers and in JSON, rows left out."""
    rng = np.random.default_rng(seed)
    path, history = tmp_path / "run.history", long_history(110, 9)
    history.add_series("label", np.full(110, "äb"))
    history.add_series("flag", np.arange(110) % 2 == 0)
    history.save(path)
    whole, refused = path.read_bytes(), 0
    odd = [None, -1, 2**62, 1e300, "", "[]", "null", "[-1]", "[99999999999]", "<f4", "{}", b"x"]
    columns = ("kind", "name", "first", "rows", "dtype", "shape", "data")
    for _ in range(120):
        path.write_bytes(whole)
        column = columns[rng.integers(7)]
        key = int(rng.integers(1, 18))
        if rng.random() < 0.5:
            value = odd[rng.integers(12)]
            changed(path, f"UPDATE blocks SET {column} = ? WHERE id = {key}", value)
        elif column == "data":
            with contextlib.closing(sqlite3.connect(path)) as db:
                (old,) = db.execute(f"SELECT data FROM blocks WHERE id = {key}").fetchone()
            bad = bytearray(old)
            for _ in range(3):
                bad[rng.integers(len(bad))] = rng.integers(32, 127)
            changed(path, f"UPDATE blocks SET data = ? WHERE id = {key}", bytes(bad))
        else:
            changed(path, f"DELETE FROM blocks WHERE id = {key}")
        with contextlib.suppress(TypeError):
            summed(path)
        for recover in (False, True):
            try:
                part = History.load(path, recover)
                assert all(len(part[name]) == len(part) for name in part)
                assert all(len(each.times) == len(each.values) for each in part.sensors.values())
                assert repr(part)
            except HistoryError as error:  # no other one
                refused += "run.history" in str(error)
    assert refused > 60


# -- full disks ------------------------------------------------------------------------------


@pytest.fixture
def disk(monkeypatch):
    """A disk that takes so many more bytes; ``disk(None)`` takes all."""
    append, left = FileWriter.append, [np.inf]

    def limited(self, *block):
        if left[0] < 8192:
            raise OSError(28, os.strerror(28))
        (pages,) = self._db.execute("PRAGMA page_count").fetchone()
        pages *= block[0] != "static"  # a new file
        self._db.execute(f"PRAGMA max_page_count = {pages + int(min(left[0], 2**40)) // 8192}")
        try:
            append(self, *block)
        finally:
            left[0] -= 8192 * (self._db.execute("PRAGMA page_count").fetchone()[0] - pages)

    monkeypatch.setattr(FileWriter, "append", limited)
    return lambda size: left.__setitem__(0, np.inf if size is None else size)


@pytest.mark.parametrize("room", [None, 30_000])
def test_several_states_at_once_are_the_same_ones(make_scene, tmp_path, disk, room):
    """Across blocks; a disk that gets full in their midst is told after all are recorded."""
    scene = make_scene()
    writer = HistoryWriter(scene.meta, scene.static, tmp_path / "run.history", 10)
    rows, said = [scene.row(k) for k in range(25)], []
    disk(room)
    writer.append(rows[0])
    for part in (rows[1:8], rows[8:25]):
        arrays = {name: np.array([row[name] for row in part]) for name in part[0]}
        try:
            writer.extend(arrays)
        except StorageError as error:
            said.append(error)
            assert_equal(scene.history(part[-1]["step"] + 1), error.history)
    assert bool(said) == (room is not None)
    with pytest.raises(InputError, match="as in the first row"):
        writer.extend({**arrays, "q": arrays["q"][:, 1:]})
    with pytest.raises(InputError, match="row entry 'q': is missing"):
        writer.extend({name: array for name, array in arrays.items() if name != "q"})
    assert_equal(scene.history(25), writer.history())
    disk(None)
    writer.close()


@pytest.mark.parametrize("room", [0, 30_000, 68_500])
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
def test_nothing_is_left_of_a_failed_save(make_scene, tmp_path, disk, part):
    history, path = make_scene().history(60), tmp_path / "run.history"
    history.save(path)
    before = path.read_bytes()
    history.meta["bad"] = object()
    with pytest.raises(InputError, match="bad"):
        history.save(path)
    del history.meta["bad"]
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


@pytest.mark.one_quick
@pytest.mark.parametrize("part", [0.5, 0.9, 0.999, 1.5])
def test_a_run_on_a_full_disk_keeps_its_history(tmp_path, disk, part):
    """In a step, at the end, and when all is written again with energies."""
    system, sensors = falling()
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 2.4
    path = tmp_path / "run.history"
    truth = sc.simulate(*run, sensors=sensors, path=tmp_path / "truth.history", derive=False)
    disk(int(part * (tmp_path / "truth.history").stat().st_size))
    with pytest.raises(StorageError, match="No space left on device") as caught:
        sc.simulate(*run, sensors=sensors, path=path)
    history = caught.value.history
    assert caught.value.time == pytest.approx(history.times[-1], abs=0.011)
    whole = len(history) == 241
    assert whole == (part > 0.95) or part == 0.9  # near the end by the sizes of blocks
    assert history.status == ("completed" if whole else "failed")
    assert len(history) > 50 and "energy" in history
    assert np.array_equal(history["q"], truth["q"][: len(history)])
    seen = history.sensors["place"].values
    assert len(seen) >= len(history)
    assert np.array_equal(seen, truth.sensors["place"].values[: len(seen)])


def test_a_path_on_a_full_disk_keeps_its_points(tmp_path, disk):
    model = sc.Model()
    box = model.add("box", sc.RigidBody.box(1.0, (1, 1, 1)))
    model.add("bed", sc.Bushing(sc.ground((0, 0, 0)), box.at((0, 0, 0)), 100 * np.eye(6)))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    disk(45_000)
    with pytest.raises(StorageError) as caught:
        sc.static(model.freeze(), sc.NullSpace(), path=tmp_path / "path.history")
    assert caught.value.history["load_factor"][-1] == 1.0


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
    resource.setrlimit(resource.RLIMIT_FSIZE, (90_000, limits[1]))
    try:
        with pytest.raises(StorageError, match=r"run\.history.*at t = .*: disk I/O error"):
            stream(scene, path, 40).close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(History.load(path)) == 10


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
