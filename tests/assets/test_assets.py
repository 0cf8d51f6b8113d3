"""The bundled demo's files belong together, byte for byte."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from poseviewer.files.photo import load_photo

ASSETS = Path(__file__).resolve().parents[2] / "assets"
POSES = sorted(path.name for path in ASSETS.glob("demo_*pose_*.json"))


def load_json(name: str) -> dict:
    return json.loads((ASSETS / name).read_text())


@pytest.mark.parametrize("name", POSES)
def test_pose_files_name_photo_and_model_by_their_bytes(name: str):
    pose = load_json(name)
    for key in ("photo", "model"):
        data = (ASSETS / pose[key]["file"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == pose[key]["sha256"]
    photo = load_photo(ASSETS / pose["photo"]["file"])
    assert (photo.width, photo.height) == (pose["photo"]["width"], pose["photo"]["height"])
    assert (pose["camera"]["cx"], pose["camera"]["cy"]) == (
        (photo.width - 1) / 2, (photo.height - 1) / 2)  # fmt: skip


def test_keypoints_are_the_middles_of_the_rims():
    points = load_json("demo_car.keypoints.json")
    car = trimesh.load_scene(ASSETS / "demo_car.glb", process=False)
    for side, letter in (("left", "L"), ("right", "R")):
        for key, end in (("rear_wheel", "R"), ("front_wheel", "F")):
            point = np.array(points[side][key])
            rim = car.geometry[f"wheel {end}{letter} rim"].bounds
            assert np.abs(rim.mean(axis=0) - point)[[0, 2]].max() < 0.004
            assert abs(np.abs(rim[:, 1]).max() - abs(point[1])) < 0.004
