"""Sweeps on engines: any executor, and a Dask cluster of real processes, which are killed.

Whatever ends, and whoever goes on, journal, table and report are those of one machine, to the bit.
"""

import contextlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest

import caudal
from caudal import distributing

SWEEP = """
name = "engines"
scene = {scene}
[set]
solver.duration_s = {duration}
[record]
played = 3
frames = 5
[axes]
actuation.kappa_amp = {{ from = 0.8, to = 1.2, count = {count} }}
rod.nodes = [9, 11]
"""


def make_sweep(folder, count=10, duration=0.05):
    path = folder / "engines.toml"
    scene = json.dumps(os.path.abspath("models/baseline-smooth.toml"))
    path.write_text(SWEEP.format(scene=scene, duration=duration, count=count))
    return path


@pytest.fixture
def sweep(tmp_path):
    return make_sweep(tmp_path)


def results(folder):
    """What is left of a sweep that does not say how long it took: table and figures."""
    return {path.name: path.read_bytes() for path in Path(folder).iterdir() if path.suffix in (".csv", ".svg", ".html")}


def rows_of_journal(folder):
    """The cases of a journal and their rows, without the time that each took."""
    lines = (Path(folder) / "cases.journal").read_text().splitlines()[1:]
    entries = [json.loads(line[17:]) for line in lines]
    rows = {entry["index"]: {**entry["result"], "wall_s": None} for entry in entries}
    assert len(rows) == len(entries), "a case is there twice"
    return rows


@pytest.fixture(scope="module")
def distributed():
    return pytest.importorskip("distributed", reason="pip install distributed")


@contextlib.contextmanager
def cluster(folder, workers=2, preload=None, allowed_failures=None):
    """`dask scheduler` and `dask worker`, as on a real cluster: the scheduler's file, and all processes. They are killed in the end,
    which no state of theirs can hinder."""
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": dict(os.environ)}
    if allowed_failures is not None:
        options["env"]["DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"] = str(allowed_failures)
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file]
    started = [subprocess.Popen(scheduler, **options)]
    try:
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        worker = [*dask, "worker", "--scheduler-file", file, "--nthreads", "1", "--no-dashboard", "--local-directory", folder]
        if preload:
            worker += ["--preload", preload]
        started += [subprocess.Popen(worker, **options) for _ in range(workers)]
        yield file, started
    finally:
        for process in started:
            process.kill()
            process.wait()


@contextlib.contextmanager
def client_of(distributed, file, workers=2):
    """A client of the cluster once its workers are there."""
    with distributed.Client(scheduler_file=str(file), timeout=60) as client:
        client.wait_for_workers(workers, timeout=60)
        yield client


def test_any_executor_gives_the_results_of_this_machine_to_the_bit(sweep, tmp_path):
    rows = caudal.sweep(sweep, out=tmp_path / "ours")
    assert caudal.sweep(sweep, out=tmp_path / "ours", rows=False) == []
    told = []
    for name, make in [("threads", ThreadPoolExecutor), ("processes", ProcessPoolExecutor)]:
        with make(2) as executor:
            out = tmp_path / name
            theirs = caudal.sweep(sweep, out=out, executor=executor, progress=lambda done, of: told.append((done, of)))
        assert [dict(row) for row in theirs] == [dict(row) for row in rows]
        assert results(out) == results(tmp_path / "ours")
        assert rows_of_journal(out) == rows_of_journal(tmp_path / "ours")
        assert told[-1] == (20, 20)


def test_tables_travel_with_a_sweep_and_no_disk_is_shared(tmp_path):
    folder = tmp_path / "scenes"
    folder.mkdir()
    scene = Path("models/driven-head.toml").read_text()
    scene = re.sub(r"(?m)^angle_rad = .*$", 'angle_rad = { table = "a.csv" }', scene)
    assert "a.csv" in scene
    (folder / "scene.toml").write_text(scene)
    for name, angle in [("a", 0.1), ("b", 0.3)]:
        (folder / f"{name}.csv").write_text(f"time_s,angle_rad\n0,0\n1,{angle}\n2,0\n3,0\n4,0\n60,0\n")
    path = folder / "sweep.toml"
    path.write_text(
        'scene = "scene.toml"\n[set]\nsolver.duration_s = 0.05\n[axes]\n'
        '"head.angle_rad.table" = ["a.csv", "b.csv"]\nrod.nodes = [9, 11]\n'
    )
    ours = caudal.sweep(path, out=tmp_path / "ours")
    bundle = caudal._caudal._Sweep(path, None, tmp_path / "theirs", None, False, False, {}).bundle()
    for file in folder.iterdir():
        file.unlink()
    lines, _ = caudal._caudal._cases(bundle, [0, 1, 2, 3])
    rows = [json.loads(line[17:])["result"]["quantities"] for line in lines]
    assert all(row["complete"] for row in rows)
    for row, our in zip(rows, ours):
        assert row == {name: our[name] for name in row}
    assert rows[0] != rows[2]


def test_a_line_that_was_damaged_on_its_way_is_refused_and_a_second_one_is_left_out(sweep, tmp_path):
    at_work = caudal._caudal._Sweep(sweep, None, tmp_path / "out", None, False, False, {})
    lines, times = caudal._caudal._cases(at_work.bundle(), [3, 4])
    assert len(times) == 2
    assert at_work.keep(lines) == 2
    assert at_work.keep(lines) == 0
    assert set(range(20)) - set(at_work.todo()) == {3, 4}
    damaged = bytearray(lines[0])
    damaged[40] ^= 1
    with pytest.raises(caudal.errors.JournalError, match="damaged"):
        at_work.keep([bytes(damaged)])
    with pytest.raises(caudal.errors.BundleError, match="no case 20"):
        caudal._caudal._cases(at_work.bundle(), [20])
    with pytest.raises(caudal.errors.BundleError):
        caudal._caudal._cases(at_work.bundle()[:50], [0])


def test_a_worker_of_another_version_is_refused_by_name(sweep, tmp_path, monkeypatch):
    monkeypatch.setattr(distributing, "__version__", "9.9.9")  # this process; the workers have their own
    script = "import caudal.distributing as d; d.work"
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0
    from multiprocessing import get_context

    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        with pytest.raises(caudal.errors.EngineError, match=r"process \d+: it has caudal .*the job was made by caudal 9\.9\.9") as caught:
            caudal.sweep(sweep, out=tmp_path / "out", executor=executor)
    assert "process" in caught.value.worker
    assert not (tmp_path / "out/table.csv").exists()


def test_a_broken_executor_names_the_cases_on_their_way_and_another_engine_goes_on(tmp_path):
    sweep = make_sweep(tmp_path, count=30, duration=8.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    out = tmp_path / "out"
    with ProcessPoolExecutor(2) as executor:

        def kill(done, of):
            if done >= 4:
                for process in list(executor._processes.values()):
                    os.kill(process.pid, signal.SIGKILL)

        with pytest.raises(caudal.errors.EngineError, match=r"cases outstanding: \d.*the same call resumes there"):
            caudal.sweep(sweep, out=out, executor=executor, progress=kill)
    assert 4 <= len(rows_of_journal(out)) < 60
    with ThreadPoolExecutor(2) as executor:
        caudal.sweep(sweep, out=out, executor=executor)
    assert results(out) == results(tmp_path / "ours")


def test_what_is_asked_of_an_engine_is_checked(sweep, tmp_path):
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(TypeError, match="either"):
            caudal.sweep(sweep, out=tmp_path / "out", executor=executor, client=object())
    with pytest.raises(caudal.errors.EngineError, match="accepts no more work"):
        caudal.sweep(sweep, out=tmp_path / "out", executor=executor)  # it was shut down
    assert not (tmp_path / "out/table.csv").exists()


def test_an_engine_from_which_nothing_comes_back_is_reported(sweep, tmp_path, monkeypatch):
    monkeypatch.setattr(distributing, "LOOK_S", 0.05)
    free = threading.Event()
    with ThreadPoolExecutor(1) as executor:
        executor.submit(free.wait)  # its only worker is busy with other things
        with pytest.warns(RuntimeWarning, match=r"no results for .* cases are outstanding"):
            threading.Timer(1.0, free.set).start()
            caudal.sweep(sweep, out=tmp_path / "out", executor=executor, patience_s=0.2)
    assert (tmp_path / "out/table.csv").exists()


def test_a_cluster_of_this_machine_gives_the_results_of_its_threads_to_the_bit(distributed, sweep, tmp_path):
    caudal.sweep(sweep, out=tmp_path / "ours")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**options) as here, distributed.Client(here) as client:
        caudal.sweep(sweep, out=tmp_path / "client", client=client)
        caudal.sweep(sweep, out=tmp_path / "executor", executor=client.get_executor())
    for name in ("client", "executor"):
        assert rows_of_journal(tmp_path / name) == rows_of_journal(tmp_path / "ours")
        assert results(tmp_path / name) == results(tmp_path / "ours")


def test_workers_of_a_cluster_that_are_killed_at_any_time_cost_no_case(distributed, tmp_path):
    psutil = pytest.importorskip("psutil")
    sweep = make_sweep(tmp_path, count=60, duration=8.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    (tmp_path / "cluster").mkdir()
    dice, killed = random.Random(1), []
    # No task is given up because its worker was killed, which these are more often than in life.
    with cluster(tmp_path / "cluster", workers=3, allowed_failures=100) as (file, processes):
        with client_of(distributed, file, workers=3) as client:

            def kill(done, of):
                if len(killed) < 6 and done >= 15 * (1 + len(killed)):
                    with contextlib.suppress(psutil.NoSuchProcess):  # it ended by itself: the next time
                        nannies = [psutil.Process(process.pid) for process in processes[1:]]
                        workers = [child for nanny in nannies for child in nanny.children(recursive=True) if child.children() == []]
                        worker = dice.choice(workers)
                        worker.kill()
                        killed.append(worker)

            caudal.sweep(sweep, out=tmp_path / "out", client=client, progress=kill)
    assert len(killed) == 6
    assert rows_of_journal(tmp_path / "out") == rows_of_journal(tmp_path / "ours")
    assert results(tmp_path / "out") == results(tmp_path / "ours")


#: What a worker of a cluster runs before its work: one part ends it, as one that needs too much memory would.
POISON = """
import json, os
from caudal import _caudal

def is_check(lines):  # which simulates once
    return len(json.loads(lines[0][17:])["result"]) == 1

def is_start(lines):
    return not is_check(lines)

def poisoned(bundle, indices):
    done = whole(bundle, indices)
    lines, _ = done
    if {bad} in indices and {when}:
        os._exit(1)
    return done

if not hasattr(_caudal, "_whole"):  # this is read more than once
    _caudal._whole = _caudal.{worker}
    _caudal.{worker} = poisoned
whole = _caudal._whole
"""


def test_a_case_that_ends_its_worker_is_named_and_its_neighbours_are_kept(distributed, sweep, tmp_path):
    caudal.sweep(sweep, out=tmp_path / "ours")
    poison = tmp_path / "poison.py"
    poison.write_text(POISON.format(worker="_cases", bad=7, when="True"))
    out = tmp_path / "out"
    (tmp_path / "cluster").mkdir()
    with cluster(tmp_path / "cluster", preload=poison, allowed_failures=0) as (file, _):
        with client_of(distributed, file) as client:
            with pytest.raises(caudal.errors.LostCasesError, match="case 7: actuation.kappa_amp") as caught:
                caudal.sweep(sweep, out=out, client=client)
    assert caught.value.cases == [7]
    ours = rows_of_journal(tmp_path / "ours")
    assert rows_of_journal(out) == {case: row for case, row in ours.items() if case != 7}
    assert [row["case"] for row in caught.value.rows] == [case for case in range(20) if case != 7]
    table = (tmp_path / "ours/table.csv").read_text().splitlines()
    assert (out / "table.csv").read_text().splitlines() == table[:8] + table[9:]
    caudal.sweep(sweep, out=out)  # here it does no harm
    assert results(out) == results(tmp_path / "ours")


def test_a_scheduler_that_is_killed_ends_the_sweep_with_an_error_and_the_command_goes_on(distributed, command, tmp_path):
    sweep = make_sweep(tmp_path, count=60, duration=8.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    out = tmp_path / "out"
    (tmp_path / "cluster").mkdir()
    with cluster(tmp_path / "cluster") as (file, processes):
        with client_of(distributed, file) as client:
            client._timeout = 1  # for connecting again

            def kill(done, of):
                if done >= 10:
                    processes[0].kill()

            with pytest.raises(caudal.errors.EngineError, match="the same call resumes there"):
                caudal.sweep(sweep, out=out, client=client, progress=kill)
    assert 10 <= len(rows_of_journal(out)) < 120
    command(None, "sweep", sweep, "--out", out)
    assert results(out) == results(tmp_path / "ours")


CLIENT = """
import sys, caudal
from distributed import Client
with Client(scheduler_file=sys.argv[1], timeout=60) as client:
    caudal.sweep(sys.argv[2], out=sys.argv[3], client=client, progress=lambda done, of: print(done, flush=True))
"""


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGINT])
def test_a_client_that_is_killed_or_interrupted_keeps_what_is_done_and_another_one_goes_on(distributed, sign, tmp_path):
    sweep = make_sweep(tmp_path, count=200, duration=8.0)
    caudal.sweep(sweep, out=tmp_path / "ours")
    out = tmp_path / "out"
    (tmp_path / "cluster").mkdir()
    with cluster(tmp_path / "cluster") as (file, _):
        arguments = [sys.executable, "-c", textwrap.dedent(CLIENT), file, sweep, out]
        handled = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
        client = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **handled)
        for line in client.stdout:
            if int(line) >= 5:
                client.send_signal(sign)
                break
        _, complaint = client.communicate(timeout=60)
        assert client.returncode != 0
        assert sign == signal.SIGKILL or "KeyboardInterrupt" in complaint
        kept = rows_of_journal(out)
        assert 5 <= len(kept) < 400
        with client_of(distributed, file) as client:
            told = []
            caudal.sweep(sweep, out=out, client=client, progress=lambda done, of: told.append(done))
    assert told[0] == len(kept), "cases that were there are not run again"
    assert results(out) == results(tmp_path / "ours")


DESIGN = {
    "rod.nodes": 7,
    "solver.duration_s": 1.0,
    "solver.time_step_s": 0.01,
    "solver.integrator": "generalized-alpha",
    "design": {
        "goal": "cycle_forward_speed_m_s",
        "variables": ["stiffness"],
        "knots": [0.2, 0.8],
        "starts": 3,
        "over": "media.toml",
        "bounds": [0.5, 2.0],
    },
}


def design_scene(folder):
    """An eel that is designed for two fluids, from three starts."""
    (folder / "eel.toml").write_text(Path("models/eel.toml").read_text())
    (folder / "media.toml").write_text('scene = "eel.toml"\n[axes]\nmedium.viscosity_pa_s = { factors = [1.0, 10.0] }\n')
    return caudal.load(folder / "eel.toml", set=DESIGN)


def files_of(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def test_starts_and_checks_of_a_design_are_simulated_by_any_executor_to_the_same_bits(tmp_path):
    scene = design_scene(tmp_path)
    ours, theirs = [], []
    caudal.design(scene, out=tmp_path / "ours", progress=lambda *told: ours.append(told))
    with ProcessPoolExecutor(2) as executor:
        found = caudal.design(scene, out=tmp_path / "theirs", executor=executor, progress=lambda *told: theirs.append(told))
    assert len(found.answer["starts"]) == 3 and len(found.cases) == 2
    assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")
    assert theirs == ours, "each iteration is told once"
    # A start that is known is not searched again, and the rest goes on without an engine.
    starts = caudal._caudal._design_parts(scene, tmp_path / "on", False, None)
    assert starts.noun == "start" and starts.todo() == [0, 1, 2]
    lines, _ = caudal._caudal._simulate(starts.bundle(), [1])
    assert starts.keep(lines) == 1 and starts.keep(lines) == 0 and starts.todo() == [0, 2]
    with pytest.raises(caudal.errors.Error, match="damaged"):
        starts.keep([lines[0][:-9] + b"\n"])
    starts.close()
    caudal.design(scene, out=tmp_path / "on")
    assert files_of(tmp_path / "on") == files_of(tmp_path / "ours")


def test_the_checks_of_a_design_are_parts_of_their_own(tmp_path):
    scene = caudal.load(design_scene(tmp_path), set={"design.starts": 1})
    whole = caudal.design(scene, out=tmp_path / "ours")
    checks = caudal._caudal._design_parts(scene, tmp_path / "theirs", False, None)
    # As designed, half the step, another method, a finer mesh, and perhaps another law: of two profiles, in two media.
    assert checks.noun == "check" and checks.size == 4 * len(whole.checks)
    assert checks.describe(2) == f"the scene's own, {whole.checks[0]['simulation']}, case 0"
    lines, times = caudal._caudal._simulate(checks.bundle(), [0, 1])
    values = [json.loads(line[17:])["result"][0]["value"]["objective"] for line in lines]
    assert min(values) == whole.checks[0]["designed"] and len(times) == 2
    assert checks.keep(lines) == 2 and checks.todo() == list(range(2, checks.size))
    with pytest.raises(caudal.errors.BundleError, match="no check 99"):
        caudal._caudal._simulate(checks.bundle(), [99])
    checks.close()
    with ThreadPoolExecutor(2) as executor:
        caudal.design(scene, out=tmp_path / "theirs", executor=executor)
    assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")


def test_a_design_that_is_ended_on_an_engine_has_the_best_until_then_and_goes_on(tmp_path):
    scene = design_scene(tmp_path)
    caudal.design(scene, out=tmp_path / "ours")

    class Enough(Exception):
        pass

    def stop(iteration, objective):
        told.append(iteration)
        if len(told) == 2:
            raise Enough

    told = []
    with ThreadPoolExecutor(2) as executor:
        with pytest.raises(Enough) as caught:
            caudal.design(scene, out=tmp_path / "theirs", executor=executor, progress=stop)
        assert caught.value.result.status == "interrupted" and len(told) == 2
        caudal.design(scene, out=tmp_path / "theirs", executor=executor)
    assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")


def test_a_design_is_simulated_by_a_cluster_to_the_same_bits(distributed, tmp_path):
    scene = design_scene(tmp_path)
    caudal.design(scene, out=tmp_path / "ours")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as here, distributed.Client(here) as client:
        caudal.design(scene, out=tmp_path / "theirs", client=client)
    assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")


@pytest.mark.parametrize("phase", ["start", "check"])
def test_a_start_or_check_of_a_design_that_ends_its_worker_is_named_and_the_others_are_kept(distributed, phase, tmp_path):
    scene = design_scene(tmp_path)
    caudal.design(scene, out=tmp_path / "ours")
    poison = tmp_path / "poison.py"
    poison.write_text(POISON.format(worker="_simulate", bad=1, when=f"is_{phase}(lines)"))
    out = tmp_path / "out"
    (tmp_path / "cluster").mkdir()
    with cluster(tmp_path / "cluster", preload=poison, allowed_failures=0) as (file, _):
        with client_of(distributed, file) as client:
            with pytest.raises(caudal.errors.LostCasesError, match=f"1 {phase} crashed the worker.*{phase} 1: ") as caught:
                caudal.design(scene, out=out, client=client)
    assert caught.value.cases == [1] and caught.value.rows == []
    parts = caudal._caudal._design_parts(scene, out, False, None)
    assert parts.noun == phase and parts.todo() == [1]
    parts.close()
    caudal.design(scene, out=out)  # here it does no harm
    assert files_of(out) == files_of(tmp_path / "ours")


def test_a_start_that_breaks_a_pool_of_processes_is_among_those_named(tmp_path, monkeypatch):
    from multiprocessing import get_context

    scene = design_scene(tmp_path)
    caudal.design(scene, out=tmp_path / "ours")
    fine = caudal._caudal._simulate

    def poisoned(bundle, indices):
        if 2 in indices:
            os._exit(1)
        return fine(bundle, indices)

    monkeypatch.setattr(caudal._caudal, "_simulate", poisoned)
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as executor:
        with pytest.raises(caudal.errors.EngineError, match=r"starts outstanding: 2\).*2 of 3 starts are stored"):
            caudal.design(scene, out=tmp_path / "theirs", executor=executor)
    monkeypatch.setattr(caudal._caudal, "_simulate", fine)
    caudal.design(scene, out=tmp_path / "theirs")
    assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")


ORPHANED = """
import os, sys, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import caudal

def slow(bundle, indices, fine=caudal._caudal._cases):
    os.write(1, f"{os.getpid()}\\n".encode())  # a line at once, as there are two of them
    time.sleep(60)
    return fine(bundle, indices)

caudal._caudal._cases = slow
with ProcessPoolExecutor(2, mp_context=get_context("fork")) as executor:
    caudal.sweep("models/glycerol.toml", {"actuation.frequency_hz": [1.0, 2.0]}, set={"solver.duration_s": 0.02}, out=sys.argv[1], executor=executor)
"""


def test_a_sweep_goes_on_beside_the_orphans_of_a_pool_that_was_killed(tmp_path):
    out = tmp_path / "out"
    at_work = subprocess.Popen([sys.executable, "-c", ORPHANED, out], stdout=subprocess.PIPE, text=True)
    child = int(at_work.stdout.readline())
    again = {"set": {"solver.duration_s": 0.02}, "out": out}
    with pytest.raises(caudal.errors.JournalError, match=rf"process {at_work.pid} \(.*\) is using it"):
        caudal.sweep("models/glycerol.toml", {"actuation.frequency_hz": [1.0, 2.0]}, **again)
    at_work.kill()
    at_work.wait()
    try:
        os.kill(child, 0)  # it lives on
        rows = caudal.sweep("models/glycerol.toml", {"actuation.frequency_hz": [1.0, 2.0]}, **again)
        assert len(rows) == 2
    finally:
        for process in orphans_of(at_work, child):
            os.kill(process, signal.SIGKILL)


def orphans_of(parent, child):
    """The processes of the pool that `parent` left behind, which share the group of `child`."""
    group = os.getpgid(child)
    found = [int(name) for name in os.listdir("/proc") if name.isdigit()]
    return [pid for pid in found if pid not in (os.getpid(), parent.pid) and is_of(pid, group)]


def is_of(pid, group):
    try:
        return os.getpgid(pid) == group and ORPHANED.encode() in open(f"/proc/{pid}/cmdline", "rb").read()
    except OSError:
        return False


STUDIES = {
    "stability": ("models/baseline-smooth.toml", {"points": 2, "range": [1e9, 1e10], "steps": [1e-3, 1e-2]}),
    "flow": ("models/flag.toml", {"vary": "flow", "points": 2}),
    "fluid": ("models/eel.toml", {}),
    "accuracy": ("models/baseline-smooth.toml", {"nodes": [9], "steps": [1e-3, 5e-4], "tolerances": [1e-3]}),
    "pairs": ("models/baseline.toml", {"nodes": [9], "steps": [1e-3, 5e-4], "tolerances": [1e-3]}),
}
#: What the findings of a study tell of times, which no two runs share.
TIMES = ("wall_s", "processor_s")
#: The table of the cheapest step to each target: where two take about the same time, either may be it.
CHOSEN_BY_TIME = "targets"


def without_times(findings):
    """All that a study found but how long it took."""
    tables = {
        name: {column: values for column, values in table.items() if not column.endswith(TIMES)}
        for name, table in findings.tables.items()
        if name != CHOSEN_BY_TIME
    }
    return tables, sorted(findings.figures)


@pytest.mark.parametrize("name", STUDIES)
def test_the_runs_of_a_study_are_made_by_any_executor_to_the_same_numbers(name, tmp_path):
    file, options = STUDIES[name]
    kind = {"flow": "stability", "pairs": "accuracy"}.get(name, name)
    scene = caudal.load(file, set={"solver.duration_s": 0.05} if "baseline" in file else {})
    ours = caudal.study(kind, scene, out=tmp_path / "ours", **options)
    told = []
    with ThreadPoolExecutor(2) as executor:
        theirs = caudal.study(
            kind, scene, out=tmp_path / "theirs", executor=executor, progress=lambda *done: told.append(done), **options
        )
    assert without_times(theirs) == without_times(ours)
    assert files_of(tmp_path / "theirs").keys() == files_of(tmp_path / "ours").keys(), "no journal is left"
    if kind == "stability":
        assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")
    assert told[0][0] == 0 and told[-1][0] == told[-1][1]


def test_a_study_goes_on_with_the_runs_that_an_engine_made(tmp_path):
    file, options = STUDIES["stability"]
    scene = caudal.load(file, set={"solver.duration_s": 0.05})
    caudal.study("stability", scene, out=tmp_path / "ours", **options)
    out = tmp_path / "theirs"
    runs = caudal._caudal._runs_of(scene, "stability", options, out, False)
    lines, times = caudal._caudal._runs(runs.bundle(), [3, 5])
    assert runs.keep(lines) == 2 and runs.keep(lines) == 0 and len(times) == 2
    assert set(range(runs.size)) - set(runs.todo()) == {3, 5}
    assert "step" in runs.describe(3)
    with pytest.raises(caudal.errors.JournalError, match="damaged"):
        runs.keep([lines[0][:-9] + b"\n"])
    with pytest.raises(caudal.errors.BundleError, match="no run 99"):
        caudal._caudal._runs(runs.bundle(), [99])
    runs.close()
    told = []
    caudal.study("stability", scene, out=out, progress=lambda *done: told.append(done), **options)
    assert all(done >= 2 for done, of in told if of > 0)
    assert files_of(out) == files_of(tmp_path / "ours")


def test_a_study_of_this_machine_is_not_made_elsewhere(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        for kind in ("modes", "scaling"):
            with pytest.raises(caudal.errors.StudyError, match=f"{kind}: found with an engine; allowed with one: accuracy"):
                caudal.study(kind, "models/baseline.toml", out=tmp_path / kind, executor=executor)


def test_the_runs_of_a_study_are_made_by_a_cluster_and_one_that_ends_its_worker_is_named(distributed, tmp_path):
    file, options = STUDIES["stability"]
    scene = caudal.load(file, set={"solver.duration_s": 0.05})
    caudal.study("stability", scene, out=tmp_path / "ours", **options)
    poison = tmp_path / "poison.py"
    poison.write_text(POISON.format(worker="_runs", bad=7, when="True"))
    (tmp_path / "cluster").mkdir()
    with cluster(tmp_path / "cluster", preload=poison, allowed_failures=0) as (file, _):
        with client_of(distributed, file) as client:
            with pytest.raises(caudal.errors.LostCasesError, match="1 run crashed the worker.*run 7: ") as caught:
                caudal.study("stability", scene, out=tmp_path / "theirs", client=client, **options)
    assert caught.value.cases == [7]
    with ThreadPoolExecutor(1) as executor:
        caudal.study("stability", scene, out=tmp_path / "theirs", executor=executor, **options)
    assert files_of(tmp_path / "theirs") == files_of(tmp_path / "ours")
