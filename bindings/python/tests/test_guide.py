"""The guide: links lead somewhere, every page is in its summary, notebooks run, commands and Python in it exist."""

import json
import re
from pathlib import Path

import pytest

import caudal

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs/src"
PAGES = sorted(DOCS.glob("*.md"))
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def anchors(page):
    """The names that headings of a Markdown file can be linked by."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_lead_to_files_and_headings_that_are_there():
    checked = 0
    for page in [*PAGES, ROOT / "README.md", ROOT / "bindings/python/README.md"]:
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
    assert listed == {page.name for page in PAGES} - {"SUMMARY.md"}
    text = "".join(page.read_text() for page in PAGES)
    assert len(re.findall(r"caudal run models/", text)) >= 12
    for model in set(re.findall(r"models/[\w/-]+\.toml", text)):
        caudal.load(ROOT / model)


def test_commands_of_the_guide_exist(command):
    text = "".join(page.read_text() for page in PAGES)
    listed = command(None, "--help").stdout
    for name in set(re.findall(r"\bcaudal ([a-z]+) (?:[A-Z]|models|[a-z]+\.toml|out/|bash|-)", text)):
        assert re.search(rf"^  {name} ", listed, re.MULTILINE), name


@pytest.mark.parametrize("notebook", sorted((DOCS / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs(notebook, tmp_path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if "jax" in notebook.read_text():
        pytest.importorskip("jax")
    content = nbformat.read(notebook, as_version=4)
    nbformat.validate(content)
    nbclient.NotebookClient(content, timeout=120, resources={"metadata": {"path": str(ROOT)}}).execute()
    (tmp_path / notebook.name).write_text(json.dumps(content))
    drawn = [output for cell in content.cells for output in cell.get("outputs", []) if "image/png" in output.get("data", {})]
    assert drawn
