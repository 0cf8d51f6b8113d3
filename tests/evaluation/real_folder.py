"""The tests' scene as a folder of photos with known poses."""

import json
from pathlib import Path

from tests.scene import Scene


def write_real_folder(scene: Scene) -> Path:
    """Two cases, each with two starts at 5 degrees, beside the scene's files."""
    pose, start = (json.loads(path.read_text()) for path in (scene.truth, scene.start))
    case = {
        "set": "scene",
        "photo": scene.photo.name,
        "mesh": scene.model.name,
        "camera": pose["camera"],
        "camera_from_model": pose["camera_from_model"],
        "accuracy": "1-2 px",
        "image_diagonal_px": 100.0,
    }
    cases = [{"id": name, **case} for name in ("ball-a", "ball-b")]
    starts = [
        {"case": case["id"], "degrees": 5, "draw": draw,
         "camera_from_model": start["camera_from_model"]}
        for case in cases for draw in range(2)
    ]  # fmt: skip
    (scene.photo.parent / "cases.json").write_text(json.dumps({"cases": cases}))
    (scene.photo.parent / "starts.json").write_text(json.dumps(starts))
    return scene.photo.parent
