"""Every example in docstrings and in the README runs; everything public is documented and typed."""

import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import caudal
import caudal.errors
import caudal.gradients
import caudal.result
import caudal.studying

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
HERE = Path(__file__).parent
#: Modules that need a package which may not be installed.
ALLOWED = ["--allowlist", str(HERE / "stubtest.txt"), "--ignore-unused-allowlist", "--mypy-config-file", str(HERE / "mypy.ini")]
CONFIGURED = ["--config-file", str(HERE / "mypy.ini")]


def public(owner):
    return {name: member for name, member in vars(owner).items() if not name.startswith("_")}


def test_examples_in_docstrings():
    for module, least in [(caudal, 2), (caudal.result, 2), (caudal.studying, 1), (caudal.gradients, 3)]:
        tests = [test for test in doctest.DocTestFinder().find(module) if test.examples]
        assert len(tests) >= least, module
        runner = doctest.DocTestRunner(optionflags=FLAGS)
        for test in tests:
            assert runner.run(test).failed == 0, test.name


def test_examples_in_the_readme():
    outcome = doctest.testfile(str(HERE.parent / "README.md"), module_relative=False, optionflags=FLAGS)
    assert outcome.attempted > 10 and outcome.failed == 0


def test_everything_public_has_a_docstring():
    classes = [caudal.Scene, caudal.Stepper, caudal.Snapshot, caudal.Variable, caudal.Result, caudal.Findings, caudal.Simulation]
    errors = [member for member in public(caudal.errors).values() if inspect.isclass(member)]
    for owner in [caudal, caudal.errors, caudal.load, caudal.run, caudal.sweep, caudal.study, caudal.design, caudal.simulate, caudal.value_and_grad, *classes, *errors]:
        assert inspect.getdoc(owner), owner
    for owner in classes:
        for name, member in public(owner).items():
            if owner is not caudal.Variable:  # its attributes are in its own
                assert inspect.getdoc(member), f"{owner.__name__}.{name}"


def test_stubs_name_what_there_is():
    """stubtest of mypy: the .pyi and the module have the same names and signatures."""
    pytest.importorskip("mypy", reason="pip install mypy")
    for command in (["-m", "mypy.stubtest", "caudal", "--ignore-missing-stub", *ALLOWED], ["-m", "mypy", *CONFIGURED, "--strict", "-p", "caudal"]):
        outcome = subprocess.run([sys.executable, *command], capture_output=True, text=True, cwd=HERE)
        assert outcome.returncode == 0, outcome.stdout + outcome.stderr


def test_every_error_of_the_library_has_its_class():
    source = (HERE.parents[2] / "src/error.rs").read_text()
    body = source[source.index("pub enum Error") : source.index("\n}\n", source.index("pub enum Error"))]
    variants = [
        line.strip().rstrip(",{ ").split("(")[0]
        for line in body.splitlines()[1:]
        if line.startswith("    ") and line[4].isupper()
    ]
    assert "NotConverged" in variants and len(variants) > 15
    without = {variant for variant in variants if not hasattr(caudal.errors, f"{variant}Error")}
    assert without == {"Page", "OutsideStep"}  # nothing to tell by; and what no call here can ask for
