"""The coupling's imbalance falls with the coupling step, at the order of each scheme."""

import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
vehicle = pytest.importorskip("vehicle", exc_type=ImportError)


@pytest.fixture(scope="module")
def fmus(make_fmu):
    return {head: make_fmu(HERE / "tail.toml", f"--set=head.input={head}") for head in ("now", "at-end")}


def test_a_light_vehicle_needs_iteration(fmus, monkeypatch):
    """Half as heavy as the tail: what docs/src/co-simulation.md says of it."""
    mass = 0.5 * 0.0165876
    monkeypatch.setattr(vehicle.Vehicle, "MASS", mass)
    monkeypatch.setattr(vehicle.Vehicle, "INERTIA", 0.01 * mass)
    first, iterated = vehicle.SCHEMES[4], vehicle.SCHEMES[-2]._replace(relaxation=0.5)

    def speed(scheme, count):
        return np.hypot(*vehicle.simulate(fmus, scheme, count, 1.0).vehicle[-1, 3:5])

    assert abs(speed(iterated, 2) / speed(iterated, 1) - 1) < 0.01  # measured 0.0393 m/s at both
    assert abs(speed(first, 1) / speed(iterated, 1) - 1) < 0.02  # measured 0.0395 m/s
    assert speed(first, 2) > 0.3  # measured 0.786 m/s


@pytest.mark.parametrize("ratio", [10, 1, 0.1])
def test_the_interface_jacobian_makes_passes_agree_at_once(fmus, monkeypatch, ratio):
    """Vehicles of these masses over the tail's: what docs/src/co-simulation.md says of them."""
    mass = ratio * 0.0165876
    monkeypatch.setattr(vehicle.Vehicle, "MASS", mass)
    monkeypatch.setattr(vehicle.Vehicle, "INERTIA", 0.01 * mass)
    history = vehicle.simulate(fmus, vehicle.SCHEMES[-1], 1, 0.5)
    assert history.passes < 2.3  # measured 2.00; a fixed point takes 3.8 and 5.3, and fails
    assert np.abs(history.lost[:, :2]).max() < 2e-8  # measured 9e-9 N s


@pytest.mark.parametrize("scheme", vehicle.SCHEMES, ids=lambda scheme: scheme.name)
def test_the_imbalance_falls_with_the_coupling_step(fmus, scheme):
    coarse, fine = vehicle.balance(fmus, scheme, [8, 2], 0.96)
    orders = np.log2(coarse / fine) / 2
    print("orders of linear momentum, angular momentum, energy:", orders)
    # Measured: 0.97 to 1.29 of those of first order, 1.93 to 2.53 of those of second.
    assert np.all((scheme.order - 0.1 < orders) & (orders < scheme.order + 0.6))
