"""Cameras of glTF as Blender and match movers write them."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.scene.types import Scene

ANGLE = 2.0 * math.atan(160.0 / 400.0)
"""Field of view of a height of 320 px by 400 px of focal length."""


def load(folder: Path, size: tuple[int, int], **more: Any) -> Scene:
    lens = {"yfov": ANGLE, "aspectRatio": 0.75, "znear": 0.1}
    nodes = [{"name": "rig", "children": [1]}, {"name": "camera", "camera": 0}]
    camera = {"type": "perspective", "perspective": lens}
    data = {"asset": {"version": "2.0"}, "nodes": nodes, "cameras": [camera], **more}
    (folder / "camera.gltf").write_text(json.dumps(data))
    return FORMATS["gltf"].read(folder / "camera.gltf", ConvertOptions(photo_size=size))


@pytest.mark.parametrize(("size", "focal"), [((240, 320), 400.0), ((480, 640), 800.0)])
def test_a_camera_of_the_photos_ratio_is_taken_as_it_is(tmp_path, size, focal):
    scene = load(tmp_path, size)
    camera: Any = scene.views[0].camera
    assert (camera.fx, camera.fy) == (pytest.approx(focal), pytest.approx(focal))
    assert scene.notes == ()


def test_another_aspect_ratio_is_said_and_the_height_kept(tmp_path):
    scene = load(tmp_path, (320, 240))
    camera: Any = scene.views[0].camera
    assert (camera.fx, camera.fy) == (pytest.approx(300.0), pytest.approx(300.0))
    assert "has an aspect ratio of 0.75, the photo's is 1.33" in scene.notes[0]


@pytest.mark.parametrize(("node", "is_said"), [(0, True), (1, True), (None, False)])
def test_a_camera_that_moves_is_said_to_be_at_rest(tmp_path, node, is_said):
    target = {"node": node, "path": "translation"}
    animation = {"channels": [{"sampler": 0, "target": target}], "samplers": []}
    scene = load(tmp_path, (240, 320), animations=[animation])
    assert scene.notes == ("camera.gltf: its camera is animated; it is taken at rest.",) * is_said
