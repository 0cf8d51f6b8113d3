"""``assets/docs/api.md`` from the docstrings of ``poseviewer.api`` and of what it hands out.

Run from the repository's root: ``python -m assets.source.api_reference``.
"""

import ast
import inspect
import re
import textwrap
from collections import ChainMap
from pathlib import Path
from types import ModuleType
from typing import Any

from poseviewer import api, errors
from poseviewer.files import photo_sets
from poseviewer.files import pose as pose_file
from poseviewer.files import scene_json as scene_file
from poseviewer.fit import progress, search, settings, slices, visibility
from poseviewer.fit import scene as scene_data
from poseviewer.geometry import camera, transform, view
from poseviewer.starts import loading as opening

PAGE = Path(__file__).resolve().parent.parent / "docs" / "api.md"
HEAD = """# API reference

Made from the docstrings by `python -m assets.source.api_reference`; do not edit it here. How to use
it: [as a library](library.md).

Arrays are given as (rows, columns). Camera axes are OpenCV's: x right, y down, z forward. Inside
the program pixel centres are at i + 0.5; in files they are at integers. Lengths are in the model's
unit, angles in radians unless a name ends in `_deg`.
"""
CONTENT: tuple[tuple[ModuleType, str], ...] = (
    (api, "load make_scene Scene ViewResult LossMaps"),
    (opening, "load_model"),
    (view, "View"),
    (scene_data, "Scene SceneObject InView LoadedModel SearchResult"),
    (search, "Search SearchProgress"),
    (visibility, "Visibility visibility"),
    (settings, "FitSettings Limits"),
    (progress, "FitProgress Status"),
    (slices, "Slice"),
    (camera, "Pose Perspective Parallel"),
    (transform, "RigidTransform Similarity"),
    (pose_file, "PoseRecord load_pose save_pose"),
    (scene_file, "SceneRecord ObjectRecord"),
    (photo_sets, "SetChoice LoadedViews load_views"),
    (errors, "PoseViewerError"),
)
"""Modules and their public names, in the page's order."""


def api_as_markdown() -> str:
    """The page."""
    return HEAD + "".join(
        f"\n## {module.__name__}\n".replace("poseviewer.api", "poseviewer")
        + "".join(_entry(getattr(module, name)) for name in names.split())
        for module, names in CONTENT
    )


def _entry(thing: Any) -> str:
    if inspect.isclass(thing):
        return _class(thing)
    return f"\n### `{thing.__name__}`\n\n{_signature(thing)}{_doc(thing)}"


def _class(thing: type) -> str:
    text = f"\n### `{thing.__name__}`\n\n{_doc(thing)}"
    bases = [base for base in thing.__bases__ if base.__module__.startswith("poseviewer.")]
    text += "".join(f"- {row}\n" for owner in (*bases, thing) for row in _fields(owner))
    for name, value in ChainMap(*(dict(vars(owner)) for owner in (thing, *bases))).items():
        found = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if name.startswith("_"):
            continue
        if isinstance(found, property) and found.fget is not None and found.fget.__doc__:
            text += f"\n**`{name}`** (property): {_flat(found.fget.__doc__)}\n"
        elif inspect.isfunction(found) and found.__doc__:
            text += f"\n#### `{thing.__name__}.{name}`\n\n{_signature(found)}{_doc(found)}"
    return text


def _fields(thing: type) -> list[str]:
    """A row for each field: name, type, default, and the string under it."""
    body = ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]
    assert isinstance(body, ast.ClassDef)
    rows = []
    for index, node in enumerate(body.body):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name, kind, value = node.target.id, ast.unparse(node.annotation), node.value
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            name, kind, value = node.targets[0].id, "", node.value
        else:
            continue
        if name.startswith("_"):
            continue
        below = body.body[index + 1] if index + 1 < len(body.body) else None
        said = ""
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            said = f": {_flat(str(below.value.value))}"
        default = "" if value is None else f" = {ast.unparse(value)}"
        rows.append(f"`{name}{f': {kind}' if kind else ''}{default}`{said}")
    return rows


def _signature(function: Any) -> str:
    source = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(source, ast.FunctionDef)
    returns = f" -> {ast.unparse(source.returns)}" if source.returns else ""
    return f"```python\n{function.__name__}({ast.unparse(source.args)}){returns}\n```\n\n"


def _doc(thing: Any) -> str:
    """The docstring: its sections as lists, its code in fences."""
    lines = inspect.cleandoc(thing.__doc__ or "").replace("``", "`").splitlines()
    text, in_section = "", False
    for line in lines:
        if line in ("Args:", "Raises:", "Returns:"):
            in_section = True
            text += f"*{line[:-1]}*\n\n"
        elif in_section and re.match(r" {4}\S", line):
            name, _, rest = line.strip().partition(": ")
            text += f"- `{name}`: {rest}\n" if rest else f"- {name}\n"
        elif in_section and line:
            text += f"  {line.strip()}\n"
        else:
            text += f"{line}\n"
    return text.rstrip() + "\n\n"


def _flat(text: str) -> str:
    return " ".join(text.replace("``", "`").split())


if __name__ == "__main__":
    PAGE.write_text(api_as_markdown(), encoding="utf-8")
