"""What editors and shells know: the schema of scenes and sweeps, new scenes, completions, man pages, JSON and quiet."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import caudal

try:
    import tomllib
except ImportError:  # Python 3.10 and before
    tomllib = None

ROOT = Path(__file__).parents[3]
KINDS = ["swimmer", "held", "tail"]
FLUIDS = ["water", "glycerol", "oil"]


@pytest.fixture(scope="module")
def schemas(command, tmp_path_factory):
    """The files of both schemas, by what they are of."""
    folder = tmp_path_factory.mktemp("schemas")
    found = {}
    for what, options in (("scene", []), ("sweep", ["--sweep"])):
        found[what] = folder / f"{what}.schema.json"
        found[what].write_text(command(None, "schema", *options).stdout)
    return found


def models():
    files = sorted((ROOT / "models").rglob("*.toml"))
    assert len(files) > 30
    return files


def kind(path):
    return "sweep" if "\n[axes" in path.read_text() else "scene"


def complaints(schemas, what, content):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads(schemas[what].read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return list(jsonschema.Draft202012Validator(schema).iter_errors(content))


@pytest.mark.skipif(tomllib is None, reason="tomllib came with Python 3.11")
def test_every_model_is_as_its_schema_says(schemas):
    for path in models():
        assert complaints(schemas, kind(path), tomllib.loads(path.read_text())) == [], path


@pytest.mark.skipif(tomllib is None, reason="tomllib came with Python 3.11")
@pytest.mark.parametrize(
    "change",
    [
        {"rod": {"length_mm": 1.0}},
        {"rod": {"nodes": 2}},
        {"rod": {"youngs_modulus_pa": -1.0}},
        {"rod": {"outer_radius_m": [[0.0, 0.01], [2.0, 0.01]]}},
        {"solver": {"integrator": "euler"}},
        {"solver": {"rho_inf": 2.0}},
        {"solver": {"step": 1e-3}},
        {"drag": {"law": "stokes"}},
        {"medium": {"flow_m_s": [0.0]}},
        {"head": {"kind": "fixed"}},
        {"design": {"gaol": "identify"}},
        {"durg": {}},
    ],
)
def test_what_a_run_refuses_the_schema_refuses(change, schemas):
    content = tomllib.loads((ROOT / "models/eel.toml").read_text())
    assert complaints(schemas, "scene", content) == []
    for table, keys in change.items():
        content[table] = {**content.get(table, {}), **keys}
    assert complaints(schemas, "scene", content)
    if "design" not in change:  # of which a run takes no notice
        with pytest.raises(caudal.errors.SceneError):
            caudal.load(content)


@pytest.mark.skipif(tomllib is None, reason="tomllib came with Python 3.11")
def test_what_a_sweep_may_not_say_its_schema_refuses(schemas):
    content = tomllib.loads((ROOT / "models/sweep-192.toml").read_text())
    for change in ({"set": {"solver": {"step": 1.0}}}, {"axis": {}}, {"samples": {"number": 3}}, {"axes": {"rod": {"nodes": []}}}):
        assert complaints(schemas, "sweep", {**content, **change}), change


def test_an_editor_s_checker_takes_the_models_and_no_other_keys(schemas, tmp_path):
    taplo = shutil.which("taplo", path=str(Path(sys.executable).parent))
    if not taplo:
        pytest.skip("taplo is not installed")

    def check(what, *paths):
        return subprocess.run([taplo, "check", "--schema", schemas[what].as_uri(), *map(str, paths)], capture_output=True, text=True)

    for what in schemas:
        outcome = check(what, *(path for path in models() if kind(path) == what))
        assert outcome.returncode == 0, outcome.stderr
    wrong = tmp_path / "wrong.toml"
    wrong.write_text((ROOT / "models/eel.toml").read_text().replace("length_m", "length_mm"))
    assert "length_mm" in check("scene", wrong).stderr


@pytest.mark.parametrize("fluid", FLUIDS)
@pytest.mark.parametrize("swims", KINDS)
def test_a_new_scene_runs_without_a_warning(swims, fluid, command, tmp_path):
    for length, frequency in ((1e-3, 5.0), (0.2, 2.0), (5.0, 0.3)):
        path = tmp_path / f"new-{length}.toml"
        command(None, "new", path, "--kind", swims, "--fluid", fluid, "--length", str(length), "--frequency", str(frequency))
        scene = caudal.load(path)
        assert path.read_text().startswith("#:schema scene.schema.json\n")

        # In some sizes and fluids no law is known to hold, which is all that may be said.
        def others(notes):
            return [note for note in notes if " outside " not in note]

        assert others(scene.check()) == [], (length, scene.check())
        result = caudal.run(scene, record=["tip_y_m"])
        assert result.complete and others(result.notes) == [], (length, result.notes)
        assert max(abs(result["tip_y_m"])) > 0.02 * length
    with pytest.raises(subprocess.CalledProcessError) as caught:
        command(None, "new", path)
    assert caught.value.returncode == 2 and "--force" in caught.value.stderr


def test_json_and_quiet_say_what_they_should_and_nothing_else(command, tmp_path):
    told = command(None, "run", "models/glycerol.toml", "--set=solver.duration_s=0.1", "--json", "--out", tmp_path / "run")
    assert json.loads(told.stdout) == json.loads((tmp_path / "run/summary.json").read_text())
    told = command(None, "run", "models/glycerol.toml", "--set=solver.duration_s=0.1", "--quiet", "--out", tmp_path / "quiet")
    assert told.stdout == told.stderr == ""
    found = json.loads(command(None, "check", "models/glycerol.toml", "--json").stdout)
    assert found["warnings"] == caudal.load("models/glycerol.toml").check()
    assert found["refused"] is None and found["reynolds_number"] > 0 and {"name", "text"} == set(found["facts"][0])


def test_shells_and_man_know_every_command(command, tmp_path):
    listed = command(None, "--help").stdout
    for shell in ("bash", "zsh", "fish", "powershell", "elvish"):
        assert "completions" in command(None, "completions", shell).stdout
    if shutil.which("bash"):
        script = tmp_path / "caudal.bash"
        script.write_text(command(None, "completions", "bash").stdout)
        asked = f"source {script}; COMP_WORDS=(caudal che); COMP_CWORD=1; _caudal caudal che caudal; echo ${{COMPREPLY[@]}}"
        assert subprocess.run(["bash", "-c", asked], capture_output=True, text=True).stdout.strip() == "check"
    command(None, "man", tmp_path / "man")
    pages = {page.name for page in (tmp_path / "man").iterdir()}
    for name in ("run", "sweep", "study-accuracy", "new", "export", "schema"):
        assert f"caudal-{name}.1" in pages and name.split("-")[0] in listed
