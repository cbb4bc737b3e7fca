"""Threads use every face at once: nothing waits for ever, and each gets what it gets alone."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

#: How long the threads go on, s; for a long walk CAUDAL_THREADS_S=600.
DURATION = float(os.environ.get("CAUDAL_THREADS_S", "3"))

PROGRAM = """
    import faulthandler, tempfile, threading, time
    import numpy as np
    import caudal

    faulthandler.dump_traceback_later({limit}, exit=True)
    short = {{"solver.duration_s": 0.1}}
    scene = caudal.load("models/glycerol.toml", set=short)
    shared = caudal.simulate(scene, "tip_y_m")
    weights = {{"tip_y_m": np.ones_like(shared.times_s)}}
    by = ["medium.viscosity_pa_s"]
    alone = shared.pull_back(weights, by)
    tip = caudal.run(scene, record=["tip_y_m"])["tip_y_m"]

    def pull_back():
        assert shared.pull_back(weights, by) == alone

    def run():
        assert np.array_equal(caudal.run(scene, record=["tip_y_m"], progress=lambda *_: None)["tip_y_m"], tip)

    def sweep():
        with tempfile.TemporaryDirectory() as folder:
            rows = caudal.sweep(scene, {{"actuation.kappa_amp": [0.3, 0.6]}}, out=folder, jobs=2, progress=lambda *_: None)
            assert rows.complete

    def step():
        stepper = caudal.Stepper(scene)
        for _ in range(10):
            stepper.do_step(0.01)
        assert stepper.get("tip_y_m") == stepper.get("tip_y_m")

    def simulate():
        value, slope = caudal.value_and_grad(scene, "tip_y_m", by)
        assert np.isfinite(value)

    def study():
        with tempfile.TemporaryDirectory() as folder:
            caudal.study("modes", scene, count=2, out=folder, progress=lambda *_: None)

    end, failures = time.monotonic() + {duration}, []

    def go_on(act):
        try:
            while time.monotonic() < end:
                act()
        except BaseException as error:
            failures.append((act.__name__, error))

    acts = [pull_back, pull_back, run, sweep, step, simulate, study]
    threads = [threading.Thread(target=go_on, args=(act,)) for act in acts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures, failures
    print("done")
"""


def test_threads_of_every_face_end_and_find_what_one_alone_finds():
    program = textwrap.dedent(PROGRAM).format(limit=DURATION + 120, duration=DURATION)
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=Path.cwd(), timeout=DURATION + 240)
    assert ended.returncode == 0 and "done" in ended.stdout, ended.stdout + ended.stderr
