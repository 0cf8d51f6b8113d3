"""The table in ``assets/docs/files.md`` of what is understood, noted and refused, made from the
readers' own lists.

Run from the repository's root: ``python -m assets.source.understood`` writes it.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from poseviewer.files.camera_forms import FORMS, LENS_NAMES, TREES
from poseviewer.files.colmap_model import MODELS
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.mesh.gltf import HARMLESS, LOST, UNDERSTOOD
from poseviewer.files.mesh.load import ELSEWHERE, READERS
from poseviewer.files.photo import ENDINGS, RAW_ENDINGS

PAGE = Path(__file__).resolve().parent.parent / "docs" / "files.md"
PART = re.compile(r"(?<=<!-- understood -->\n).*(?=<!-- end -->)", re.DOTALL)


def table() -> str:
    """The rows, in Markdown."""
    plain = [name for name in READERS if "gl" not in name]
    colmap = {True: [], False: []}
    for name, (*_, lens) in MODELS.items():
        colmap[lens is not None].append(name)
    tools = ", ".join(dict.fromkeys(form.tools for form in FORMS))
    rows = [
        ("format", "understood", "noted", "refused"),
        ("---", "---", "---", "---"),
        ("photos", _codes(ENDINGS), "transparency", f"raw: {_codes(RAW_ENDINGS)}"),
        (
            "models", f"{_codes(plain)}; polygons, strips, textures of 8 and 16 bits",
            "missing textures, faces without area", f"{_codes(ELSEWHERE)}, point clouds",
        ),
        (
            "glTF",
            "sparse, normalised and quantised accessors, texture coordinates, alpha masks, skins "
            f"at rest, morph weights, strips and fans; {_codes(UNDERSTOOD)}; without need: "
            f"{_codes(f'{name}...' for name in HARMLESS)}",
            _codes(name for name, lost in LOST.items() if lost) + " and unknown extensions; lines, "
            "points; triangles cut out in part",
            "any other extension in `extensionsRequired`, as " + _codes(LOST),
        ),
        (
            "cameras", f"{_codes(TREES)}: {tools}",
            "another size in the same ratio",
            "skew; a principal point outside the photo; keys that may be a lens and are not known",
        ),
        (
            "lenses", "; ".join(f"as OpenCV's {model}: {_codes(names.split())}"
                                for model, names in LENS_NAMES.items() if model),
            "", f"any other model; {_codes((LENS_NAMES[None]).split())} with coefficients",
        ),
        ("COLMAP", _codes(colmap[True]), "", _codes(colmap[False])),
        ("poses", _codes(FORMATS), "a rotation that is not quite one; another photo or model", ""),
    ]  # fmt: skip
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def page() -> str:
    """The page with the table as it is made now."""
    return PART.sub(lambda _: table(), PAGE.read_text("utf-8"))


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
