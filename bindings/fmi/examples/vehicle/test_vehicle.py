"""The coupling's imbalance falls with the coupling step, at the order of each master."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
vehicle = pytest.importorskip("vehicle", exc_type=ImportError)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    command = os.environ.get("CAUDAL_COMMAND")
    if not command:
        pytest.skip("CAUDAL_COMMAND names no caudal command that writes the FMU")
    path = tmp_path_factory.mktemp("fmu") / "tail.fmu"
    subprocess.run([command, "fmu", HERE / "tail.toml", "-o", path], check=True)
    return str(path)


@pytest.mark.parametrize("iterate, order, tolerance", [(False, 1, 0.15), (True, 2, 0.25)])
def test_the_imbalance_falls_with_the_coupling_step(fmu, iterate, order, tolerance):
    steps = np.array([4, 8, 16])
    imbalances = vehicle.balance(fmu, steps, iterate, 0.64)
    orders = np.log2(imbalances[1:] / imbalances[:-1])
    print("orders of linear momentum, angular momentum, energy:", orders)
    np.testing.assert_allclose(orders, order, atol=tolerance)
