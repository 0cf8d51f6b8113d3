"""The documentation holds together: links and pictures are there, its commands are commands, what
is generated is up to date, and the notebook runs.
"""

import json
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from assets.source import tables
from poseviewer.cli import main as cli

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "assets" / "docs"
PAGES = sorted(DOCS.glob("*.md"))
OTHER_PAGES = (ROOT / "README.md", ROOT / ".github" / "CONTRIBUTING.md")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
MAX_BYTES = 2_400_000


def test_the_index_names_every_page():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in PAGES:
        assert page.stem == "index" or f"]({page.name})" in index, page.name
    assert "(assets/docs/index.md)" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [*PAGES, *OTHER_PAGES], ids=lambda page: page.name)
def test_links_and_pictures_are_there(page: Path):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        assert path.is_file(), target
        if anchor:
            assert anchor in anchors_of(path), target


def anchors_of(page: Path) -> set[str]:
    """As GitHub makes them of headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_pictures_are_small_and_shown():
    pictures = [path for path in DOCS.rglob("*") if path.suffix in (".jpg", ".webp", ".png")]
    assert sum(path.stat().st_size for path in pictures) < MAX_BYTES
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for path in pictures:
        assert path.relative_to(DOCS).as_posix() in text


def test_buttons_and_steps_in_the_docs_are_on_the_page():
    sources = (
        *(ROOT / "poseviewer/app/page").glob("*.py"),
        ROOT / "poseviewer/app/state/keys_and_buttons.py",
    )
    shown = "".join(path.read_text(encoding="utf-8") for path in sources)
    told = "".join(page.read_text(encoding="utf-8") for page in (*PAGES, ROOT / "README.md"))
    named = re.findall(r"(?:[Pp]ress|button|step|folder|[Cc]hoose) \*(\w+(?: \w+)?)", told)
    assert len(named) > 10
    assert not [name for name in named if name not in shown]


def commands_of(page: Path) -> list[str]:
    """The lines of code blocks that call poseviewer."""
    blocks = re.findall(r"```[a-z]*\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("poseviewer ") and " | " not in line]


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.name)
def test_commands_are_commands(page: Path):
    for line in commands_of(page):
        words = shlex.split(line, comments=True)[1:]
        # The page on formats says FORMAT for any of them.
        words = ["opencv" if word == "FORMAT" else word for word in words]
        try:
            cli.parse(words)
        except SystemExit as ended:
            pytest.fail(f"{line}: ends with {ended.code}")


@pytest.mark.parametrize("page", tables.PAGES, ids=lambda page: page.name)
def test_tables_are_those_of_readers_and_contracts(page):
    assert page.read_text("utf-8") == tables.page(page), "run: python -m assets.source.tables"


def test_names_of_the_api_reference_are_there_with_docstrings():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^::: (\S+)\n    options:\n      members: \[(.*)\]$", page, re.MULTILINE)
    assert len(blocks) == page.count(":::") > 10
    for module, names in blocks:
        for name in names.split(", "):
            assert getattr(import_module(module), name).__doc__, name


def test_the_site_has_every_page():
    listed = (ROOT / "assets" / "mkdocs.yml").read_text(encoding="utf-8")
    assert {page.name for page in PAGES} == set(re.findall(r"\w+\.md", listed))


@pytest.mark.slow
def test_the_notebook_has_outputs_and_runs(capsys):
    """In this process, one cell after another; the search is cut short."""
    cells = json.loads((DOCS / "library.ipynb").read_text(encoding="utf-8"))["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum("image/jpeg" in output.get("data", {}) for output in outputs) >= 2
    assert all(output["output_type"] != "error" for output in outputs)
    names: dict[str, object] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            text = "".join(cell["source"]).replace("evaluations=1500", "evaluations=60")
            exec(compile(text, "library.ipynb", "exec"), names)
    printed = capsys.readouterr().out
    assert "['maps.npz', 'pose.json']" in printed
    assert "there is no look 'glossy'" in printed
