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
from poseviewer.files import photo_sets, scene_assets, scene_json
from poseviewer.files import pose as pose_file
from poseviewer.fit import progress, search, slices, stages, view_results, visibility
from poseviewer.geometry import camera, transform
from poseviewer.optimise import protocol
from poseviewer.scene import assets, settings, types
from poseviewer.starts import instances, loading, measuring

PAGE = Path(__file__).resolve().parent.parent / "docs" / "api.md"
HEAD = """# API reference

Made from the docstrings by `python -m assets.source.api_reference`; do not edit it here. How to use
it: [as a library](library.md).

Arrays are given as (rows, columns). Camera axes are OpenCV's: x right, y down, z forward. Inside
the program pixel centres are at i + 0.5; in files they are at integers. Lengths are in the model's
unit, angles in radians unless a name ends in `_deg`.
"""
CONTENT: tuple[tuple[ModuleType, str], ...] = (
    (api, "load make_registration PosedScene Registration FitResult LossMaps"),
    (view_results, "ViewResult"),
    (instances, "AutoStart"),
    (loading, "StartCamera StartInputs Start"),
    (scene_assets, "load_model view_of_file"),
    (assets, "PhotoFile ModelFile"),
    (types, "Scene View SceneObject InView SearchResult"),
    (search, "Search SearchProgress"),
    (stages, "Stage make_stages"),
    (protocol, "State"),
    (visibility, "Visibility visibility"),
    (settings, "FitSettings Limits"),
    (progress, "FitProgress SearchProgress Status"),
    (slices, "Slice"),
    (camera, "Pose Perspective Parallel"),
    (transform, "RigidTransform Similarity"),
    (pose_file, "PoseRecord load_pose save_pose"),
    (scene_json, "load_scene save_scene as_saved"),
    (photo_sets, "SetChoice LoadedViews load_views"),
    (measuring, "measure_point MeasuredPoint measure_distance measure_relative"),
    (errors, "PoseViewerError"),
)
"""Modules and their public names, in the page's order."""
LISTED = {name for _, names in CONTENT for name in names.split()}


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
    for base in (base for base in bases if base.__name__ in LISTED):
        text += f"Beside what [`{base.__name__}`](#{base.__name__.lower()}) has:\n\n"
    bases = [base for base in bases if base.__name__ not in LISTED]
    text += "".join(f"- {row}\n" for owner in (*bases, thing) for row in _fields(owner))
    for name, value in ChainMap(*(dict(vars(owner)) for owner in (thing, *bases))).items():
        found = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if name.startswith("_"):
            continue
        if isinstance(found, property) and found.__doc__:
            text += f"\n**`{name}`** (property): {_flat(found.__doc__)}\n"
        elif inspect.isfunction(found) and found.__doc__:
            text += f"\n#### `{thing.__name__}.{name}`\n\n{_signature(found)}{_doc(found)}"
    return text


def _fields(thing: type) -> list[str]:
    """A row for each field: name, type, default, and the string under it."""
    body = ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]
    assert isinstance(body, ast.ClassDef)
    rows = []
    for index, node in enumerate(body.body):
        if not isinstance(node, ast.AnnAssign | ast.Assign):
            continue
        is_typed = isinstance(node, ast.AnnAssign)
        name = ast.unparse(node.target if is_typed else node.targets[0])
        kind = f": {ast.unparse(node.annotation)}" if is_typed else ""
        if name.startswith("_") or isinstance(vars(thing).get(name), property):
            continue
        below = body.body[index + 1] if index + 1 < len(body.body) else None
        said = ""
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            said = f": {_flat(str(below.value.value))}"
        default = "" if node.value is None else f" = {ast.unparse(node.value)}"
        rows.append(f"`{name}{kind}{default}`{said}")
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
