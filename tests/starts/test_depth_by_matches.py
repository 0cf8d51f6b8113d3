"""The depth of a printed wall is told by features, though the cameras look past one another."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.image import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.types import View
from poseviewer.starts.depth_by_matches import depth_by_matches

CAMERA = Perspective(500.0, 500.0, 160.0, 120.0, 320, 240)
DEPTH = 8.0
BOX = Rectangle(80.0, 60.0, 160.0, 120.0)


def make_views(blur: float) -> list[View]:
    """Photos of a wall at a depth, by cameras that are shifted and turned outwards."""
    random = np.random.default_rng(0)
    wall = cv2.GaussianBlur(random.uniform(0.0, 255.0, (900, 1200)), (0, 0), blur)
    wall = 255.0 * (wall - wall.min()) / np.ptp(wall)
    views = []
    for number in range(4):
        turn = RigidTransform.from_rotation_vector([0.0, -0.04 * number, 0.0], np.zeros(3))
        camera_from_world = replace(turn, translation=np.array([-0.35 * number, 0.0, 0.0]))
        at = np.array([[80.0, 0.0, 600.0], [0.0, 80.0, 450.0], [0.0, 0.0, 1.0]])  # px of the wall
        plane = np.column_stack(
            [*camera_from_world.rotation.T[:2], camera_from_world.apply([0.0, 0.0, DEPTH])]
        )
        matrix = np.array(
            [[CAMERA.fx, 0.0, CAMERA.cx], [0.0, CAMERA.fy, CAMERA.cy], [0.0, 0.0, 1.0]]
        )
        half = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]])
        photo_from_wall = half @ matrix @ plane @ np.linalg.inv(at)
        pixels = cv2.warpPerspective(wall, photo_from_wall, (CAMERA.width, CAMERA.height))
        grey = np.asarray(pixels, np.uint8)[..., None].repeat(3, axis=2)
        name = f"{number}.png"
        file = PhotoFile.of(Photo(grey, name, f"{number}" * 64))
        views.append(View(file, CAMERA, camera_from_world))
    return views


def test_the_depth_of_a_box_is_told_by_features():
    views = make_views(2.0)
    assert depth_by_matches(views, 0, BOX) == pytest.approx(DEPTH, rel=0.01)
    assert depth_by_matches(views, 2, BOX) == pytest.approx(DEPTH, rel=0.06)  # the wall is slanted


@pytest.mark.slow
@pytest.mark.long
def test_no_depth_is_told_without_print_or_parallax():
    assert depth_by_matches(make_views(200.0), 0, BOX) is None
    views = make_views(2.0)
    assert depth_by_matches([views[0]] * 3, 0, BOX) is None
