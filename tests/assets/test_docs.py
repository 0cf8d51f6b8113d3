"""The documentation holds together: links and pictures are there, its commands are commands, what
is generated is up to date, and the notebook runs.
"""

from __future__ import annotations

import ast
import json
import re
import shlex
from pathlib import Path

import pytest

from assets.source.api_reference import CONTENT, api_as_markdown
from assets.source.notebook import CELLS, CODE
from assets.source.rooms import PICTURE, rooms_as_svg
from poseviewer import errors
from poseviewer.batch import table
from poseviewer.cli import main as cli
from poseviewer.files import cameras, checks, colmap_model, file_set, marks, photo
from poseviewer.files.mesh import load as mesh
from poseviewer.files.mesh import parts
from poseviewer.files.state import uploads

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "assets" / "docs"
PAGES = sorted(DOCS.glob("*.md"))
TASKS = ("place", "quick_starts", "wheels", "cameras", "many_photos", "several", "views",
         "which_model", "symmetric", "export", "library", "settings", "files",
         "how_sure")  # fmt: skip
BACKGROUND = ("method", "results", "architecture", "experiments", "api", "formats",
              "limits")  # fmt: skip
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
LARGEST_BYTES = 2_000_000


def test_there_is_a_page_for_each_task_and_the_index_names_them():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for name in (*TASKS, *BACKGROUND):
        assert (DOCS / f"{name}.md").is_file()
        assert f"]({name}.md)" in index
    assert "(assets/docs/index.md)" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.name)
def test_links_and_pictures_are_there(page: Path):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        assert path.is_file(), target
        if anchor:
            assert anchor in anchors_of(path), target


def test_the_page_of_limits_has_those_of_the_code():
    text = (DOCS / "limits.md").read_text(encoding="utf-8")
    for limit in (
        f"{photo.MAX_MEGAPIXELS:.0f} megapixels; {photo.LARGEST_FILE / 1e9:.0f} GB",
        f"{photo.LARGEST_REST / 1e6:.0f} MB more",
        f"{mesh.LARGEST_FILE / 1e9:.0f} GB; {parts.MAX_FACES:,} faces",
        f"{parts.MAX_PARTS:,} parts",
        f"{parts.MOST_TEXELS / 1e6:.0f} megapixels each, and {parts.MOST_TEXTURES:,} of them",
        f"material file | {parts.LARGEST_MATERIALS / 1e6:.0f} MB",
        f"session | {checks.LARGEST_FILE / 1e6:.0f} MB",
        f"{cameras.LARGEST_FILE / 1e6:.0f} MB; as YAML or XML {cameras.MOST_LINES:,} lines",
        f"brackets {cameras.DEEPEST_TEXT} deep; lists of more than {cameras.MOST_ENTRIES} numbers",
        f"{colmap_model.LARGEST_FILE / 1e9:.0f} GB, a line of "
        f"{colmap_model.LONGEST_LINE / 1e6:.0f} MB",
        f"wheels | {marks.LARGEST_FILE / 1e6:.0f} MB",
        f"jobs | {table.LARGEST_TABLE / 1e6:.0f} MB",
        f"uploaded | {uploads.LARGEST_UPLOAD / 1e6:.0f} MB; a zip unpacks to "
        f"{uploads.LARGEST_UNPACKED / 1e9:.0f} GB and {file_set.MOST_FILES:,} files",
        f"{checks.LARGEST_PX:.0e} px".replace("e+0", "e"),
        f"up to {checks.LARGEST_NUMBER:g}; what".replace("e+", "e"),
        f"{errors.LONGEST_MESSAGE:,} characters",
    ):
        assert limit in text, limit


def anchors_of(page: Path) -> set[str]:
    """As GitHub makes them of headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_pictures_are_small_and_shown():
    pictures = [path for path in DOCS.rglob("*") if path.suffix in (".jpg", ".webp", ".png")]
    assert sum(path.stat().st_size for path in pictures) < LARGEST_BYTES
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for path in pictures:
        assert path.relative_to(DOCS).as_posix() in text


def commands_of(page: Path) -> list[str]:
    """The lines of code blocks that call poseviewer."""
    blocks = re.findall(r"```[a-z]*\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("poseviewer ") and " | " not in line]


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.name)
def test_commands_are_commands(page: Path):
    found = commands_of(page)
    for line in found:
        words = shlex.split(line, comments=True)[1:]
        # The page on formats says FORMAT for any of them.
        words = ["opencv" if word == "FORMAT" else word for word in words]
        try:
            cli.parse(words)
        except SystemExit as ended:
            pytest.fail(f"{line}: ends with {ended.code}")
    assert found or page.stem in ("index", "library", *BACKGROUND)


def test_the_api_reference_is_that_of_the_docstrings():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    assert page == api_as_markdown(), "run: python -m assets.source.api_reference"
    for _, _, names in CONTENT:
        for name in names:
            assert f"### `{name}`" in page


def test_the_picture_of_the_rooms_is_that_of_the_contracts():
    assert PICTURE.read_text(encoding="utf-8") == rooms_as_svg(), (
        "run: python -m assets.source.rooms"
    )


def notebook() -> dict:
    return json.loads((DOCS / "library.ipynb").read_text(encoding="utf-8"))


def test_the_notebook_is_that_of_the_script_with_real_outputs():
    cells = notebook()["cells"]
    found = [(cell["cell_type"], "".join(cell["source"])) for cell in cells]
    assert found == list(CELLS), "run: python -m assets.source.notebook"
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum("image/jpeg" in output.get("data", {}) for output in outputs) >= 2
    assert all(output["output_type"] != "error" for output in outputs)
    assert (DOCS / "library.ipynb").stat().st_size < 300_000


@pytest.mark.slow
def test_the_notebooks_code_runs(capsys):
    """In this process, one cell after another; the search is cut short."""
    names: dict[str, object] = {}
    for kind, text in CELLS:
        if kind == CODE:
            short = text.replace("evaluations=1500", "evaluations=60")
            tree = ast.parse(short)
            exec(compile(tree, "library.ipynb", "exec"), names)
    printed = capsys.readouterr().out
    assert "chart: mu_x, mu_y, delta_x" in printed
    assert "['maps.npz', 'pose.json']" in printed
    assert "there is no look 'glossy'" in printed
