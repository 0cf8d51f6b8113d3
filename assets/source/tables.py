"""Tables in the docs: what is understood, noted and refused (``files.md``), and whose cameras are
read (``cameras.md``), from the readers' own lists; the packages (``architecture.md``), from their
import contract.

Run from the repository's root: ``python -m assets.source.tables`` writes them.
"""

import ast
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

from poseviewer.files.camera_forms import LENS_NAMES, READ
from poseviewer.files.camera_trees import TREES
from poseviewer.files.colmap_model import MODELS
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.mesh.gltf import HARMLESS, SPARED, UNDERSTOOD
from poseviewer.files.mesh.load import ELSEWHERE, READERS
from poseviewer.files.photo import ENDINGS, RAW_ENDINGS

ROOT = Path(__file__).resolve().parents[2]
PART = re.compile(r"(?<=<!-- made -->\n).*(?=<!-- end -->)", re.DOTALL)
RULE = "---"


def files() -> list[tuple[str, ...]]:
    """Rows of what is understood."""
    plain = [name for name in READERS if "gl" not in name]
    colmap = {True: [], False: []}
    for name, (*_, lens) in MODELS.items():
        colmap[lens is not None].append(name)
    tools = ", ".join(tools for tools, *_ in READ)
    return [
        ("format", "understood", "noted", "refused"),
        (RULE,) * 4,
        ("photos", _codes(ENDINGS), "transparency", f"raw: {_codes(RAW_ENDINGS)}"),
        (
            "models", f"{_codes(plain)}; polygons, strips, textures of 8 and 16 bits",
            "missing textures, faces without area; 3MF: textures, beams; DAE: animations",
            f"{_codes(ELSEWHERE)}, point clouds; 3MF: objects in several files, other extensions; "
            "DAE: skins, morphs, holes",
        ),
        (
            "glTF",
            "sparse, normalised and quantised accessors, texture coordinates, alpha masks, skins "
            f"at rest, morph weights, strips and fans; {_codes(UNDERSTOOD)}; without need: "
            f"{_codes(f'{name}...' for name in HARMLESS)}",
            "unknown extensions; animations and morphs; lines, points; what is invisible by its "
            "alpha, hidden or in no scene; triangles cut out in part; textures that are clamped or "
            "mirrored",
            "any other extension in `extensionsRequired`, as " + _codes(SPARED),
        ),
        (
            "cameras", f"{_codes(TREES)}: {tools}",
            "another size in the same ratio; a photo that EXIF turns",
            "skew; a principal point outside the photo; keys that may be a lens or a size and are "
            "not known; four coefficients of which nothing says the model",
        ),
        (
            "lenses", "; ".join(f"as OpenCV's {model}: {_codes(names.split())}"
                                for model, names in LENS_NAMES.items() if model),
            "", f"any other model; {_codes((LENS_NAMES[None]).split())} with coefficients",
        ),
        ("COLMAP", _codes(colmap[True]), "", _codes(colmap[False])),
        ("poses", _codes(FORMATS), "a rotation that is not quite one; another photo or model", ""),
    ]  # fmt: skip


def cameras() -> list[tuple[str, ...]]:
    """Rows of the tools whose cameras are read."""
    rows = [(tools, _codes(files.split()), keys) for tools, files, keys in READ]
    return [("of", "file", "what is read"), (RULE,) * 3, *rows]


def architecture() -> list[tuple[str, ...]]:
    """Rows of the packages that may import one another downwards, the uppermost first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    rows = [("packages", "what is in them"), (RULE,) * 2]
    for layer in contracts["contracts"][0]["layers"]:
        packages = layer.split(" | ")
        rows.append((_codes(packages), "<br>".join(map(_purpose, packages))))
    return rows


def _purpose(name: str) -> str:
    """The first sentence of a package's docstring."""
    package = ROOT / "poseviewer" / name
    path = package / "__init__.py" if package.is_dir() else package.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text())) or ""
    return " ".join(text.split("\n\n")[0].split()).rstrip(".:")


PAGES = {
    ROOT / "assets" / "docs" / f"{make.__name__}.md": make
    for make in (files, cameras, architecture)
}
"""Functions that make the rows of the table of each page."""


def page(path: Path) -> str:
    """The page with the table as it is made now."""
    text = "".join(f"| {' | '.join(row)} |\n" for row in PAGES[path]())
    return PART.sub(lambda _: text, path.read_text("utf-8"))


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


if __name__ == "__main__":
    for path in PAGES:
        path.write_text(page(path), "utf-8")
