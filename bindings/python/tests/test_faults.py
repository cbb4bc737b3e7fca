"""What goes wrong loses no work, is told where it is, and is said in Python's own words."""

import os
import pickle
import signal
import sys
import threading
from contextlib import contextmanager

import numpy as np
import pytest

import caudal

SHORT = {"solver.duration_s": 0.1}
GLYCEROL = "models/glycerol.toml"


def scene(**changes):
    return caudal.load(GLYCEROL, set={**SHORT, **changes})


@contextmanager
def files_of_at_most(size):
    """Imitate a full disk: no file can grow beyond `size` bytes."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_film_that_does_not_fit_on_the_disk_leaves_the_earlier_one(tmp_path):
    result, film = caudal.run(scene()), tmp_path / "tail.gif"
    result.animate(film)
    whole = film.read_bytes()
    for missing in (1, 100, 3000):
        with files_of_at_most(len(whole) - missing), pytest.raises(caudal.errors.WriteError):
            result.animate(film)
        assert film.read_bytes() == whole and list(tmp_path.iterdir()) == [film]


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C of a process is another thing there")
def test_a_film_that_is_interrupted_leaves_the_earlier_one(tmp_path):
    result, film = caudal.run(scene()), tmp_path / "tail.gif"
    result.animate(film)
    whole = film.read_bytes()
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        result.animate(film, speed=2e-3)
    timer.join()
    assert film.read_bytes() == whole


def test_a_film_replaces_a_film_and_another_file_only_by_force(tmp_path):
    result = caudal.run(scene())
    for name in ("tail.gif", "tail.svg"):
        (tmp_path / name).write_text("mine")
        with pytest.raises(caudal.errors.WriteError, match="caudal did not write; choose another name, or replace it with `force=True`"):
            result.animate(tmp_path / name)
        assert (tmp_path / name).read_text() == "mine"
        result.animate(tmp_path / name, force=True)
        result.animate(tmp_path / name)


def test_films_refuse_numbers_that_make_none(tmp_path):
    result, film = caudal.run(scene()), tmp_path / "tail.gif"
    for wrong in ({"sharpness": np.nan}, {"sharpness": 0.0}, {"sharpness": -1.0}, {"window": (np.nan, 1.0)}, {"window": (0.0, np.nan)}):
        with pytest.raises(caudal.errors.WriteError, match="found .*; allowed: "):
            result.animate(film, **wrong)
    assert not film.exists()


def test_what_was_computed_survives_a_full_disk(tmp_path):
    for size, call in (
        (20_000, lambda: caudal.run(scene(), out=tmp_path / "run")),
        (20_000, lambda: caudal.study("modes", scene(), count=3, out=tmp_path / "study")),
        # More than its journal, and less than its report.
        (90_000, lambda: caudal.sweep(scene(), {"actuation.kappa_amp": [0.3, 0.6]}, out=tmp_path / "sweep")),
    ):
        with files_of_at_most(size), pytest.raises(caudal.errors.WriteError) as failed:
            call()
        assert failed.value.result is not None
        if isinstance(failed.value.result, caudal.Result):
            assert failed.value.result.complete and failed.value.result["time_s"][-1] == 0.1
        if isinstance(failed.value.result, caudal.Findings):
            assert failed.value.result.answers and failed.value.result.tables
        if isinstance(failed.value.result, caudal.Sweep):
            assert failed.value.result.complete and len(failed.value.result) == 2


def test_arrays_that_are_not_aligned_are_numbers_too():
    values = np.zeros(9, dtype=[("a", "u1"), ("b", "f8")])["b"]
    values[:] = np.arange(9) * 1e-6
    bytewise = np.zeros(73, "u1")[1:].view("f8")
    bytewise[:] = values
    plain, *others = (caudal.Stepper(scene()) for _ in range(5))
    plain.set("force_y_n", values.tolist())
    others[0].set("force_y_n", values)
    others[1].set("force_y_n", bytewise)
    others[2].set_all({"force_y_n": values})
    others[3].set("force_y_n", np.repeat(values, 2)[::2])
    for tail in (plain, *others):
        tail.do_step(0.01)
        np.testing.assert_array_equal(tail.get("y_m"), plain.get("y_m"))
    simulation = caudal.simulate(scene(), "tip_y_m")
    count = simulation.times_s.size
    weights = np.zeros(8 * count + 1, "u1")[1:].view("f8")
    weights[-1] = 1.0
    found = [simulation.pull_back({"tip_y_m": own}, "medium.viscosity_pa_s") for own in (weights, weights.tolist())]
    assert found[0] == found[1]


def test_a_sweep_without_rows_knows_what_failed(tmp_path):
    axes = {"actuation.kappa_amp": [0.3, 1e6]}
    whole, bare = (caudal.sweep(scene(), axes, out=tmp_path, rows=rows) for rows in (True, False))
    assert len(whole) == 2 and len(bare) == 0
    assert repr(whole) == repr(bare) == "<caudal.Sweep of 2 cases over actuation.kappa_amp (2); 1 failed>"
    assert not whole.complete and not bare.complete
    assert repr(pickle.loads(pickle.dumps(bare))) == repr(bare)
    for refused in (lambda: bare.plot("x_com_m"), bare.to_xarray, bare.to_pandas):
        with pytest.raises(ValueError, match="without its rows .*table.csv"):
            refused()


def test_advice_can_be_followed(tmp_path):
    runs = [caudal.run(scene(name=name), out=tmp_path / name) for name in ("one", "other")]
    caudal.export(tmp_path / "one", figures="shape", out=tmp_path / "pictures")
    advice = "choose another folder, or replace it with `force=True`"
    with pytest.raises(caudal.errors.OccupiedError, match=advice):
        caudal.export(tmp_path / "other", figures="shape", out=tmp_path / "pictures")
    caudal.export(tmp_path / "other", figures="shape", out=tmp_path / "pictures", force=True)
    runs[0].to_vtk(tmp_path / "vtk")
    again = caudal.run(scene(name="one", **{"rod.nodes": 11}))
    again.to_vtk(tmp_path / "vtk")  # of the same file
    (tmp_path / "glycerol.toml").write_text(scene().text)
    copy = caudal.run(caudal.load(tmp_path / "glycerol.toml", set={**SHORT, "name": "one"}))
    with pytest.raises(caudal.errors.OccupiedError, match=f"an export of `one` by another file, .*{advice}"):
        copy.to_vtk(tmp_path / "vtk")
    copy.to_vtk(tmp_path / "vtk", force=True)


def test_names_of_files_are_never_rewritten(tmp_path):
    name = "my override file --out 2.toml"
    with pytest.raises(caudal.errors.ReadError, match=f"^{tmp_path / name}: cannot be read"):
        caudal.load(tmp_path / name)


def test_an_empty_folder_is_none():
    for call in (
        lambda: caudal.run(scene(), out=""),
        lambda: caudal.sweep(scene(), {"rod.nodes": [9]}, out=""),
        lambda: caudal.study("modes", scene(), out=""),
    ):
        with pytest.raises(ValueError, match="out: found ''; allowed: the path of a folder"):
            call()


def test_what_cannot_be_differentiated_is_there_nonetheless():
    own = scene()
    there = caudal.Stepper(own).variables
    for name in ("curvature_1_m", "viscosity_pa_s", "tip_spin_rad_s", "steps"):
        assert name in there
        with pytest.raises(caudal.errors.DerivativeError, match=f"`{name}` cannot be differentiated; allowed: ") as refused:
            caudal.simulate(own, name)
        allowed = str(refused.value).split("allowed: ")[1].split(", ")
        assert "tip_x_m" in allowed and all(other in there for other in allowed)
    with pytest.raises(caudal.errors.UnknownVariableError, match="did you mean `tip_y_m`"):
        caudal.simulate(own, "tip_y")


def test_every_face_says_where_an_error_is():
    own = caudal.load(GLYCEROL, set={"rod.nodes": 1000001, "solver.form": "positions"})
    for call in (caudal.run, caudal.Stepper, lambda own: own.check(), lambda own: own.fmu("none.fmu", library=__file__)):
        with pytest.raises(caudal.errors.SceneError, match="^rod.nodes=1000001: rod.nodes: found 1000001"):
            call(own)


def test_an_axis_replaces_a_part_of_an_overridden_table(tmp_path):
    for number, (file, changes, axis, levels) in enumerate(
        [
            (GLYCEROL, {"rod": {"nodes": 17}}, "rod.nodes", [9, 11]),
            ("models/driven-head.toml", {"head.angle_rad.amplitude": 0.2}, "head.angle_rad", [0.1, 0.2]),
            ("models/driven-head.toml", {"head.angle_rad": {"amplitude": 0.2, "frequency_hz": 1.0}}, "head.angle_rad.frequency_hz", [1.0, 2.0]),
        ]
    ):
        rows = caudal.sweep(caudal.load(file, set={**SHORT, **changes}), {axis: levels}, out=tmp_path / str(number))
        assert rows.complete and [row[axis] for row in rows] == levels


def test_a_value_with_its_gradient_can_be_pickled():
    found = caudal.value_and_grad(scene(), "tip_y_m", "medium.viscosity_pa_s", {"medium.viscosity_pa_s": 2.0})
    again = pickle.loads(pickle.dumps(found))
    assert again == found and again.notes == found.notes


def test_scenes_without_a_file_do_not_replace_each_other(tmp_path):
    tables = {
        "rod": {"nodes": 9, "length_m": 1.0, "outer_radius_m": 0.01, "youngs_modulus_pa": 1e6, "density_kg_m3": 1000.0},
        "solver": {"time_step_s": 0.01, "duration_s": 0.1},
    }
    other = {**tables, "rod": {**tables["rod"], "nodes": 33}}
    caudal.run(tables, out=tmp_path)
    caudal.run(tables, out=tmp_path)
    with pytest.raises(caudal.errors.OccupiedError, match="holds a run of `scene` with other values, not with these"):
        caudal.run(other, out=tmp_path)
    assert caudal.run(other, out=tmp_path, force=True).summary["nodes"] == 33
