"""Runs: the command's own numbers to the bit, arrays, tables, figures, animation; failures and interrupts keep results."""

import base64
import csv
import html
import json
import math
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import caudal


def rows_of(path):
    with open(path, newline="") as file:
        header, *rows = csv.reader(file)
    return {name: np.array([float(row[i]) for row in rows]) for i, name in enumerate(header)}


def test_the_trajectory_is_the_command_s_to_the_bit(scene, command, tmp_path, read_summary):
    path = tmp_path / "scene.toml"
    path.write_text(scene.text)
    command(scene, "run", path, "--out", tmp_path / "out")
    result = caudal.run(scene)
    for name, values in rows_of(tmp_path / "out/trajectory.csv").items():
        np.testing.assert_array_equal(result[name], values, name)
    nodes = rows_of(tmp_path / "out/nodes.csv")
    for k in range(scene.nodes):
        np.testing.assert_array_equal(result["x_m"][:, k], nodes[f"x{k}_m"])
        np.testing.assert_array_equal(result["y_m"][:, k], nodes[f"y{k}_m"])
    for key, value in read_summary(tmp_path / "out").items():
        if key not in ("name", "scene_file", "wall_s"):
            assert result.summary[key] == value, key


def test_out_leaves_the_files_of_the_command(scene, command, tmp_path):
    path = tmp_path / f"{scene.name}.toml"
    path.write_text(scene.text)
    command(scene, "run", path, "--out", tmp_path / "theirs")
    caudal.run(scene, out=tmp_path / "ours")
    theirs, ours = ({file.name for file in (tmp_path / folder).iterdir()} for folder in ("theirs", "ours"))
    assert theirs == ours
    for name in theirs - {"summary.json", "report.html", "manifest.json"}:  # wall-clock time; the scene's place
        assert (tmp_path / "theirs" / name).read_bytes() == (tmp_path / "ours" / name).read_bytes(), name


def test_recorded_times_nodes_and_variables_are_those_asked_for():
    scene = caudal.load(
        "models/glycerol.toml",
        set={"solver.duration_s": 0.1, "record.interval_s": 0.03, "record.nodes": [0, -1]},
    )
    result = caudal.run(scene)
    np.testing.assert_allclose(result["time_s"], [0, 0.03, 0.06, 0.09, 0.1], atol=1e-15)
    assert list(result.nodes) == [0, 8]
    assert result["x_m"].shape == (5, 2)
    every = caudal.run(caudal.load(scene, set={"record.nodes": list(range(9))}), record=["x_m", "curvature_1_m"])
    assert list(every) == ["time_s", "x_m", "curvature_1_m"]
    np.testing.assert_array_equal(every["x_m"][:, [0, 8]], result["x_m"])
    assert every["curvature_1_m"].shape == (5, 7)
    assert caudal.run(scene, record="tip_x_m")["tip_x_m"].shape == (5,)
    with pytest.raises(caudal.errors.UnknownVariableError, match="tip_x_m"):
        caudal.run(scene, record=["tip_x"])
    many = caudal.load(scene, set={"rod.nodes": 300, "record": {"interval_s": 0.05, "nodes": list(range(300))}})
    assert "x_m" not in caudal.run(many)


def test_a_result_is_a_mapping_a_data_frame_and_figures(scene, tmp_path):
    pandas, matplotlib = pytest.importorskip("pandas"), pytest.importorskip("matplotlib")
    result = caudal.run(scene)
    assert len(result) == len(list(result)) == len(result.variables)
    frame = result.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    np.testing.assert_array_equal(frame.index, result["time_s"])
    np.testing.assert_array_equal(frame[f"y_m[{scene.nodes - 1}]"], result["y_m"][:, -1])
    np.testing.assert_array_equal(frame["kinetic_energy_j"], result["kinetic_energy_j"])
    names = [None, *(name for name in ("tip_y_m", "x_m", "head_moment_n_m") if name in result)]
    for i, figure in enumerate([result.plot(), result.plot("tip_dy_m"), result.plot("tip_dy_m", "x_m")]):
        assert isinstance(figure, matplotlib.figure.Figure)
        figure.savefig(tmp_path / f"{i}.png")
        assert (tmp_path / f"{i}.png").stat().st_size > 5000
    assert names
    with pytest.raises(KeyError, match="tip_dz"):
        result.plot("tip_dz")


def test_a_notebook_shows_the_run_moving(scene):
    result = caudal.run(scene)
    [page] = re.findall(r'srcdoc="([^"]*)"', result._repr_html_())
    page = html.unescape(page)
    assert page == result.to_html()
    [motion] = re.findall(r'<script id="motion" type="application/json">(.*?)</script>', page, re.DOTALL)
    motion = json.loads(motion)
    np.testing.assert_allclose(motion["times"], result["time_s"][:: max(1, len(result["time_s"]) // 1200)][: len(motion["times"])], rtol=1e-8)
    # In single precision, relative to the centre of mass.
    points = np.frombuffer(base64.b64decode(motion["points"]), "<f4").reshape(len(motion["times"]), -1, 2)
    last = points[-1] + motion["com"][-1]
    np.testing.assert_allclose(last[:, 0], result["x_m"][-1], atol=1e-4)


def test_progress_is_told_and_ends_the_run_where_it_says_so():
    seen = []
    scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 20.0, "rod.nodes": 200})
    result = caudal.run(scene, progress=lambda time_s, duration_s: seen.append((time_s, duration_s)) or len(seen) < 3)
    assert len(seen) == 3 and seen == sorted(seen) and seen[0][1] == 20.0
    assert not result.complete and result.summary["ending"] == "interrupted"
    assert result["time_s"][-1] == seen[-1][0] < 20.0
    finished = []
    assert caudal.run(caudal.load(scene, set={"solver.duration_s": 0.01}), progress=lambda *t: finished.append(t)).complete
    assert finished == [(0.01, 0.01)]

    def broken(time_s, duration_s):
        raise RuntimeError("the callback's own")

    with pytest.raises(RuntimeError, match="the callback's own") as caught:
        caudal.run(scene, progress=broken)
    assert caught.value.result["time_s"][-1] > 0


def test_a_failed_step_is_an_exception_with_its_numbers_and_what_came_before():
    scene = caudal.load("models/baseline.toml", set={"solver.integrator": "newmark"})  # it fails within 2 s
    with pytest.raises(caudal.Error) as caught:
        caudal.run(scene)
    error = caught.value
    assert isinstance(error, ArithmeticError) and 0 < error.time_s < 2 and 0 <= error.node < 9
    assert not error.result.complete and error.result.summary["ending"] == str(error)
    assert 0 < error.result["time_s"][-1] <= error.time_s
    assert "did not reach its end" in error.result._repr_html_()


INTERRUPTED = """
import caudal, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 1e6, "rod.nodes": 100, "record.every": 1000000})
try:
    print("started", flush=True)
    if sys.argv[1] == "run":
        caudal.run(scene)
    elif sys.argv[1] == "do_step":
        stepper = caudal.Stepper(scene)
        stepper.do_step(1e6)
    else:
        scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 1e4, "rod.nodes": 100})
        if sys.argv[1] == "simulate":
            caudal.simulate(scene, ["tip_dy_m"])
        else:
            caudal.value_and_grad(scene, "tip_dy_m", ["rod.youngs_modulus_pa"])
except KeyboardInterrupt as interrupt:
    if sys.argv[1] in ("run", "do_step"):
        end = interrupt.result["time_s"][-1] if sys.argv[1] == "run" else stepper.time_s
        assert 0 < end < 1e6
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("what", ["run", "do_step", "simulate", "value_and_grad"])
@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
def test_ctrl_c_ends_long_computations_and_keeps_what_they_have(what):
    process = subprocess.Popen([sys.executable, "-c", INTERRUPTED, what], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "started\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=10)[0] == "interrupted\n"
    assert process.returncode == 0


def test_runs_in_threads_run_in_parallel_and_agree():
    scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 4.0, "rod.nodes": 65})
    ends = {}

    def work(i):
        ends[i] = caudal.run(scene)["tip_dy_m"]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    # While they compute, this thread has Python for itself.
    [thread.start() for thread in threads]
    turns = 0
    while any(thread.is_alive() for thread in threads):
        turns += 1
        time.sleep(0.001)
    assert turns > 10
    assert all(np.array_equal(end, ends[0]) for end in ends.values())
    assert math.isfinite(ends[0][-1])


def test_what_cannot_be_written_is_an_error_and_wrong_arguments_too(tmp_path):
    scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.01})
    (tmp_path / "file").write_text("")
    with pytest.raises(caudal.errors.WriteError) as caught:
        caudal.run(scene, out=tmp_path / "file")
    assert Path(caught.value.path) == tmp_path / "file" and isinstance(caught.value, OSError)
    with pytest.raises(TypeError):
        caudal.run(scene, progress=3)


def measured(stiffness):
    """A run, perhaps in another process."""
    changes = {"rod.youngs_modulus_pa": stiffness, "solver.duration_s": 0.2}
    return caudal.run(caudal.load("models/driven-head.toml", set=changes))


def test_results_are_pickled_with_everything_they_hold(scene):
    result = caudal.run(scene)
    copy = pickle.loads(pickle.dumps(result))
    assert copy.summary == result.summary and copy.variables == result.variables and copy.notes == result.notes
    assert copy.to_html() == result.to_html() and copy.scene.text == scene.text
    for name in result:
        np.testing.assert_array_equal(copy[name], result[name])


def test_runs_in_other_processes_are_the_same():
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        runs = pool.map(measured, [1e6, 4e6])
    for stiffness, there in zip([1e6, 4e6], runs):
        np.testing.assert_array_equal(there["tip_dy_m"], measured(stiffness)["tip_dy_m"])


def test_a_failure_is_pickled_with_its_numbers_and_its_result():
    with pytest.raises(caudal.Error) as caught:
        caudal.run(caudal.load("models/baseline.toml", set={"solver.integrator": "newmark"}))
    copy = pickle.loads(pickle.dumps(caught.value))
    assert type(copy) is type(caught.value) and str(copy) == str(caught.value)
    assert copy.time_s == caught.value.time_s and len(copy.result["time_s"]) == len(caught.value.result["time_s"])


def test_a_name_that_is_not_recorded_is_a_key_error_with_the_nearest_names():
    result = caudal.run(caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.02}))
    with pytest.raises(KeyError, match="did you mean `tip_dx_m` or .*run") as caught:
        result["tip_x_m"]
    assert isinstance(caught.value, caudal.errors.UnknownVariableError)
    assert (caught.value.name, caught.value.nearest) == ("tip_x_m", "tip_dx_m")
    with pytest.raises(KeyError, match="`speed` is not recorded; .*time_s"):
        result["speed"]
    assert "speed" not in result and result.get("speed") is None


def test_the_averages_over_cycles_are_in_the_summary_and_in_the_stepper():
    with caudal.Stepper("models/driven-head.toml") as tail:
        tail.do_step(1.0)
        assert tail.get("cycles_used") >= 1 and tail.get("cycle_thrust_n") != 0.0
    summary = caudal.run("models/driven-head.toml").summary
    assert summary["cycles_used"] >= 1 and summary["cycle_thrust_n"] == pytest.approx(summary["mean_thrust_n"], rel=1.0)
    assert {"cycle_speed_m_s", "cycle_speed_spread_m_s", "cycle_efficiency", "cycles_periodic"} <= set(summary)
