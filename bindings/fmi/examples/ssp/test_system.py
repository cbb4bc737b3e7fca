"""SSP systems of one and two tails behind a vehicle, in two hosts."""

import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "vehicle")]
vehicle = pytest.importorskip("vehicle", exc_type=ImportError)
pytest.importorskip("pythonfmu")
pytest.importorskip("ecos_host", exc_type=ImportError)
import system  # noqa: E402

STEP, COUNT = 4e-3, 200


@pytest.fixture(scope="module")
def parts(make_fmu, tmp_path_factory):
    """The body's FMU, a tail's, and that of its mirror image."""
    scene = HERE.parent / "vehicle/tail.toml"
    tails = [make_fmu(scene, "--fmi=2", f"--set=actuation.kappa_amp={sign}16") for sign in ("", "-")]
    return [system.build_body(tmp_path_factory.mktemp("body")), *tails]


def test_both_hosts_run_a_vehicle_and_its_tail_as_a_master_of_our_own_does(parts, make_fmu, tmp_path):
    body, tail, _ = parts
    path = tmp_path / "swimmer.ssp"
    system.write(path, body, {"stern": tail})
    found = np.array([host(path, STEP, COUNT) for host in (system.with_fmpy, system.with_ecos)])
    assert np.array_equal(*found), np.abs(found[0] - found[1]).max()
    scheme = next(scheme for scheme in vehicle.SCHEMES if scheme.name == "Jacobi, pose and rates")
    fmus = {"now": make_fmu(HERE.parent / "vehicle/tail.toml")}
    own = vehicle.simulate(fmus, scheme, round(STEP / vehicle.STEP), STEP * COUNT).vehicle[1:]
    assert np.abs(own[-1, :3] - own[0, :3]).max() > 1e-3, "it moves"
    assert np.array_equal(found[0], own), np.abs(found[0] - own).max()


def test_two_tails_that_beat_as_mirror_images_push_a_body_straight_ahead(parts, tmp_path):
    body, tail, mirrored = parts
    path = tmp_path / "swimmer.ssp"
    system.write(path, body, {"port": tail, "starboard": mirrored})
    for host in (system.with_fmpy, system.with_ecos):
        x, y, angle, *_ = np.transpose(host(path, STEP, COUNT))
        assert np.abs(x - x[0]).max() > 5e-4
        assert not y.any() and not angle.any()  # exactly
