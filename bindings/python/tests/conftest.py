"""What the tests share: they run at the root of the project, where the models are."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import caudal

ROOT = Path(__file__).parents[3]
os.chdir(ROOT)

#: Several methods, forms and heads, short.
SCENES = {
    "baseline": ("models/baseline.toml", {"solver.duration_s": 0.5}),
    "driven-head": ("models/driven-head.toml", {"solver.duration_s": 0.4}),
    "cantilever": ("models/cantilever.toml", {"solver.integrator": "generalized-alpha", "solver.duration_s": 0.2}),
    "glycerol": ("models/glycerol.toml", {"solver.integrator": "esdirk3", "solver.duration_s": 0.1}),
    "chain": ("models/baseline-smooth.toml", {"solver.form": "chain", "solver.duration_s": 0.5}),
}




def pytest_collectreport(report):
    pytest_runtest_logreport(report)


def pytest_runtest_logreport(report):
    """Each reason to skip goes to the file that CAUDAL_SKIPPED names, where tests/all.sh collects them."""
    path = os.environ.get("CAUDAL_SKIPPED")
    if path and report.skipped:
        reason = report.longrepr[2].removeprefix("Skipped: ")
        with open(path, "a") as file:
            file.write(" ".join(reason.split()) + "\n")


@pytest.fixture(params=SCENES)
def scene(request):
    """Each of the scenes."""
    path, changes = SCENES[request.param]
    return caudal.load(path, set=changes)


@pytest.fixture(scope="session")
def command():
    """The command that comes with the package."""
    path = shutil.which("caudal", path=str(Path(sys.executable).parent))
    if not path:
        pytest.skip("the package is installed without its command: pip install ./bindings/python")

    def run(scene, *arguments):
        overrides = [f"--set={assignment}" for assignment in (scene.overrides if scene else [])]
        return subprocess.run([path, *arguments, *overrides], check=True, capture_output=True, text=True)

    return run


@pytest.fixture
def read_summary():
    """The content of a folder's summary.json, all floats to the bit."""
    return lambda folder: json.loads((Path(folder) / "summary.json").read_text())
