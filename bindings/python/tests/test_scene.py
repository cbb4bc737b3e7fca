"""A scene says the same wherever it goes: from another working directory, without its files, pickled, overridden twice."""

import os
import pickle
import stat

import numpy as np
import pytest

import caudal

SHORT = {"solver.duration_s": 0.05}
GLYCEROL = os.path.abspath("models/glycerol.toml")

TABLE = """name = "table"
[rod]
nodes = 9
length_m = 0.3
outer_radius_m = 0.004
youngs_modulus_pa = 2e6
density_kg_m3 = 1100.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[drag]
law = "cox"
[head]
kind = "driven"
position_m = [0.0, 0.0]
angle_rad = { table = "angle.csv" }
[solver]
time_step_s = 1e-3
duration_s = 0.05
"""


@pytest.fixture(params=["\n", "\r\n"])
def folder(request, tmp_path, monkeypatch):
    """A folder with a scene that names a table, which is the working directory's child."""
    (tmp_path / "s").mkdir()
    (tmp_path / "s/t.toml").write_bytes(TABLE.replace("\n", request.param).encode())
    (tmp_path / "s/angle.csv").write_text("time,value\n" + "".join(f"{k * 0.01},{0.1 * k * 0.01}\n" for k in range(10)))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def tip(scene):
    return caudal.run(scene, record=["tip_y_m"])["tip_y_m"]


def test_a_scene_is_the_same_from_another_folder_and_without_its_files(folder, monkeypatch):
    scene = caudal.load("s/t.toml")
    here = tip(scene)
    assert np.ptp(here) > 0.0
    sent = pickle.dumps(scene)
    monkeypatch.chdir("/")
    away = folder / "out"
    for other in (scene, pickle.loads(sent), caudal.load(scene, set={"rod.nodes": 9})):
        assert np.array_equal(tip(other), here)
        other.fmu(folder / "t.fmu")
        assert caudal.sweep(other, {"rod.nodes": [9]}, out=away).complete
    # Another table is found where the scene is.
    (folder / "s/other.csv").write_text("time,value\n0.0,0.0\n1.0,0.5\n")
    assert not np.array_equal(tip(caudal.load(scene, set={"head.angle_rad": {"table": "other.csv"}})), here)
    (folder / "s/t.toml").unlink()
    (folder / "s/angle.csv").unlink()
    for number, other in enumerate((scene, pickle.loads(sent))):
        assert np.array_equal(tip(other), here)
        rows = caudal.sweep(other, {"rod.nodes": [9, 11]}, out=folder / f"gone{number}")
        assert rows.complete


def test_an_axis_varies_what_a_scene_overrides_and_excludes_what_the_call_sets(tmp_path):
    scene = caudal.load(GLYCEROL, set={**SHORT, "rod.nodes": 17})
    rows = caudal.sweep(scene, {"rod.nodes": [9, 11]}, out=tmp_path / "own")
    assert [row["nodes"] for row in rows] == [9, 11]
    with pytest.raises(caudal.errors.SceneError, match="found together with the axis `rod.nodes`"):
        caudal.sweep(GLYCEROL, {"rod.nodes": [9, 11]}, out=tmp_path / "set", set={"rod.nodes": 17})


def test_of_an_override_given_twice_the_last_one_wins_in_a_sweep_too(tmp_path):
    once = caudal.load(GLYCEROL, set={**SHORT, "actuation.kappa_amp": 0.3})
    twice = caudal.load(once, set={"actuation.kappa_amp": 0.5})
    direct = caudal.load(GLYCEROL, set={**SHORT, "actuation.kappa_amp": 0.5})
    rows = [caudal.sweep(scene, {"rod.nodes": [9]}, out=tmp_path / str(k))[0] for k, scene in enumerate((twice, direct))]
    assert rows[0]["x_com_m"] == rows[1]["x_com_m"]
    # What takes the place of another key does so in the order in which it was set.
    adaptive = caudal.load(GLYCEROL, set={**SHORT, "solver.integrator": "esdirk3", "solver.tolerance": 1e-3})
    fixed = caudal.load(adaptive, set={"solver.time_step_s": 1e-3})
    rows = caudal.sweep(fixed, {"rod.nodes": [9]}, out=tmp_path / "order", set={"actuation.kappa_amp": 0.4})
    assert rows[0]["steps"] == 50


def test_the_files_of_a_sweep_may_be_read_by_whom_the_umask_lets(tmp_path):
    before = os.umask(0o022)
    try:
        caudal.sweep(caudal.load(GLYCEROL, set=SHORT), {"rod.nodes": [9]}, out=tmp_path)
    finally:
        os.umask(before)
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir() if path.is_file()}
    assert all(mode & 0o444 == 0o444 for mode in modes.values()), modes


def test_numbers_of_numpy_may_be_anywhere_inside_of_what_is_given(tmp_path):
    scene = caudal.load(GLYCEROL, set={**SHORT, "medium.flow_m_s": [np.float32(0.5), np.int64(0)]})
    assert scene.parameters["medium.flow_m_s.0"] == 0.5
    rod = {"nodes": np.int64(9), "length_m": 1.0, "outer_radius_m": np.float64(0.01), "youngs_modulus_pa": 1e6, "density_kg_m3": 1e3}
    assert caudal.load({"name": "a", "rod": rod, "solver": {"time_step_s": 1e-3, "duration_s": 0.1}}).nodes == 9
    caudal.study("modes", scene, count=np.int64(2), out=tmp_path)


def test_a_callback_that_raises_at_the_end_does_not_lose_the_result():
    def raising(done, of):
        if done >= of:
            raise KeyError("late")

    with pytest.raises(KeyError) as raised:
        caudal.run(caudal.load(GLYCEROL, set=SHORT), progress=raising)
    assert raised.value.result.summary["steps"] > 0


def test_a_simulation_keeps_its_own_values():
    scene = caudal.load(GLYCEROL, set=SHORT)
    values = np.full(caudal.parameters(scene)["natural_curvature_1_m"].value.size, 3.0)
    simulation = caudal.simulate(scene, "tip_y_m", {"natural_curvature_1_m": values})
    values[:] = 0.0
    assert np.array_equal(pickle.loads(pickle.dumps(simulation)).outputs["tip_y_m"], simulation.outputs["tip_y_m"])


def test_levels_that_are_lists_are_text_in_data_sets_and_figures(tmp_path):
    pytest.importorskip("xarray")
    rows = caudal.sweep(caudal.load(GLYCEROL, set=SHORT), {"medium.flow_m_s": [[0.0, 0.0], [0.1, 0.0]]}, out=tmp_path)
    data = rows.to_xarray()
    assert data.sizes["medium.flow_m_s"] == 2
    assert data["x_com_m"].sel({"medium.flow_m_s": "[0.1, 0.0]"}) == rows[1]["x_com_m"]
    pytest.importorskip("matplotlib")
    rows.plot("x_com_m")
    (tmp_path / "two").mkdir()
    profiles = [[[0.0, 1.0], [1.0, 1.0]], [[0.0, 2.0], [1.0, 1.0]]]
    axes = {"rod.stiffness_profile": profiles, "rod.nodes": [9, 11]}
    rows = caudal.sweep(caudal.load(GLYCEROL, set=SHORT), axes, out=tmp_path / "two")
    assert rows.to_xarray().sizes["rod.stiffness_profile"] == 2
    rows.plot("x_com_m")


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        (lambda: caudal.load(None), "scene: found None; allowed: a Scene, a path, or a dict of tables"),
        (lambda: caudal.load(GLYCEROL, set=["rod.nodes=9"]), "set: found .*; allowed: a dict by name"),
        (lambda: caudal.run(GLYCEROL, record=3), "record: found 3; allowed: a name, or a list of names"),
        (lambda: caudal.run(GLYCEROL, progress=3), "progress: found 3; allowed: a function"),
        (lambda: caudal.simulate(GLYCEROL, None), "outputs: found None; allowed: a name, or a list of names"),
        (lambda: caudal.simulate(GLYCEROL, []), "outputs: found an empty list; allowed: at least one name"),
        (lambda: caudal.simulate(GLYCEROL, "tip_y_m", [1.0]), "values: found .*; allowed: a dict by name"),
        (lambda: caudal.simulate(GLYCEROL, "tip_y_m", {"x_m": None}), "x_m: found None; allowed: a number, or an array"),
        (lambda: caudal.simulate(GLYCEROL, "tip_y_m", {"x_m": "a"}), "x_m: found 'a'; allowed: a number, or an array"),
        (lambda: caudal.value_and_grad(GLYCEROL, ["tip_y_m"], "x_m"), "output: found .*; allowed: one name"),
        (lambda: caudal.value_and_grad(GLYCEROL, "tip_y_m", 3), "with_respect_to: found 3; allowed: a name"),
        (lambda: caudal.sweep(GLYCEROL, ["rod.nodes"]), "axes: found .*; allowed: a dict by name"),
        (lambda: caudal.sweep(GLYCEROL, {"rod.nodes": [9]}, jobs=0), "jobs: found 0; allowed: a whole number, 1 or more"),
        (lambda: caudal.sweep(GLYCEROL, {"rod.nodes": [9]}, jobs=1.5), "jobs: found 1.5; allowed: a whole number"),
        (lambda: caudal.study("modes", GLYCEROL, workers=1.5), "workers: found 1.5; allowed: a whole number"),
        (lambda: caudal.study("modes", GLYCEROL, patience_s="a"), "patience_s: found 'a'; allowed: a positive time"),
        (lambda: caudal.study("accuracy", GLYCEROL, nodes=[]), "nodes: found an empty list"),
        (lambda: caudal.study("accuracy", GLYCEROL, tolerances=[2.0]), "tolerances: found 2; allowed: a number between 0 and 1"),
        (lambda: caudal.study("scaling", GLYCEROL, steps=2.5), "steps: found 2.5; allowed: a whole number"),
        (lambda: caudal.Stepper(GLYCEROL).set("viscosity_pa_s", "a"), "value: found 'a'; allowed: a number"),
        (lambda: caudal.Stepper(GLYCEROL).restore(3), "snapshot: allowed: a Snapshot"),
    ],
)
def test_a_wrong_argument_is_named_with_what_is_allowed(call, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((TypeError, ValueError), match=problem):
        call()
