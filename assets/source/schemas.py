"""The JSON Schemas (2020-12) of our files, from the structs that read them.

Run from the repository's root: ``python -m assets.source.schemas`` writes them.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import SceneRecord
from poseviewer.files.structs import PROJECTIONS
from poseviewer.files.symmetry import SymmetryFile

FOLDER = Path(__file__).parents[2] / "poseviewer" / "files"
KINDS: dict[str, tuple[Any, int, list[str]]] = {
    "pose": (Annotated[PoseRecord, Meta(extra_json_schema=PROJECTIONS)], 1, []),
    "scene": (SceneRecord, 2, ["format", "version"]),
    "symmetry": (SymmetryFile, 1, []),
}
"""The struct of each kind of file, its version, and what it cannot go without besides."""


def schema(kind: str) -> str:
    """The schema of a kind of files, as it is in the package."""
    struct, version, needed = KINDS[kind]
    made = msgspec.json.schema(struct)
    whole = made["$defs"][made["$ref"].rpartition("/")[2]]
    whole["required"] = [*needed, *whole["required"]]
    whole["properties"].pop("warnings", None)  # not written
    said = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"poseviewer-{kind}-{version}",
        "title": f"poseviewer {kind} file, version {version}",
    }
    return json.dumps(_plain({**said, **made}), indent=1, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    """Without what says nothing, and with descriptions of one line."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if not isinstance(value, dict):
        return value
    kept = {k: v for k, v in value.items() if k != "default" and (k, v) != ("required", [])}
    made = {key: _plain(item) for key, item in kept.items()}
    if isinstance(made.get("description"), str):
        made["description"] = " ".join(made["description"].split())
    return made


if __name__ == "__main__":
    for name in KINDS:
        (FOLDER / f"{name}.schema.json").write_text(schema(name), encoding="utf-8")
