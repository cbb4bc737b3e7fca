"""The guide: links lead somewhere, every page is in its summary, notebooks run, commands and Python in it exist."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import caudal

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs/src"
PAGES = sorted(DOCS.rglob("*.md"))
EXAMPLE = DOCS / "scene-by-example.md"
OUTSIDE = [ROOT / name for name in ["README.md", "DESIGN.md", "CHANGELOG.md", "CONTRIBUTING.md", "bindings/python/README.md"]]
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def anchors(page):
    """The names that headings of a Markdown file can be linked by."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_lead_to_files_and_headings_that_are_there():
    checked = 0
    for page in [*PAGES, *OUTSIDE]:
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        for link in LINK.findall(text):
            if "://" in link:
                continue
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            assert target.exists(), (page.name, link)
            assert not anchor or anchor in anchors(target), (page.name, link)
            # The book has what is in its folder.
            assert page not in PAGES or target.is_relative_to(DOCS), (page.name, link)
            checked += 1
    assert checked > 30


def test_every_page_is_in_the_summary_and_every_model_that_is_named_exists():
    listed = {link for link in LINK.findall((DOCS / "SUMMARY.md").read_text())}
    assert listed == {page.relative_to(DOCS).as_posix() for page in PAGES} - {"SUMMARY.md"}
    text = "".join(page.read_text() for page in PAGES)
    assert len(re.findall(r"caudal run models/", text)) >= 12
    for model in set(re.findall(r"models/[\w/-]+\.toml", text)):
        if "\n[axes" in (ROOT / model).read_text():
            continue  # a sweep, which is there
        caudal.load(ROOT / model)


def test_commands_of_the_guide_exist(command):
    text = "".join(page.read_text() for page in PAGES)
    listed = command(None, "--help").stdout
    for name in set(re.findall(r"\bcaudal ([a-z]+) (?:[A-Z]|models|[a-z]+\.toml|out/|bash|-)", text)):
        assert re.search(rf"^  {name} ", listed, re.MULTILINE), name


#: What the gallery says of a run: in which words, and from which number of its summary, in which unit.
GALLERY = {
    "baseline-smooth": [("{:.1f} cm in 20 s", "net_displacement_m", -1e2)],
    "eel": [
        ("{:.3f} m/s", "cycle_forward_speed_m_s", 1),
        ("{:.2f} body lengths per beat", "cycle_body_lengths", 1),
        ("transport {:.3f}", "cycle_cost_of_transport", 1),
    ],
    "fish": [("{:.2f} body lengths per beat", "cycle_body_lengths", 1), ("slip of {:.2f}", "cycle_slip", 1)],
    "snake": [("{:.2f} m/s", "cycle_forward_speed_m_s", 1)],
    "worm-over-a-wall": [
        ("{:.3f} mm/s", "cycle_forward_speed_m_s", 1e3),
        ("{:.2f} body lengths per beat", "cycle_body_lengths", 1),
    ],
    "sperm": [("{:.0f} µm/s", "cycle_forward_speed_m_s", 1e6), ("{:.3f} lengths per beat", "cycle_body_lengths", 1)],
    "elastic-tail-in-oil": [("{:.2f} mN", "cycle_thrust_n", 1e3)],
    "heaving-foil": [("{:.0f} mN", "cycle_thrust_n", 1e3)],
    "driven-head": [("{:.2f} mN", "cycle_thrust_n", 1e3), ("{:.1f} mW", "cycle_head_power_w", 1e3)],
    "dipping-tail": [("{:.3f} N of thrust", "cycle_thrust_n", 1)],
    "servo-tail": [
        ("{:.0f} mN m at most", "max_hinge_torque_n_m", 1e3),
        ("{:.0f} mN m in the root mean square", "cycle_rms_hinge_torque_n_m", 1e3),
        ("{:.0f} mN of thrust", "cycle_thrust_n", 1e3),
    ],
    "tendon-fish": [("{:.3f} m/s", "cycle_forward_speed_m_s", 1), ("{:.2f} body lengths per beat", "cycle_body_lengths", 1)],
}


def gallery():
    """The duration that each command of the gallery sets, and its answer, by its scene."""
    row = r"^(.*)\n\n`caudal run models/([\w-]+)\.toml(?: --set solver\.duration_s=(\d+))?`"
    rows = re.findall(row, (DOCS / "gallery.md").read_text(), re.MULTILINE)
    return {name: (duration, answer) for answer, name, duration in rows}


@pytest.mark.parametrize("name", GALLERY)
def test_an_answer_of_the_gallery_is_that_of_its_run(name):
    duration, answer = gallery()[name]
    scene = caudal.load(ROOT / f"models/{name}.toml", set={"solver.duration_s": float(duration)} if duration else None)
    summary = caudal.run(scene, record=[]).summary
    for words, key, unit in GALLERY[name]:
        assert words.format(unit * summary[key]) in answer, (words, summary[key])
        assert not key.startswith("cycle_") or summary["cycles_periodic"], f"{name} has not settled"


def test_the_other_answers_of_the_gallery():
    assert gallery().keys() - GALLERY.keys() == {"flag", "spinning-bar"}
    flag = caudal.load(ROOT / "models/flag.toml")
    for flow, moves in [(flag.parameters["medium.flow_m_s.0"], 0.033), (flag.parameters["medium.flow_m_s.0"] / 2, 0.0)]:
        run = caudal.run(caudal.load(flag, set={"medium.flow_m_s": [flow, 0.0]}))
        tip = run["tip_dy_m"][run["time_s"] > 16]
        assert tip.max() - tip.min() == pytest.approx(moves, abs=5e-4), flow
    assert "At 1.8 m/s it does, its tip 33 mm up and down; at half of that" in gallery()["flag"][1]
    tail = ROOT / "models/silicone-tail.toml"
    for loss, thrust in [(0.0, 7.0), (0.2, 1.8)]:
        run = caudal.run(caudal.load(tail, set={"head.angle_rad.frequency_hz": 3.75, "rod.loss_factor": loss}), record=[])
        assert f"{1e3 * run.summary['cycle_thrust_n']:.1f}" == f"{thrust}" and f"{thrust} mN" in (DOCS / "gallery.md").read_text()
    bar = caudal.run(ROOT / "models/spinning-bar.toml", record=[]).summary
    assert abs(bar["net_displacement_m"]) < 1e-13 and "Nothing moves its centre" in gallery()["spinning-bar"][1]


BLOCK = re.compile(r"^```(sh|toml|python|text)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
#: The name under which a reader saves a block, in its first line.
SAVED = re.compile(r"# ([\w-]+\.toml)\n")
#: Packages that snippets need and a machine may lack.
NEEDED = ["distributed", "fmpy", "gymnasium", "jax", "matplotlib", "xarray"]
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def blocks_of(page):
    """Kind and text of the blocks that are run, in their order."""
    return BLOCK.findall(page.read_text())


def reads_as(line, printed):
    """Whether a line of output is the printed one: `...` stands for anything, and numbers are the same to 1 %."""
    words = [re.escape(part).replace("\\ ", r"\s+") for part in NUMBER.split(printed)]
    pattern = f"({NUMBER.pattern})".join(words).replace(r"\.\.\.", ".*")
    found = re.fullmatch(rf"\s*{pattern}\s*", line)
    return found is not None and all(
        float(own) == pytest.approx(float(value), rel=1e-2) for own, value in zip(NUMBER.findall(printed), found.groups(), strict=True)
    )


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the models, in which the command is found."""
    command = shutil.which("caudal", path=str(Path(sys.executable).parent))
    if not command:
        pytest.skip("the package is installed without its command: pip install ./bindings/python")
    monkeypatch.setenv("PATH", f"{Path(command).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    return tmp_path


def run(script):
    """What a script prints. Standard input is closed: `new` asks nothing."""
    done = subprocess.run(["sh", "-euc", script], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 0, (script, done.stdout[-1000:], done.stderr[-1000:])
    return done.stdout + done.stderr


def need_packages_of(text):
    for package in NEEDED:
        if re.search(rf"(import|from) {package}|{package}\(|caudal\.{package}", text):
            pytest.importorskip(package)


def read_by_now(page):
    """The pages that a reader of this one has seen, in the order of the summary."""
    order = [DOCS / link for link in LINK.findall((DOCS / "SUMMARY.md").read_text())]
    return order[: order.index(page)]


@pytest.mark.parametrize("page", [page for page in PAGES if page != EXAMPLE and any(kind != "text" for kind, _ in blocks_of(page))], ids=lambda page: page.stem)
def test_the_snippets_of_a_page_run_as_printed(page, folder, capsys):
    """In their order, in the folder of a reader: it has the models, the swimmer of the first page, and what earlier pages said to save."""
    need_packages_of(page.read_text())
    if page.stem != "first-swim":
        run("caudal new swimmer.toml")
    for earlier in read_by_now(page):
        for kind, block in blocks_of(earlier):
            if kind == "toml" and (saved := SAVED.match(block)):
                (folder / saved[1]).write_text(block)
    names, output, done = {}, None, 0
    for kind, block in blocks_of(page):
        if kind == "sh":
            output = run(block)
        elif kind == "python":
            exec(compile(block, str(page), "exec"), names)
            output = capsys.readouterr().out
        elif kind == "text":
            # What the snippet before it prints, where there is one.
            if output is not None:
                lines = output.splitlines()
                for printed in filter(None, block.splitlines()):
                    assert any(reads_as(line, printed) for line in lines), (printed, output[-3000:])
            output = None
        else:
            name = saved[1] if (saved := SAVED.match(block)) else re.search(r'^name = "(.+)"$', block, re.MULTILINE)[1] + ".toml"
            (folder / name).write_text(block)
            run(f"caudal sweep {name} --dry-run" if "[axes]" in block else f"caudal check {name}")
            output = None
        done += 1
    assert done > 0
    if page.stem == "design":
        assert names["modulus"] == pytest.approx(0.8e6, rel=1e-2)


def test_the_tables_of_steps_and_meshes_are_what_the_runs_give(folder):
    """Each row of how-accurate.md is run again, to 1e-3 of what it says."""
    (tail,) = (block for kind, block in blocks_of(DOCS / "own-tail.md") if kind == "toml" and "# silicone-tail.toml" in block)
    (folder / "silicone-tail.toml").write_text(tail)

    def found(*changes):
        return json.loads(run("caudal run silicone-tail.toml --quiet --json --force " + " ".join(f"--set {change}" for change in changes)))

    text = (DOCS / "how-accurate.md").read_text()
    steps = re.findall(r"^\| (?:tolerance (\S+?)(?:, the default)?|`time_step_s = (\S+)`, `(\S+)`) \| (\d+) \| (\S+) mN \| (\S+) mW \|$", text, re.M)
    meshes = re.findall(r"^\| (\d+) \| \S+ mm \| (\S+) mN \|", text, re.M)
    assert len(steps) == 6 and len(meshes) == 5
    for tolerance, step, method, count, thrust, power in steps:
        changes = [f"solver.tolerance={tolerance}"] if tolerance else [f"solver.time_step_s={step}", f"solver.integrator={method}"]
        row = found(*changes)
        assert row["steps"] == pytest.approx(int(count), rel=1e-2), changes
        assert 1e3 * row["cycle_thrust_n"] == pytest.approx(float(thrust), rel=1e-3), changes
        assert 1e3 * row["cycle_head_power_w"] == pytest.approx(float(power), rel=1e-3), changes
    for nodes, thrust in meshes:
        assert 1e3 * found(f"rod.nodes={nodes}")["cycle_thrust_n"] == pytest.approx(float(thrust), rel=1e-3), nodes
    (eel,) = re.findall(r"is (\S+) with (\d+) nodes and (\S+) with (\d+)\.", text)
    for efficiency, nodes in zip(eel[::2], eel[1::2]):
        row = json.loads(run(f"caudal run models/eel.toml --quiet --json --force --set rod.nodes={nodes}"))
        assert f"{row['cycle_efficiency']:.3f}" == efficiency, nodes


def test_pages_that_list_the_extras_and_the_studies_list_all():
    project = (ROOT / "bindings/python/pyproject.toml").read_text()
    extras = set(re.findall(r"^(\w+) = \[", re.search(r"optional-dependencies\]\n(.*?)\n\n", project, re.DOTALL)[1], re.M))
    readme, page = (ROOT / "bindings/python/README.md").read_text(), (DOCS / "python.md").read_text()
    assert set(re.search(r"extras: (.*)$", readme, re.M)[1].split(", ")) == extras
    assert set(re.findall(r"`(\w+)`", re.search(r"Extras: (.*?), as in", page, re.DOTALL)[1])) == extras
    kinds = set(re.findall(r'"(\w+)"', re.search(r"`caudal\.study\((.*?)returns", readme, re.DOTALL)[1]))
    assert kinds == set(re.findall(r"\w+", re.search(r"kind : \{(.*)\}", caudal.study.__doc__)[1]))


def test_the_figures_of_a_run_that_a_page_lists_are_those_that_are_drawn():
    source = (ROOT / "src/report/run_figures.rs").read_text()
    files = re.findall(r'"(\w+\.svg)"', re.search(r"pub const FILES.*?\];", source, re.DOTALL)[0])
    table = re.search(r"A run writes to.*?\n\n- ", (DOCS / "details.md").read_text(), re.DOTALL)[0]
    assert len(files) > 10 and re.findall(r"`(\w+\.svg)`", table) == files


@pytest.mark.parametrize("page", [page for page in PAGES if "```c\n" in page.read_text()], ids=lambda page: page.stem)
def test_the_c_programs_of_a_page_compile(page, tmp_path):
    """They are not linked here: `bindings/c/tests` builds the library and runs a host."""
    compiler = shutil.which("cc") or pytest.skip("there is no C compiler")
    for program in re.findall(r"^```c\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL):
        source = _written(tmp_path / "host.c", program)
        options = ["-std=c11", "-Wall", "-Werror", "-fsyntax-only", "-I", ROOT / "bindings/c/include"]
        compiled = subprocess.run([compiler, *options, source], capture_output=True, text=True)
        assert compiled.returncode == 0, compiled.stderr


def test_the_scenes_and_commands_by_example_are_taken_as_printed(folder):
    text = EXAMPLE.read_text()
    blocks = blocks_of(EXAMPLE)
    scenes = [block for kind, block in blocks if kind == "toml"]
    page = text[text.index("## A scene in one page") :]
    whole = BLOCK.search(page)[2]
    assert caudal.load(_written(folder / "eel.toml", whole)).name == "eel"
    # Its mistake is told as printed, up to what is left out.
    (printed,) = (block for kind, block in blocks if kind == "text")
    _written(folder / "eel.toml", whole.replace("\nlength_m =", "\nlength_mm =", 1))
    refused = subprocess.run(["caudal", "check", "eel.toml"], capture_output=True, text=True)
    assert refused.returncode == 2
    assert all(part.strip() in refused.stderr for part in printed.split("…")), (printed, refused.stderr)
    layers = next(block for block in scenes if "[medium.beyond]" in block)
    bare = re.sub(r"^\[medium\](?:.*\n)(?:[^\[\n].*\n|\n)*", "", (ROOT / "models/glycerol.toml").read_text(), flags=re.MULTILINE)
    assert caudal.load(_written(folder / "layers.toml", bare + "\n" + layers)).parameters["medium.beyond.offset_m"] == 0.06
    (sweep,) = (block for block in scenes if "[axes]" in block)
    shutil.copy(ROOT / "models/baseline.toml", folder)
    _written(folder / "sweep.toml", sweep)
    assert "3200 of 3200 cases" in run("caudal sweep sweep.toml --dry-run")
    (design,) = (block for kind, block in blocks if kind == "sh")
    assert "the gain of" in run(design)
    assert len(scenes) == 3 and len(blocks) == 5


FENCE = re.compile(r"^( *)```([\w,]*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
#: Kinds of blocks that tests in Rust run: those of `bindings/c/tests/c.rs` and `tests/stepping/guide.rs`.
RUN_IN_RUST = {"c", "console", "cmake", "rust,ignore"}
#: Blocks that no test runs as printed, by their page and first words, and why.
NOT_RUN = {
    ("README.md", "cargo run"): "builds the program and runs all tests: tests/bare_machine.sh does so on a machine made for it",
    ("CONTRIBUTING.md", "cargo run"): "the same two commands",
    ("bindings/python/README.md", "pip install"): "builds the package: bindings/python/tests/all.sh installs it before this test",
    ("bindings/python/README.md", "from distributed"): "needs a cluster at that address: test_engines.py sweeps on one of its own",
    ("docs/src/hosts.md", "[dependencies]"): "a part of another program's Cargo.toml: tests/lint.sh builds with these features",
    ("docs/src/notes/design-searches.md", "caudal design"): "half a minute: tests/design/inverse.rs asserts what it reaches",
    ("docs/src/notes/tests.md", "target/hosts"): "hours of processor time",
}


def test_every_block_of_the_pages_is_run_or_says_here_why_not():
    left = set(NOT_RUN)
    for page in [*PAGES, *OUTSIDE]:
        name, before = page.relative_to(ROOT).as_posix(), None
        for indent, kind, block in FENCE.findall(page.read_text()):
            reason = next((key for key in NOT_RUN if key[0] == name and block.startswith(key[1])), None)
            left.discard(reason)
            if name == "bindings/python/README.md":
                run_by_test = block.startswith(">>> ")  # test_documentation.py
            elif page in PAGES and page != EXAMPLE:
                run_by_test = kind in {"sh", "toml", "python", *RUN_IN_RUST} or kind == "text" and before in ("sh", "python")
            else:
                run_by_test = page == EXAMPLE or name == "README.md"  # their own tests
            assert reason or not indent and run_by_test, (name, kind, block)
            before = kind
    assert not left


def test_the_readme_is_short_and_runs_as_printed(tmp_path, monkeypatch, command):
    text = (ROOT / "README.md").read_text()
    lines = text.splitlines()
    assert len(lines) <= 150 and max(map(len, lines)) <= 120
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    scene = next(block for kind, block in BLOCK.findall(text) if kind == "toml")
    assert len(scene.splitlines()) == 10
    _written(tmp_path / "swimmer.toml", scene)
    assert "warning" not in command(None, "check", "swimmer.toml").stdout
    # The last line of its run is the one that is printed, as far as it is.
    said = command(None, "run", "swimmer.toml").stdout
    printed = re.search(r"^over the last .*$", text, re.MULTILINE)[0].split("…")
    assert all(part in said for part in printed), (printed, said)
    # So is the error of a key that does not exist.
    _written(tmp_path / "swimmer.toml", scene.replace("rod.length_m ", "rod.length_mm "))
    with pytest.raises(subprocess.CalledProcessError) as refused:
        command(None, "check", "swimmer.toml")
    printed = re.search(r"^error: swimmer.*$", text, re.MULTILINE)[0].split("…; ")
    assert all(part in refused.value.stderr for part in printed), (printed, refused.value.stderr)
    _written(tmp_path / "swimmer.toml", scene)
    for kind, block in BLOCK.findall(text):
        if kind == "sh":
            for line in block.splitlines():
                if line.startswith("caudal "):
                    command(None, *line.split("#")[0].split()[1:])
        elif kind == "python":
            exec(compile(block, "README.md", "exec"), {})


def test_the_design_document_is_short():
    lines = (ROOT / "DESIGN.md").read_text().splitlines()
    assert len(lines) <= 250 and max(map(len, lines)) <= 140


def _written(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("notebook", sorted((DOCS / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs(notebook, tmp_path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if "jax" in notebook.read_text():
        pytest.importorskip("jax")
    content = nbformat.read(notebook, as_version=4)
    nbformat.validate(content)
    nbclient.NotebookClient(content, timeout=120, resources={"metadata": {"path": str(notebook.parent)}}).execute()
    (tmp_path / notebook.name).write_text(json.dumps(content))
    drawn = [output for cell in content.cells for output in cell.get("outputs", []) if "image/png" in output.get("data", {})]
    assert drawn
