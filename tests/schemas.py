"""The JSON Schemas (2020-12) of our files."""

import json
from importlib.resources import files
from typing import Any


def json_schema(name: str) -> dict[str, Any]:
    """Load that of ``pose``, ``scene`` or ``symmetry`` files."""
    path = files("poseviewer.files").joinpath(f"{name}.schema.json")
    return json.loads(path.read_text(encoding="utf-8"))
