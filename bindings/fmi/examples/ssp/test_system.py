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
    system.write_swimmer(path, body, {"stern": tail})
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
    system.write_swimmer(path, body, {"port": tail, "starboard": mirrored})
    for host in (system.with_fmpy, system.with_ecos):
        x, y, angle, *_ = np.transpose(host(path, STEP, COUNT))
        assert np.abs(x - x[0]).max() > 5e-4
        assert not y.any() and not angle.any()  # exactly


def test_a_controller_holds_a_hinged_head_at_its_angle_in_both_hosts_as_in_a_loop_of_our_own(make_fmu, tmp_path):
    caudal = pytest.importorskip("caudal", exc_type=ImportError)
    controller = pytest.importorskip("controller", exc_type=ImportError)
    scene = HERE.parents[3] / "models/servo-tail.toml"
    bare = {"head.angle_rad": 0.0, "head.stiffness_n_m": 0.0, "rod.loss_frequency_hz": 2.0}
    step, count = 2e-3, 1000
    path = tmp_path / "loop.ssp"
    tail = make_fmu(scene, "--fmi=2", *(f"--set={key}={value}" for key, value in bare.items()))
    system.write_loop(path, system.build("controller.py", tmp_path), tail)
    hosts = (system.with_fmpy, system.with_ecos)
    found = np.array([np.ravel(host(path, step, count, "tail", ["hinge_angle_rad"])) for host in hosts])
    assert np.array_equal(*found), np.abs(found[0] - found[1]).max()
    # Both step at once with what the other gave before.
    own, pid, rows, torque = caudal.Stepper(caudal.load(scene, bare)), controller.Pid(), [], 0.0
    for _ in range(count):
        seen = own.get("hinge_angle_rad"), own.get("hinge_spin_rad_s")
        own.set("hinge_added_torque_n_m", torque)
        own.do_step(step)
        torque = pid.torque(*seen, step)
        rows.append(own.get("hinge_angle_rad"))
    assert np.abs(found[0] - rows).max() < 1e-12, np.abs(found[0] - rows).max()
    assert abs(rows[-1] - controller.TARGET) < 5e-3, rows[-1]
