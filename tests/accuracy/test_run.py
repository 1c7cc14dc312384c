"""Independent runs through executors: the same numbers, in order, and failures kept apart."""

from __future__ import annotations

import asyncio
import copy
import logging
import math
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial

import numpy as np
import pytest
from helpers_scenes import ball_on_rod, everything, four_bar, growing, swing, waving
from test_statics import cantilever

import skfem_cosserat as sc
from skfem_cosserat.accuracy import run
from skfem_cosserat.linear import SingularMatrixError
from skfem_cosserat.model.fingerprint import fingerprint
from skfem_cosserat.warn import warn

# the batch has a pendulum in large steps of the variational scheme
pytestmark = pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")

PAIRS = [
    (integrator, treatment)
    for integrator in (sc.EnergyMomentum, sc.Variational)
    for treatment in (sc.NullSpace, sc.Multipliers)
]


@pytest.fixture(scope="module", autouse=True)
def _plain_workers(tmp_path_factory):
    """Workers find no kernels: what "auto" takes there hangs on the jobs that they had before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", str(tmp_path_factory.mktemp("kernels")))
        yield


@pytest.fixture(scope="module")
def processes():
    with sc.Processes(2) as executor:
        yield executor


@pytest.fixture(scope="module")
def pool():
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        yield executor


@pytest.fixture(scope="module")
def threads():
    with ThreadPoolExecutor(2) as executor:
        yield executor


POOL = pytest.param("pool", marks=pytest.mark.slow)  # its workers take seconds to start


@pytest.fixture(params=["serial", "processes", POOL, "threads"])
def executor(request):
    """Each way of running jobs."""
    return None if request.param == "serial" else request.getfixturevalue(request.param)


# -- what the workers call -------------------------------------------------------------------------


def turning(t):
    return 0.3 * t**2


DONE: list[int] = []


def noted(number):
    time.sleep(0.05)
    DONE.append(number)


def slow(seconds):
    time.sleep(seconds)
    return seconds


def noted_in(path):
    with path.open("a") as file:
        file.write("x")


def killed():
    os.kill(os.getpid(), signal.SIGKILL)


class TwoArgumentsError(Exception):
    """Pickles, but cannot be read again: its constructor takes something else than its text."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


class NotedError(Exception):
    """Keeps what it was given."""


class SilentError(Exception):
    """Its text cannot be had."""

    def __str__(self):
        raise RuntimeError("no text")


class ReducedError(Exception):
    """Pickles to something else."""

    def __reduce__(self):
        return dict, ()


def raising(kind, *args):
    error = kind(*args)
    error.at = 7
    error.add_note("seen at dawn")
    raise error


def giving_a_lambda():
    return lambda: 1


def multiplied(factor):
    return lambda: factor


def environment(name):
    return os.environ.get(name)


# -- data that travels -----------------------------------------------------------------------------


def pendulum(length, blow=0.0):
    model, bob, _ = ball_on_rod((length, 0, 0), g=9.81)
    if blow:
        model.add("blow", sc.LoadForce(bob.place(), (0, blow, 0), sc.Table([0.3, 0.4], [0, 1])))
    return model.freeze()


def machine():
    """Drive, springs, actuators, a cable, a bushing, damping."""
    model = four_bar()
    crank, rocker, pins = model["crank"], model["rocker"], [model[f"pin {k}"] for k in range(4)]
    model.add("motor", sc.JointDrive(pins[0], turning))
    model.add("spring", sc.JointSpringDamper(pins[3], stiffness=2.0, damping=0.1))
    model.add("torque", sc.JointActuator(pins[2], waving))
    model.add("cable", sc.Cable(sc.ground((0, 3, 0)), rocker.local((0, 0, 0)), 5.0, length=1.0))
    weight = model.add("weight", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3), position=(0, 0, 2)))
    ball = sc.JointSpherical(sc.ground((0, 0, 2)), weight.local((0, 0, 0)))
    model.add("ball", ball)
    model.add("twist", sc.JointActuator(ball, growing))
    model.add("drag", sc.RayleighDamping(mass=0.1, items=[crank, weight]))
    return model


SYSTEMS = {
    "swing": swing,
    "order 3": partial(everything, 3),
    "machine": lambda: machine().freeze(),
}


def equal_histories(a, b):
    assert a.meta == b.meta
    assert list(a.series) == list(b.series) and list(a.static) == list(b.static)
    for name in a.series:
        assert np.array_equal(a[name], b[name], equal_nan=True), name
    for name in a.static:
        assert np.array_equal(a.static[name], b.static[name]), name


@pytest.mark.slow
@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_that_has_travelled_is_the_same_to_the_last_bit(name):
    """Every item, all pairs of integrator and treatment, numbers by identity included."""
    system = SYSTEMS[name]()
    other = pickle.loads(pickle.dumps(system))
    assert other is not system and other.structures[0] is not system.structures[0]
    assert fingerprint(other) == fingerprint(system)
    assert repr(other) == repr(system) and other.redundancies() == system.redundancies()
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    for integrator, treatment in PAIRS:
        one, two = (
            sc.simulate(each, integrator(), treatment(), 1e-3, 4e-3, start=start)
            for each in (system, other)
        )
        equal_histories(one, two)


def test_a_model_and_its_places_travel_together():
    """A place in another argument still belongs to the model's item."""
    model = machine()
    other, place = pickle.loads(pickle.dumps((model, model["weight"].local((0, 0, 0)))))
    assert list(other) == list(model) and place.item is other["weight"]
    assert fingerprint(other.freeze()) == fingerprint(model.freeze())
    assert copy.deepcopy(other)["motor"].value(2.0) == turning(2.0)


@pytest.mark.slow
def test_results_travel():
    model, tip = cantilever(elements=3)
    model.add("push", sc.LoadForce(tip, (0, 0.1, 0)))
    system = model.freeze()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.05)
    path = sc.static(system, control=sc.ArcLength(until=1.0))
    modes = sc.modes(system, count=3)
    for result in (history, path, modes.animation(1)):
        equal_histories(pickle.loads(pickle.dumps(result)), result)


@pytest.mark.parametrize(
    "error",
    [
        sc.CosseratError("text"),
        sc.InputError("item", "message"),
        sc.MeshError("item", "message"),
        sc.HistoryError("item", "message"),
        sc.IncompatibleError("item", "message"),
        sc.Diverged(0.1, 2, 3e-4, "reason", "advice", [[1.0, 2.0]], "load factor 3"),
        sc.JobError("name", "reason"),
        sc.StorageError("file", OSError(28, "No space left on device"), "", 0.5),
        SingularMatrixError("matrix"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_travel_with_all_they_say(error):
    error.add_note("a note")
    error.extra = [1, 2]
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(again) is type(error) and str(again) == str(error)
        assert vars(again) == vars(error)
        assert getattr(again, "errno", None) == getattr(error, "errno", None)


# -- running ---------------------------------------------------------------------------------------


def batch():
    """Five runs, of which the third fails."""
    systems = [pendulum(0.5 + 0.1 * k, 1e6 if k == 2 else 0.0) for k in range(5)]
    scheme = sc.Variational(), sc.Multipliers()
    return [
        sc.Job(f"run {k}", sc.simulate, system, *scheme, step=0.1, until=1.0)
        for k, system in enumerate(systems)
    ]


@pytest.fixture(scope="module")
def expected():
    """The histories of the batch, without any of this."""
    out = []
    for job in batch():
        try:
            out.append(job.function(*job.args, **job.kwargs))
        except sc.Diverged as error:
            out.append(error)
    return out


@pytest.mark.slow
@pytest.mark.plain
def test_outcomes_in_order_and_a_failure_apart(executor, expected):
    told = []
    outcomes = sc.run_all(batch(), executor, progress=lambda *args: told.append(args))
    assert [outcome.name for outcome in outcomes] == [f"run {k}" for k in range(5)]
    failed, error = outcomes[2], expected[2]
    for outcome, value in zip(outcomes, expected, strict=True):
        assert outcome.seconds > 0 and outcome.ok == (outcome is not failed)
        if outcome.ok:
            equal_histories(outcome.result(), value)
    assert type(failed.error) is sc.Diverged and str(failed.error) == str(error)
    assert failed.error.residuals == error.residuals and failed.error.step == error.step
    equal_histories(failed.error.history, error.history)
    assert "in simulate" in failed.traceback and outcomes[0].traceback == ""
    with pytest.raises(sc.Diverged):
        failed.result()
    assert "Diverged" in repr(failed) and "History" in repr(outcomes[0])
    assert [args[:2] for args in told] == [(k, 5) for k in range(1, 6)]


class Promise:
    """A future of somebody else's making."""

    def __init__(self, function, args):
        self.call = partial(function, *args)

    def result(self):
        return self.call()

    def cancel(self):
        raise AssertionError("all are done")


class Elsewhere:
    """An executor that takes its time, with futures that are not Python's."""

    def submit(self, function, *args):
        time.sleep(0.02)
        return Promise(function, args)


def test_an_executor_that_does_not_pay_is_told(monkeypatch):
    monkeypatch.setattr(run, "WORTH", 0.0)
    jobs = [sc.Job(f"{x}", math.sqrt, x) for x in (4.0, 9.0)]
    with pytest.warns(sc.PerformanceWarning, match="2 jobs took"):
        assert [outcome.value for outcome in sc.run_all(jobs, Elsewhere())] == [2.0, 3.0]


def test_line_of_progress(capsys):
    sc.run_all([sc.Job("a", math.sqrt, 1.0), sc.Job("b", math.sqrt, -1.0)], progress=True)
    assert "2 of 2 jobs done, last 'b'" in capsys.readouterr().err


def test_a_folder_is_resumed(tmp_path, executor):
    """Failures are kept, too."""
    jobs = [sc.Job(f"{x}", math.sqrt, x) for x in (4.0, -1.0)]
    first = sc.run_all(jobs, executor, folder=tmp_path)
    again = sc.run_all(jobs, Refusing() if executor else None, folder=tmp_path)
    assert [each.value for each in again] == [each.value for each in first] == [2.0, None]
    assert again[1].status == "error" and again[0].seconds == first[0].seconds


def test_what_a_folder_does_not_know_is_run(tmp_path):
    """What cannot be read is run again; other arguments are another job."""
    told, jobs = [], [sc.Job(f"{x}", math.sqrt, x) for x in (4.0, -1.0)]
    sc.run_all(jobs, folder=tmp_path)
    more = [sc.Job("4.0", math.sqrt, 16.0), jobs[1]]
    progress = {"progress": lambda done, count, outcome: told.append(done)}
    assert sc.run_all(more, folder=tmp_path, retry=True, **progress)[0].value == 4.0
    assert told == [1, 2]
    for path in tmp_path.glob("*.case"):
        path.write_bytes(b"half")
    with pytest.warns(sc.PerformanceWarning, match="cannot be read .*the job is run again"):
        assert sc.run_all(jobs[:1], folder=tmp_path)[0].value == 2.0
    for factor in (2.0, 3.0):
        job = sc.Job("bound", multiplied(factor))
        assert sc.run_all([job], folder=tmp_path)[0].value == factor
    with pytest.raises(sc.InputError, match="job 'lambda' gave cannot be kept"):
        sc.run_all([sc.Job("lambda", giving_a_lambda)], folder=tmp_path)
    with pytest.raises(sc.InputError, match="cannot be recognised in a later run"):
        sc.run_all([sc.Job("lock", repr, threading.Lock())], folder=tmp_path)


def test_nothing_to_do(executor):
    assert sc.run_all([], executor) == []


def test_any_error_travels(executor):
    """Errors that are no exceptions, too, which broke threads with all other outcomes."""
    jobs = [
        sc.Job("noted", raising, NotedError, "text", 3),
        sc.Job("exit", sys.exit, 3),
        sc.Job("cancelled", raising, asyncio.CancelledError, "by hand"),
        sc.Job("silent", raising, SilentError),
        sc.Job("good", math.sqrt, 4.0),
    ]
    noted, left, cancelled, silent, good = sc.run_all(jobs, executor)
    assert type(noted.error) is NotedError and noted.error.args == ("text", 3)
    assert noted.error.at == 7 and noted.error.__notes__ == ["seen at dawn"]
    assert type(left.error) is sc.JobError and "'exit': it raised SystemExit: 3" in str(left.error)
    assert "job 'cancelled': it raised CancelledError: by hand" in str(cancelled.error)
    assert "in raising" in cancelled.traceback
    assert "SilentError: (it has no text)" in repr(silent)
    assert good.value == 2.0


@pytest.mark.parametrize("name", ["processes", POOL, "threads"])
def test_what_cannot_travel_back_is_an_outcome(name, request):
    """An exception that cannot be read breaks a ProcessPoolExecutor that gets it by itself."""
    jobs = [
        sc.Job("error", raising, TwoArgumentsError, 1, 2),
        sc.Job("other kind", raising, ReducedError),
        sc.Job("value", giving_a_lambda),
        sc.Job("good", math.sqrt, 4.0),
    ]
    error, other, value, good = sc.run_all(jobs, request.getfixturevalue(name))
    assert type(error.error) is sc.JobError and error.error.job == "error"
    assert "TwoArgumentsError: 1 and 2" in str(error.error) and "in raising" in error.traceback
    assert "cannot travel between processes: " in str(other.error)
    assert "'value'" in str(value.error) and "of type function" in str(value.error)
    assert good.value == 2.0


# -- workers that end ------------------------------------------------------------------------------


@pytest.mark.slow
def test_ctrl_c_ends_a_simulation_and_no_worker():
    """As it comes to all processes of a terminal: between two jobs, and within one."""
    jobs = [
        sc.Job("under way", interrupted_run, pendulum(1.0)),
        sc.Job("twice", simulation_interrupted_twice, pendulum(1.0)),
        sc.Job("good", pid, 0.0),
    ]
    with sc.Processes(1) as executor:
        worker = executor.submit(pid, 0.0).result()
        os.kill(worker, signal.SIGINT)
        under_way, twice, good = sc.run_all(jobs, executor)
    assert under_way.status == "interrupted" and len(under_way.value) == 2
    assert twice.status == "interrupted" and good.value == worker


@pytest.mark.slow
def test_no_job_is_started_in_a_worker_after_ctrl_c(tmp_path):
    """Pools of Python take one job more than they have workers."""

    def interrupt(done, count, outcome):
        if done == 1:
            raise KeyboardInterrupt

    jobs = [sc.Job(f"{k}", noted_in, tmp_path / f"{k}") for k in range(4)]
    with sc.Processes(1) as executor:
        outcomes = sc.run_all(jobs, executor, progress=interrupt)
    assert [outcome.status for outcome in outcomes] == ["ok", *3 * ["not run"]]
    assert [path.name for path in tmp_path.iterdir()] == ["0"]


def test_an_error_in_the_block_ends_what_is_under_way():
    """As a second Ctrl-C does: nobody waits an hour for a job that nobody asks for."""
    futures = []

    def block():
        with sc.Processes(1) as executor:
            futures.append(executor.submit(time.sleep, 3600.0))
            while not futures[0].running():
                time.sleep(0.01)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        block()
    assert isinstance(futures[0].exception(), BrokenProcessPool)


@pytest.mark.slow
def test_workers_end_when_their_process_is_killed(tmp_path):
    """Those with a job, too: else whoever reads what they print would wait for ever."""
    script = tmp_path / "script.py"
    script.write_text(
        "import os, signal, time\n"
        "import skfem_cosserat as sc\n"
        "if __name__ == '__main__':\n"
        "    executor = sc.Processes(2)\n"
        "    executor.submit(time.sleep, 3.0)\n"
        "    executor.submit(abs, 1).result()\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    command = [sys.executable, str(script)]
    done = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL


@pytest.mark.slow
def test_a_killed_worker_costs_its_own_job(processes, tmp_path):
    """What ran beside it runs again; all else runs once, side by side."""
    jobs = [sc.Job(f"{k}", noted_in, tmp_path / f"{k}") for k in range(12)]
    jobs[1:1] = [sc.Job("killed", killed)]
    outcomes = sc.run_all(jobs, processes)
    failed = [outcome for outcome in outcomes if not outcome.ok]
    assert [outcome.name for outcome in failed] == ["killed"]
    error = failed[0].error
    assert type(error) is sc.JobError and error.job == "killed" and "process ended" in str(error)
    assert isinstance(error.__cause__, BrokenProcessPool)
    assert sum(len(path.read_text()) for path in tmp_path.iterdir()) <= 12 + 2


@pytest.mark.slow
def test_a_broken_pool_is_an_outcome():
    """Jobs in it and after it say so; nothing is raised, and what was done is kept."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        jobs = [
            sc.Job("first", math.sqrt, 4.0),
            sc.Job("killed", killed),
            *(sc.Job(f"{k}", slow, 0.01) for k in range(4)),
        ]
        outcomes = sc.run_all(jobs, pool)
        assert outcomes[0].value == 2.0
        for outcome in outcomes[1:]:
            assert type(outcome.error) is sc.JobError and outcome.name in str(outcome.error)
            assert "process ended" in str(outcome.error)
        (late,) = sc.run_all([sc.Job("late", math.sqrt, 4.0)], pool)
        assert type(late.error) is sc.JobError and type(late.error.__cause__) is BrokenProcessPool


def test_processes_is_an_executor(processes):
    assert processes.submit(pow, 2, exp=5).result() == 32
    assert list(processes.map(math.sqrt, [1.0, 4.0])) == [1.0, 2.0]
    with pytest.raises(NotedError):
        processes.submit(raising, NotedError).result()


def test_one_thread_each_and_the_own_environment_untouched(processes, monkeypatch):
    names = ("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    before = dict(os.environ)
    assert [processes.submit(environment, name).result() for name in names] == ["1"] * 3
    assert dict(os.environ) == before


# -- refused before work starts --------------------------------------------------------------------


class Refusing:
    """An executor that must not be asked."""

    def submit(self, function, *args):
        raise AssertionError("work started")


def wheel(motion=None, **items):
    """A wheel on an axle; more items of axle and wheel by their names."""
    model = sc.Model()
    body = model.add("wheel", sc.RigidBody.sphere(1.0, 0.1))
    hub = sc.ground((0, 0, 0), motion), body.at((0, 0, 0))
    axle = model.add("axle", sc.JointRevolute(*hub, axis=(0, 0, 1)))
    for name, item in items.items():
        model.add(name, item(axle, hub[1]))
    return model


STUCK = {
    "load 'wind'": {"wind": lambda axle, hub: sc.LoadForce(hub, (1, 0, 0), lambda t: t)},
    "drive 'motor'": {"motor": lambda axle, hub: sc.JointDrive(axle, lambda t: t**2)},
    "joint 'axle'": {"motion": sc.Motion(displacement=lambda t: (t, 0, 0))},
}


@pytest.mark.parametrize("label", STUCK)
def test_a_function_that_cannot_travel_is_named_before_work_starts(label):
    jobs = [sc.Job("first", math.sqrt, 4.0), sc.Job("k = 2", repr, wheel(**STUCK[label]).freeze())]
    with pytest.raises(sc.InputError) as caught:
        sc.run_all(jobs, Refusing())
    text = str(caught.value)
    assert text.startswith("job 'k = 2', ") and label in caught.value.item
    assert text.count("cannot be sent") == 1 and "executor=None" in text and "Table" in text
    assert all(outcome.ok for outcome in sc.run_all(jobs))


def test_a_local_function_and_an_object_that_cannot_travel():
    def local():
        return 1

    with pytest.raises(sc.InputError, match=r"job 'a', function: '.*local' cannot be sent"):
        sc.run_all([sc.Job("a", local)], Refusing())
    with pytest.raises(sc.InputError, match=r"argument callbacks: .*lock"):
        sc.run_all([sc.Job("a", print, callbacks=threading.Lock())], Refusing())
    assert sc.run_all([sc.Job("a", local)])[0].value == 1


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: sc.Job("", math.sqrt), "name = ''"),
        (lambda: sc.Job("a", 3), "job 'a': 3 cannot be called"),
        (lambda: sc.run_all(3), "run_all: jobs = 3, expected Iterable of Job"),
        (lambda: sc.run_all([sc.Job("a", id), sc.Job("a", id)]), "two jobs are called 'a'"),
        (lambda: sc.run_all([], executor=2), "argument executor: 2"),
        (lambda: sc.run_all([], progress=2), "argument progress: 2"),
        (lambda: sc.Processes(0), "argument workers: 0"),
        (lambda: sc.Processes(1, threads=-1), "argument threads: -1"),
    ],
)
def test_bad_arguments(call, text):
    with pytest.raises(sc.InputError) as caught:
        call()
    assert text in str(caught.value)


# -- interruption ----------------------------------------------------------------------------------


def interrupting(report):
    signal.raise_signal(signal.SIGINT)


def interrupted_run(system):
    return sc.simulate(
        system, sc.EnergyMomentum(), sc.NullSpace(), 0.1, 1.0, callbacks=[interrupting]
    )


def interrupting_twice(report):
    twice()


def simulation_interrupted_twice(system):
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    return sc.simulate(system, *scheme, 0.1, 1.0, callbacks=[interrupting_twice])


def test_ctrl_c_ends_the_run_and_starts_no_other(caplog):
    """The simulation under way ends after its step, as it does alone."""
    system, before = pendulum(1.0), signal.getsignal(signal.SIGINT)
    jobs = [
        sc.Job("done", math.sqrt, 4.0),
        sc.Job("under way", interrupted_run, system),
        sc.Job("not started", math.sqrt, 4.0),
    ]
    with caplog.at_level(logging.INFO):
        done, under_way, left = sc.run_all(jobs)
    assert done.value == 2.0
    assert under_way.value.status == "interrupted" and len(under_way.value) == 2
    assert type(left.error) is sc.JobError and "cancelled" in str(left.error)
    assert "interrupted" in caplog.text
    assert signal.getsignal(signal.SIGINT) is before


def twice():
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)


def test_a_second_ctrl_c_ends_it_at_once():
    jobs = [sc.Job("done", math.sqrt, 4.0), sc.Job("twice", twice), sc.Job("left", math.sqrt, 4.0)]
    with pytest.raises(KeyboardInterrupt) as caught:
        sc.run_all(jobs)
    assert [outcome.ok for outcome in caught.value.outcomes] == [True, False, False]


@pytest.mark.parametrize("kind", [KeyboardInterrupt, ZeroDivisionError])
def test_an_error_of_progress_cancels_the_rest(kind):
    """As Ctrl-C for a second time does."""

    def fail(done, count, outcome):
        raise kind

    DONE.clear()
    jobs = [sc.Job(f"{k}", noted, k) for k in range(20)]
    with ThreadPoolExecutor(1) as threads, pytest.raises(kind) as caught:
        sc.run_all(jobs, threads, progress=fail)
    assert 0 < len(DONE) < 20
    if kind is KeyboardInterrupt:
        assert len(caught.value.outcomes) == 20


# -- other executors -------------------------------------------------------------------------------


def test_futures_that_are_not_pythons():
    told = []
    jobs = [sc.Job(f"{x}", math.sqrt, x) for x in (4.0, -1.0, 9.0)]
    outcomes = sc.run_all(jobs, Elsewhere(), progress=lambda done, n, out: told.append(out.name))
    assert [outcome.value for outcome in outcomes] == [2.0, None, 3.0]
    assert told == ["4.0", "-1.0", "9.0"]


class Closing:
    """An executor that is closed after the first job, whose answer is lost."""

    def __init__(self):
        self.taken = 0

    def submit(self, function, *args):
        self.taken += 1
        if self.taken > 1:
            raise RuntimeError("cannot schedule new futures after shutdown")
        future = Future()
        future.set_exception(ConnectionError("gone"))
        return future


def test_an_executor_that_fails_loses_no_outcome():
    """Its error went through, and what had been done was lost."""
    lost, *left = sc.run_all([sc.Job(f"{x}", math.sqrt, x) for x in (4.0, 9.0, 16.0)], Closing())
    assert "job '4.0': no answer came back: ConnectionError: gone" in str(lost.error)
    assert all(type(each.error) is sc.JobError for each in left)
    assert "job '9.0': no answer came back: RuntimeError: cannot schedule" in str(left[0].error)


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


@pytest.mark.slow
def test_compiled_kernels_in_the_workers(monkeypatch):
    """Nothing compiled travels; each worker finds or makes its own."""
    pytest.importorskip("numba")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    arguments = swing(), sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 5e-3
    jobs = [sc.Job(f"{k}", sc.simulate, *arguments, kernels="numba") for k in range(2)]
    expected = sc.simulate(*arguments, kernels="numba")
    with sc.Processes(2) as executor:
        for outcome in sc.run_all(jobs, executor):
            equal_histories(outcome.result(), expected)


@pytest.mark.slow
def test_a_local_dask_cluster(client, expected):
    """The same numbers; and a worker that is killed."""
    with client.get_executor() as executor:
        test_outcomes_in_order_and_a_failure_apart(executor, expected)
        test_any_error_travels(executor)
    with client.get_executor(retries=0) as executor:
        good, bad = sc.run_all([sc.Job("good", math.sqrt, 4.0), sc.Job("bad", killed)], executor)
    assert good.value == 2.0
    assert type(bad.error) is sc.JobError and "job 'bad'" in str(bad.error)


def pid(seconds):
    time.sleep(seconds)
    return os.getpid()


# -- warnings --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_warnings_as_errors_lose_no_outcome():
    """They are raised after all jobs, with the outcomes."""

    def doubtful():
        warn("beam 'rod'", "is bent", sc.AccuracyWarning)
        return 1

    with warnings.catch_warnings():
        warnings.simplefilter("error", sc.CosseratWarning)
        with pytest.raises(sc.AccuracyWarning, match="job 'a', beam 'rod'") as caught:
            sc.run_all([sc.Job("a", doubtful), sc.Job("b", len, [1, 2])])
    assert [outcome.result() for outcome in caught.value.outcomes] == [1, 2]
