"""The JSON Schemas (2020-12) of our files."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema


def json_schema(name: str) -> dict[str, Any]:
    """Load that of ``pose``, ``scene`` or ``symmetry`` files."""
    path = files("poseviewer.files").joinpath(f"{name}.schema.json")
    return json.loads(path.read_text(encoding="utf-8"))


def load_valid(path: Path, name: str) -> dict[str, Any]:
    """The values of a file of ours, which its schema allows."""
    data = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.validate(data, json_schema(name))
    return data
