"""Comparisons of runs: from folders and from memory the same, and the numbers are those of the runs."""

import copy
import pickle

import pytest

import caudal

SHORT = {"solver.duration_s": 0.1}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs in memory, with their folders."""
    found = []
    for name, changes in [("soft", {}), ("stiff", {"rod.youngs_modulus_pa": 1e11, "name": "stiff"})]:
        folder = tmp_path_factory.mktemp("runs") / name
        scene = caudal.load("models/glycerol.toml", set={**SHORT, **changes})
        found.append((caudal.run(scene, out=folder), folder))
    return found


def test_a_comparison_has_the_numbers_of_the_runs(runs):
    (soft, _), (stiff, _) = runs
    compared = caudal.compare(soft, stiff)
    assert compared.labels == ["glycerol", "stiff"]
    assert compared.keys == {"rod.youngs_modulus_pa": {"glycerol": 7e10, "stiff": 1e11}}
    assert compared.folder is None
    checked = 0
    for key, difference in compared.differences.items():
        first, second = (run.summary.get(key) for run in (soft, stiff))
        if isinstance(first, float) and key != "wall_s":
            assert compared.results[key] == {"glycerol": first, "stiff": second}
            assert difference["stiff"]["difference"] == pytest.approx(second - first, rel=1e-9, abs=1e-12 * abs(first))
            assert difference["stiff"]["stated_error"] is None
            checked += 1
    assert checked > 20
    assert compared.results["drag_impulse_n_s.x"]["stiff"] == stiff.summary["drag_impulse_n_s"][0]
    assert repr(compared) == "<caudal.Comparison of glycerol, stiff: 1 key differs>"
    assert compared.answers[0].startswith("1 key differs: rod.youngs_modulus_pa = 7e10 | 1e11")
    assert "com_path.svg" in compared.figures and compared.figures["com_path.svg"].startswith("<svg")
    with pytest.raises(caudal.errors.UnknownVariableError, match="x_com_m"):
        compared.results["x_com"]


def test_folders_and_memory_say_the_same(runs, tmp_path):
    (soft, soft_folder), (stiff, stiff_folder) = runs
    memory = caudal.compare(soft, stiff)
    folders = caudal.compare(soft_folder, str(stiff_folder), out=tmp_path / "compared")
    mixed = caudal.compare(soft, stiff_folder)
    assert memory.results == folders.results == mixed.results
    assert memory.differences == folders.differences
    assert memory.keys == folders.keys
    assert memory.figures == folders.figures
    # The films have the same rods.
    motion = [page.to_html().split('type="application/json">')[1].split("</script>")[0] for page in (memory, folders)]
    assert motion[0] == motion[1]
    written = {path.name for path in (tmp_path / "compared").iterdir()}
    assert {"report.html", "results.csv", "keys.csv", "summary.json", "manifest.json"} <= written
    assert set(folders.figures) <= written
    assert (tmp_path / "compared/report.html").read_text() == folders.to_html()
    assert folders.folder == tmp_path / "compared"


def test_the_same_result_twice_does_not_differ(runs):
    soft = runs[0][0]
    compared = caudal.compare(soft, soft)
    assert compared.labels == ["glycerol", "glycerol (2)"]
    assert not compared.keys
    assert all(of["glycerol (2)"]["difference"] == 0 for of in compared.differences.values() if of)
    assert "The runs do not differ: all results are equal." in compared.answers


def test_a_notebook_shows_the_page(runs):
    compared = caudal.compare(runs[0][0], runs[1][0])
    shown = compared._repr_html_()
    assert shown.startswith("<iframe srcdoc=") and "What was found" in shown
    for other in (pickle.loads(pickle.dumps(compared)), copy.deepcopy(compared)):
        assert other.results == compared.results


def test_what_is_no_run_is_an_error(runs, tmp_path):
    (soft, folder), _ = runs
    with pytest.raises(caudal.errors.ReadError, match=r"it is a scene, not the folder of a run; `caudal.run\(\"models/glycerol.toml\", out=…\)` first"):
        caudal.compare(folder, "models/glycerol.toml")
    with pytest.raises(caudal.errors.ReadError, match="there is no such folder; `caudal.run` with `out=` makes the folder of a run"):
        caudal.compare(soft, tmp_path / "nowhere")
    with pytest.raises(caudal.errors.ComparisonError, match="found 1 of them; allowed: 2 to 8") as error:
        caudal.compare(soft)
    assert error.value.problem.startswith("found 1")
    with pytest.raises(caudal.errors.ComparisonError, match="found 9 of them"):
        caudal.compare(*[soft] * 9)
    with pytest.raises(TypeError, match="runs: found 3; allowed: the folder of a run, or a Result"):
        caudal.compare(soft, 3)
    with pytest.raises(ValueError, match="out: found ''"):
        caudal.compare(soft, soft, out="")
    with pytest.raises(caudal.errors.OccupiedError, match="force=True"):
        (tmp_path / "taken").mkdir()
        (tmp_path / "taken/report.html").write_text("mine")
        caudal.compare(soft, soft, out=tmp_path / "taken")
