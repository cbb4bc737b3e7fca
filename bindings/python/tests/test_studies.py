"""Sweeps, studies and designs: the command's own files and numbers; progress, interrupts that keep what is done, mistakes."""

import csv
import json
import os

import pytest

import caudal

SWEEP = """
scene = {scene}
[set]
solver.duration_s = 0.05
[axes]
actuation.kappa_amp = [0.8, 1.2]
rod.nodes = [9, 17]
"""

STABILITY = {"points": 2, "range": [1e9, 1e10], "steps": [1e-3, 1e-2]}


class Enough(Exception):
    pass


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def sweep(tmp_path):
    path = tmp_path / "amplitude.toml"
    path.write_text(SWEEP.format(scene=json.dumps(os.path.abspath("models/baseline-smooth.toml"))))
    return path


def test_a_sweep_s_rows_are_the_command_s_table(sweep, command, tmp_path):
    told = []
    rows = caudal.sweep(sweep, out=tmp_path / "ours", progress=lambda done, of: told.append((done, of)))
    command(None, "sweep", sweep, "--out", tmp_path / "theirs")
    with open(tmp_path / "theirs/table.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(rows) == len(table) == 4
    for ours, theirs in zip(rows, table):
        for name, text in theirs.items():
            if name in ("scene_hash", "caudal_version"):  # where the table comes from
                continue
            value = ours[name]
            same = float(text) == value if isinstance(value, float) else text.lower() == str(value).lower()
            assert same or (text == "" and value is None), (name, text, value)
    assert told[-1] == (4, 4)
    assert (tmp_path / "ours/table.csv").read_bytes() == (tmp_path / "theirs/table.csv").read_bytes()


def test_a_study_leaves_the_files_of_the_command_and_brings_its_tables(command, tmp_path):
    scene = "models/baseline.toml"
    found = caudal.study("modes", scene, count=4, out=tmp_path / "ours")
    command(None, "study", "modes", scene, "--count", "4", "--out", tmp_path / "theirs")
    assert files(tmp_path / "ours") == files(tmp_path / "theirs")
    assert found.folder == tmp_path / "ours"
    summary = json.loads((tmp_path / "ours/summary.json").read_text())
    assert (summary["answers"], summary["numbers"]) == (found.answers, found.numbers)
    for name, columns in found.tables.items():
        with open(tmp_path / f"ours/{name}.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert [list(row) for row in rows][:1] == [list(columns)]
        for column, values in columns.items():
            assert len(values) == len(rows)
            for value, row in zip(values, rows):
                assert value is None or not isinstance(value, float) or value == float(row[column])
    assert "<svg" in found._repr_html_()


def test_an_interrupted_study_goes_on(tmp_path):
    scene = caudal.load("models/baseline-smooth.toml", set={"solver.duration_s": 0.05})
    whole = caudal.study("stability", scene, out=tmp_path / "whole", **STABILITY)

    def stop(done, of):
        if done > 0:
            raise Enough

    with pytest.raises(Enough):
        for _ in range(2):  # one that is over before the first look tells of it at its end
            caudal.study("stability", scene, out=tmp_path / "parts", progress=stop, **STABILITY)
    parts = caudal.study("stability", scene, out=tmp_path / "parts", **STABILITY)
    assert (parts.answers, parts.tables, parts.figures) == (whole.answers, whole.tables, whole.figures)


@pytest.mark.parametrize(
    "asked, error, text",
    [
        ({"count": 0}, caudal.errors.StudyError, "count: found 0"),
        ({"cuont": 3}, caudal.errors.StudyError, r"cuont: unknown key; allowed: .*; did you mean `count`\?"),
        ({"count": "three"}, caudal.errors.StudyError, r'count: found "three"; allowed: '),
    ],
)
def test_what_cannot_be_studied_is_refused(asked, error, text, tmp_path):
    with pytest.raises(error, match=text):
        caudal.study("modes", "models/baseline.toml", out=tmp_path / "out", **asked)
    assert not (tmp_path / "out").exists()
    with pytest.raises(caudal.errors.StudyError, match=r'kind: found "moods"; allowed: .*; did you mean `modes`\?'):
        caudal.study("moods", "models/baseline.toml", out=tmp_path / "out")


def test_a_method_that_is_not_there_cannot_be_left_out(tmp_path):
    with pytest.raises(caudal.errors.StudyError, match=r'without: found "newmrk"; did you mean `newmark`\?'):
        caudal.study("accuracy", "models/baseline.toml", without=["newmrk"], out=tmp_path / "out")


def test_a_design_is_the_command_s(command, tmp_path):
    scene = "models/design-identify.toml"
    found = caudal.design(scene, out=tmp_path / "ours")
    command(None, "design", scene, "--out", tmp_path / "theirs")
    assert files(tmp_path / "ours") == files(tmp_path / "theirs")
    assert {key: value for key, value in found.items() if key != "folder"} == json.loads(
        (tmp_path / "ours/design.json").read_text()
    )


def test_an_interrupted_design_keeps_the_best_so_far(tmp_path):
    scene = caudal.load("models/design-silicone-eel.toml", set={"solver.duration_s": 0.5})
    told = []

    def stop(iteration, objective):
        told.append((iteration, objective))
        if len(told) == 2:
            raise Enough

    with pytest.raises(Enough) as caught:
        caudal.design(scene, out=tmp_path / "out", progress=stop)
    assert len(told) == 2
    assert caught.value.result["status"] == "interrupted"
    assert len(caught.value.result["stiffness_n_m2"]) == len(caught.value.result["xi"])
    assert (tmp_path / "out/report.html").exists()


def test_a_design_that_is_not_asked_for_is_refused(tmp_path):
    with pytest.raises(caudal.errors.SceneError):
        caudal.design("models/baseline.toml", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
