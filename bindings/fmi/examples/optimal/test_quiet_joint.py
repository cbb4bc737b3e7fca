"""Exact directional derivatives of an FMU in CasADi: they are right, and the controller that needs them works."""

import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "vehicle")]
pytest.importorskip("fmpy")
pytest.importorskip("casadi")
import quiet_joint  # noqa: E402


@pytest.fixture(scope="module")
def fmu(make_fmu):
    return make_fmu(HERE.parent / "vehicle/tail.toml")


def test_the_jacobian_that_casadi_gets_is_that_of_differences(fmu):
    tail = quiet_joint.Tail(fmu)
    tail.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.3)
    reaction = quiet_joint.Reaction(tail)
    at, h = np.array([3.0, -2.0]), 1e-3
    exact = jacobian_of(reaction, at)
    both = [(reaction(at + d).full() - reaction(at - d).full()) / (2 * h) for d in h * np.eye(2)]
    differences = np.hstack(both)
    tail.close()
    print(exact, np.abs(exact - differences).max() / np.abs(exact).max())
    assert np.abs(exact).max() > 1e-5
    np.testing.assert_allclose(exact, differences, rtol=0, atol=1e-10 * np.abs(exact).max())  # measured: 5.9e-13


def jacobian_of(reaction, at):
    import casadi

    x = casadi.MX.sym("x", len(at))
    return casadi.Function("slopes", [x], [casadi.jacobian(reaction(x), x)])(at).full()


def test_the_controller_takes_the_moment_of_the_reaction_away(fmu):
    (loose, _, _), (quiet, added, iterations) = (quiet_joint.simulate(fmu, 1.2, control) for control in (False, True))
    before, after = (np.sqrt((rows[len(rows) // 2 :, 1] ** 2).mean()) for rows in (loose, quiet))
    print(before / after, np.abs(added).max(), iterations)
    assert before > 10 * after  # measured: 19
    assert np.abs(added).max() < quiet_joint.LARGEST and iterations < 10  # measured: 28, 6.7
