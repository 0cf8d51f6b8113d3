from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from poseviewer.errors import MeshFileError
from poseviewer.files.keypoints import keypoints_path, load_keypoints
from poseviewer.files.mesh.load import load_mesh
from tests.writing import edit, write


def good() -> dict[str, Any]:
    sides = {
        name: {"rear_wheel": [-1.3, sign * 0.8, 0.3], "front_wheel": [1.4, sign * 0.8, 0.3],
               "axle": [0.0, sign, 0.0]}
        for name, sign in (("left", 1.0), ("right", -1.0))
    }  # fmt: skip
    return {"format": "poseviewer-keypoints", "version": 1, "unit": "m", **sides}


@pytest.fixture
def model(tmp_path: Path) -> Path:
    trimesh.creation.box().export(tmp_path / "car.glb")
    return tmp_path / "car.glb"


def test_key_points_stand_beside_the_model(model: Path) -> None:
    write(model.parent / "car.keypoints.json", good())
    assert keypoints_path(model) == model.parent / "car.keypoints.json"
    keypoints = load_keypoints(model, load_mesh(model))
    np.testing.assert_array_equal(keypoints.left.front_wheel, [1.4, 0.8, 0.3])
    np.testing.assert_array_equal(keypoints.right.axle, [0.0, -1.0, 0.0])


def test_without_a_file_and_without_wheels_there_are_none(model: Path) -> None:
    assert load_keypoints(model, load_mesh(model)) is None


@pytest.mark.parametrize("change", [
    lambda data: data.pop("left"),
    lambda data: data["right"].update(axle=[0, 1]),
    lambda data: data["right"].update(axle=[1, 0, 0]),
    lambda data: data["left"].update(front_wheel=data["left"]["rear_wheel"]),
    lambda data: data.update(format="poseviewer-pose"),
    lambda data: data.update(unit="mm"),
])  # fmt: skip
def test_wrong_key_points_are_refused(model: Path, change: Callable[[dict], object]) -> None:
    edit(write(model.parent / "car.keypoints.json", good()), change)
    with pytest.raises(MeshFileError, match=r"^car\.keypoints\.json: [^\n]*\.$"):
        load_keypoints(model, load_mesh(model))
