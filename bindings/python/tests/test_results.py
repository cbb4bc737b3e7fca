"""What comes out goes where users work: labelled datasets, tables, files of other programs, pictures and films."""

import json
import pickle
import shutil
import subprocess
import sys
import xml.etree.ElementTree as xml

import numpy as np
import pytest

import caudal

RECORDED = ["x_m", "y_m", "vx_m_s", "vy_m_s", "curvature_1_m", "x_com_m", "viscous_work_j"]


@pytest.fixture
def result():
    scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 0.1, "rod.nodes": 9})
    return caudal.run(scene, record=RECORDED)


def test_a_result_is_a_dataset_with_units_and_comes_back_from_netcdf(result, tmp_path):
    xarray = pytest.importorskip("xarray")
    dataset = result.to_xarray()
    assert dict(dataset.sizes) == {"time_s": 51, "node": 9, "joint": 8}
    assert dataset["vx_m_s"].dims == ("time_s", "node") and dataset["curvature_1_m"].dims == ("time_s", "joint")
    for name in RECORDED:
        np.testing.assert_array_equal(dataset[name].values, result[name])
        assert dataset[name].attrs["units"] == result.variables[name].unit
    assert float(dataset["x_m"].sel(node=8).isel(time_s=-1)) == result["x_m"][-1, -1]
    dataset.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as back:
        assert dataset.identical(back.load())


def test_vtk_files_hold_what_was_recorded(result, tmp_path, command):
    with pytest.raises(caudal.errors.UnknownVariableError, match="needs x_m, y_m and time_s to be recorded"):
        caudal.run(result.scene, record="x_m").to_vtk(tmp_path / "vtk")
    files = result.to_vtk(tmp_path / "vtk")
    assert len(files) == 51 + 1
    collection = xml.parse(tmp_path / "vtk/driven-head.pvd").getroot().findall("./Collection/DataSet")
    assert [float(part.get("timestep")) for part in collection] == list(result["time_s"])
    piece = xml.parse(tmp_path / "vtk" / collection[-1].get("file")).getroot().find("./PolyData/Piece")
    fields = {array.get("Name"): np.array(array.text.split(), float) for array in piece.findall("./PointData/DataArray")}
    points = np.array(piece.find("./Points/DataArray").text.split(), float).reshape(-1, 3)
    np.testing.assert_array_equal(points.T, [result["x_m"][-1], result["y_m"][-1], np.zeros(9)])
    velocity = fields["velocity_m_s"].reshape(-1, 3)
    np.testing.assert_array_equal(velocity.T, [result["vx_m_s"][-1], result["vy_m_s"][-1], np.zeros(9)])
    np.testing.assert_array_equal(fields["curvature_1_m"][:-1], result["curvature_1_m"][-1])
    assert np.isnan(fields["curvature_1_m"][-1])  # no joint at the tip
    np.testing.assert_allclose(fields["radius_m"], 0.004)
    # The command's are the same, made from the folder of a run.
    overrides = [f"--set={assignment}" for assignment in result.scene.overrides]
    command(None, "run", "models/driven-head.toml", "--out", tmp_path / "run", *overrides)
    command(None, "export", tmp_path / "run", "--vtk", "--fields", ",".join(RECORDED))
    for file in (tmp_path / "vtk").iterdir():
        assert file.read_bytes() == (tmp_path / "run/vtk" / file.name).read_bytes()
    with pytest.raises(subprocess.CalledProcessError) as caught:
        command(None, "export", tmp_path / "run", "--vtk", "--set=rod.nodes=5")
    assert caught.value.returncode == 2 and "--set" in caught.value.stderr


@pytest.mark.parametrize("duration", [3.0, 3.1, 3.3])
def test_a_film_shows_the_last_whole_cycle_of_the_run(duration, tmp_path):
    head = {"kind": "driven", "position_m": [0.0, 0.0], "angle_rad": {"amplitude": 0.3, "frequency_hz": 1.0}}
    rod = {"nodes": 9, "length_m": 0.3, "outer_radius_m": 0.01, "youngs_modulus_pa": 2e9, "density_kg_m3": 1100.0}
    scene = {
        "name": "pitch",
        "rod": rod | {"inner_radius_m": 0.0},
        "start": {"kind": "shaped"},
        "medium": {"viscosity_pa_s": 1e-2, "density_kg_m3": 1000.0},
        "drag": {"law": "cross-flow"},
        "head": head,
        "solver": {"time_step_s": 5e-3, "duration_s": duration},
    }
    caudal.run(scene).animate(tmp_path / "pitch.svg")
    assert "pitch from t = 2 s to 3 s" in (tmp_path / "pitch.svg").read_text()


def test_films_and_pictures_are_made_or_say_what_they_need(result, tmp_path, monkeypatch, command):
    image = pytest.importorskip("PIL.Image")
    result.animate(tmp_path / "tail.gif", fps=20, speed=0.1)
    shades = []
    with image.open(tmp_path / "tail.gif") as film:
        assert film.n_frames == 20 and film.info["loop"] == 0 and film.info["duration"] == 50
        for n in (0, 10):
            film.seek(n)
            shades.append(np.asarray(film.convert("RGB")).astype(int))
    assert shades[0].shape == shades[1].shape and shades[0].shape[1] == 640
    assert np.any(shades[0] != shades[1])
    # The body is dark blue, its fluid light blue.
    blue = (shades[0][..., 2] > 130) & (shades[0][..., 0] < 60)
    assert 200 < blue.sum() < 20000
    result.animate(tmp_path / "tail.svg")
    assert '<animate attributeName="d"' in (tmp_path / "tail.svg").read_text()
    result.plot().savefig(tmp_path / "tail.pdf")
    result.plot("x_com_m").savefig(tmp_path / "tail.png")
    assert (tmp_path / "tail.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(caudal.errors.WriteError, match=r"\.svg, \.gif or \.mp4"):
        result.animate(tmp_path / "tail.avi")
    with pytest.raises(caudal.errors.WriteError, match="allowed: a positive number"):
        result.animate(tmp_path / "tail.gif", speed=-1.0)
    with pytest.raises(caudal.errors.WriteError, match="found 30 pictures per second"):
        result.animate(tmp_path / "tail.svg", fps=30)
    with pytest.raises(caudal.errors.WriteError, match="choose a part of the run with `window=`, or give a smaller `fps=`"):
        result.animate(tmp_path / "tail.gif", speed=1e-6)
    if shutil.which("ffmpeg"):
        result.animate(tmp_path / "tail.mp4", fps=10, speed=0.1)
        assert b"ftyp" in (tmp_path / "tail.mp4").read_bytes()[:12]
    # A program of that name that fails says why.
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/ffmpeg").write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    (tmp_path / "bin/ffmpeg").chmod(0o755)
    for folder, words in ((tmp_path / "bin", "ffmpeg: no such codec"), (tmp_path / "none", "needs the program ffmpeg")):
        monkeypatch.setenv("PATH", str(folder))
        with pytest.raises(caudal.errors.WriteError, match=words):
            result.animate(tmp_path / "other.mp4")
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith((".", "other"))) == []


def test_figures_become_png_and_pdf_from_python_and_the_command(tmp_path, command):
    image = pytest.importorskip("PIL.Image")
    folder = tmp_path / "run"
    scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 0.1})
    caudal.run(scene, out=folder)
    drawn = sorted(path.stem for path in folder.glob("*.svg"))
    files = caudal.export(folder, ["png", "pdf"])
    assert len(files) == 2 * len(drawn) > 10
    with image.open(folder / "shape.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert pixels.shape[1] == 1280
    ink = (pixels.sum(axis=2) < 200)[:60]  # the title is there, so letters are
    assert 200 < ink.sum() < 10000, ink.sum()
    assert (folder / "energy.pdf").read_bytes().startswith(b"%PDF")
    one = caudal.export(folder, "png", figures="shape", out=tmp_path / "one")
    assert {path.name for path in (tmp_path / "one").iterdir()} == {"shape.png", "manifest.json"} and len(one) == 1
    command(None, "export", folder, "--png", "--pdf", "--gif", "--fps", "10", "--out", tmp_path / "two", "--set=solver.duration_s=0.1")
    assert (tmp_path / "two/shape.png").read_bytes() == (folder / "shape.png").read_bytes()
    assert (tmp_path / "two/shape.pdf").read_bytes()[:1000] == (folder / "shape.pdf").read_bytes()[:1000]
    assert (tmp_path / "two/driven-head.gif").read_bytes().startswith(b"GIF89a")
    with pytest.raises(caudal.errors.ReadError, match="no figures .*; `caudal.run` with `out=` leaves some"):
        caudal.export(tmp_path / "two")
    with pytest.raises(caudal.errors.ReadError, match="no such folder; `caudal.run` with `out=` makes"):
        caudal.export(tmp_path / "missing")
    with pytest.raises(caudal.errors.ReadError, match="shap.svg"):
        caudal.export(folder, figures="shap")


def test_a_sweep_of_objects_is_that_of_a_file_and_a_dataset_over_its_axes(tmp_path, command):
    scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.05})
    axes = {
        "actuation.kappa_amp": np.array([0.3, 0.6]),
        "fluid": {"zip": {"medium.viscosity_pa_s": [1.0, 2.0, 3.0], "medium.density_kg_m3": [1000.0, 1100.0, 1200.0]}},
    }
    rows = caudal.sweep(scene, axes, out=tmp_path / "sweep")
    assert len(rows) == 6 and rows.complete and rows[5]["medium.viscosity_pa_s"] == 3.0
    for row in rows:
        own = caudal.load(scene, set={key: row[key] for key in ("actuation.kappa_amp", "medium.viscosity_pa_s", "medium.density_kg_m3")})
        assert caudal.run(own, record=["x_com_m"]).summary["x_com_m"] == row["x_com_m"]
    command(None, "sweep", tmp_path / "sweep/sweep.toml", "--out", tmp_path / "again")
    assert (tmp_path / "again/table.csv").read_bytes() == (tmp_path / "sweep/table.csv").read_bytes()
    frame = rows.to_pandas()
    assert list(frame["x_com_m"]) == [row["x_com_m"] for row in rows]
    pytest.importorskip("xarray")
    dataset = rows.to_xarray()
    assert dict(dataset.sizes) == {"actuation.kappa_amp": 2, "fluid": 3}
    assert float(dataset["x_com_m"][1, 2]) == rows[5]["x_com_m"] and dataset["x_com_m"].attrs["units"] == "m"
    assert pickle.loads(pickle.dumps(rows)).axes == rows.axes
    image = rows.plot("x_com_m").axes[0].images[0]
    np.testing.assert_array_equal(image.get_array(), dataset["x_com_m"])
    assert "<table>" in rows._repr_html_()


def test_samples_share_a_dimension(tmp_path):
    axes = {"actuation.kappa_amp": {"between": [0.3, 0.6]}, "medium.viscosity_pa_s": {"between": [1.0, 2.0]}}
    changes = {"solver.duration_s": 0.02}
    rows = caudal.sweep("models/glycerol.toml", axes, samples={"count": 5, "seed": 1}, set=changes, out=tmp_path)
    assert len(rows) == 5 and rows.sampled == set(axes)
    pytest.importorskip("xarray")
    dataset = rows.to_xarray()
    assert dict(dataset.sizes) == {"sample": 5}
    assert list(dataset["medium.viscosity_pa_s"].values) == [row["medium.viscosity_pa_s"] for row in rows]


def test_cases_that_failed_have_no_numbers_over_the_axes_and_a_cross_in_a_map(tmp_path):
    pytest.importorskip("xarray")
    axes = {"rod.youngs_modulus_pa": [1e5, 1e6], "head.angle_rad.amplitude": [0.3, 60.0]}
    rows = caudal.sweep("models/silicone-tail.toml", axes, set={"rod.nodes": 9, "solver.duration_s": 0.6}, out=tmp_path)
    assert [row["complete"] for row in rows] == [True, False, True, False]
    dataset = rows.to_xarray()
    assert np.isnan(dataset["mean_thrust_n"].values).tolist() == [[False, True], [False, True]]
    assert np.isfinite(dataset["end_time_s"].values).all()
    (shown,) = rows.plot("mean_thrust_n").axes[:1]
    assert np.isnan(np.ma.filled(shown.images[0].get_array(), np.nan)).tolist() == [[False, True], [False, True]]
    (failed,) = (line for line in shown.lines if line.get_label() == "failed")
    assert sorted(zip(*failed.get_data())) == [(1, 0), (1, 1)]


def test_a_design_is_an_object_and_its_scene_runs(tmp_path):
    found = caudal.design("models/design-identify.toml", out=tmp_path)
    assert found.status == found["status"] and len(found.stiffness_n_m2) == len(found.xi)
    assert json.loads((tmp_path / "design.json").read_text())["answer"] == found.answer
    assert found.scene.name.endswith("-designed") and "Design" in repr(found) and found.lines[0] in found._repr_html_().replace("&#x27;", "'")
    with pytest.raises(AttributeError, match="stifness"):
        found.stifness
    assert pickle.loads(pickle.dumps(found)) == found


@pytest.mark.parametrize(
    "module, ask",
    [
        ("pandas", lambda result: result.to_pandas()),
        ("xarray", lambda result: result.to_xarray()),
        ("matplotlib", lambda result: result.plot()),
    ],
)
def test_a_missing_package_says_what_to_install(module, ask, result, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=r'pip install "caudal\['):
        ask(result)


def test_every_object_shows_itself_in_a_notebook_and_comes_back_from_a_pickle():
    import pickle

    scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.05})
    tail = caudal.Stepper(scene)
    simulation = caudal.simulate(scene, ["tip_y_m", "x_m"], {"medium.viscosity_pa_s": 2.0})
    parameter = caudal.parameters(scene)["rod.length_m"]
    for it in (scene, tail, tail.save(), tail.variables["tip_y_m"], simulation, parameter):
        assert repr(it) and it._repr_html_().count("<") > 1, it
    assert "rod.length_m" in scene._repr_html_() and "tip_y_m" in tail._repr_html_()
    again = pickle.loads(pickle.dumps(simulation))
    for name, values in simulation.outputs.items():
        np.testing.assert_array_equal(values, again.outputs[name])
    weights = {"tip_y_m": np.ones_like(simulation.times_s)}
    assert again.pull_back(weights, ["rod.length_m"]) == simulation.pull_back(weights, ["rod.length_m"])
    assert pickle.loads(pickle.dumps(parameter)) == parameter


def test_a_sweep_of_objects_writes_over_no_file_of_others(tmp_path):
    scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.02})
    axes = {"actuation.kappa_amp": [0.3, 0.6]}
    own = tmp_path / "sweep.toml"
    own.write_text("mine")
    with pytest.raises(caudal.errors.OccupiedError, match="sweep.toml.*choose another folder, .*`force=True`") as refused:
        caudal.sweep(scene, axes, out=tmp_path)
    assert "--" not in str(refused.value)
    assert own.read_text() == "mine" and [path.name for path in tmp_path.iterdir()] == ["sweep.toml"]
    rows = caudal.sweep(scene, axes, out=tmp_path, force=True)
    assert rows.complete and "kappa_amp" in own.read_text()
    assert len(caudal.sweep(scene, axes, out=tmp_path)) == 2
    with pytest.raises(caudal.errors.Error):  # of other axes: what says what the table is of stays
        caudal.sweep(scene, {"actuation.kappa_amp": [0.4]}, out=tmp_path)
    assert "0.6" in own.read_text()


def test_names_that_are_not_there_are_errors_that_name_those_that_are(tmp_path):
    scene = caudal.load("models/baseline.toml", set={"solver.duration_s": 0.05})
    rows = caudal.sweep(scene, {"rod.nodes": [9, 11]}, out=tmp_path / "sweep")
    result = caudal.run(scene)
    simulation = caudal.simulate(scene, ["x_m"])
    for ask, near in [
        (lambda: result["time"], "time_s"),
        (lambda: result.summary["net_displacement"], "net_displacement_m"),
        (lambda: simulation.outputs["xm"], "x_m"),
        (lambda: rows[0]["net_displacement"], "net_displacement_m"),
        (lambda: rows.plot("net_displacement"), "net_displacement_m"),
    ]:
        with pytest.raises(KeyError, match=f"did you mean .*`{near}`") as caught:
            ask()
        assert isinstance(caught.value, caudal.errors.UnknownVariableError)
    assert pickle.loads(pickle.dumps(rows))[1]["rod.nodes"] == rows[1]["rod.nodes"] == 11
    assert json.loads(json.dumps(result.summary)) == result.summary


def test_mistakes_in_a_sweep_of_objects_speak_of_objects(tmp_path):
    scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.02})
    with pytest.raises(caudal.errors.Error, match="rod.youngs_modulus_pa") as caught:
        caudal.sweep(scene, {"rod.youngs_modulus_pa": [-1.0, 1e6]}, out=tmp_path / "one")
    assert "sweep.toml" not in str(caught.value), caught.value
    with pytest.raises(caudal.errors.Error, match=r'samples=\{"count": 100'):
        caudal.sweep(scene, {"rod.youngs_modulus_pa": {"between": [1e5, 1e6]}}, out=tmp_path / "two")
    rows = caudal.sweep(scene, {"rod.nodes": [5, 9]}, out=tmp_path / "three")
    with pytest.raises(ValueError, match="`ending` has no numbers; allowed: a column of numbers"):
        rows.plot("ending")
    with pytest.raises(caudal.errors.StudyError, match="points: found `points`; allowed: nothing, there are no options"):
        caudal.study("fluid", scene, points=3, out=tmp_path / "four")
    with pytest.raises(caudal.errors.SceneError) as caught:
        caudal.run(caudal.load(scene, set={"record.variables": ["joint_moment"]}))
    assert caught.value.place.startswith("record.variables"), caught.value.place
