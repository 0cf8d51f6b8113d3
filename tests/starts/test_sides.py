"""A model seen from a side is whole, and stands as it would rest."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.starts.sides import FILLED, SIDES, look_from, upright_axes
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from tests.geometry.test_charts import make_keypoints
from tests.geometry.test_placing import CAMERAS, MESHES
from tests.meshes import make_box


def make_car() -> VehicleKeypoints:
    """Wheels about the origin of a car that looks along +x, its left at +y, z upwards."""
    sides = [
        SideKeypoints(*np.array([[-1.3, y, 0.0], [1.3, y, 0.0], [0.0, np.sign(y), 0.0]]))
        for y in (0.8, -0.8)
    ]
    return VehicleKeypoints(*sides)


CAR_MESH = make_box((4.2, 1.7, 1.4))


@CAMERAS
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("side", SIDES)
def test_every_side_shows_the_whole_model_in_the_photo(camera, name, side):
    mesh = MESHES[name]
    for keypoints in (None, make_keypoints(np.random.default_rng(0))):
        pose = look_from(side, mesh, keypoints, camera)
        seen = pose.project(mesh.vertices)
        assert np.all((seen >= 0.0) & (seen <= [camera.width, camera.height]))
        assert np.linalg.det(pose.camera_from_model.rotation) == pytest.approx(1.0)
        middle = np.array([camera.width, camera.height]) / 2.0
        low, high = seen.min(axis=0), seen.max(axis=0)
        assert (low + high) / 2.0 == pytest.approx(middle, abs=1.0)
        filled = (high - low) / [camera.width, camera.height]
        assert filled.max() == pytest.approx(FILLED, rel=0.01)


@CAMERAS
@pytest.mark.parametrize(
    ("side", "near", "axis", "low", "high"),
    [  # wheels: left rear, left front, right rear, right front
        ("front", (1, 3), 0, 3, 1),  # face to face, its left is on our right
        ("back", (0, 2), 0, 0, 2),
        ("left", (0, 1), 0, 1, 0),  # it drives to the left of the photo
        ("right", (2, 3), 0, 2, 3),
        ("three-quarter", (1,), 0, 1, 0),
        ("top", (), 1, 1, 0),  # its front at the upper edge
    ],
)
def test_sides_of_a_vehicle_are_those_of_its_wheels(camera, side, near, axis, low, high):
    car = make_car()
    wheels = [getattr(s, w) for s in (car.left, car.right) for w in ("rear_wheel", "front_wheel")]
    pose = look_from(side, CAR_MESH, car, camera)
    depths = pose.camera_from_model.apply(wheels)[:, 2]
    assert set(np.argsort(depths)[: len(near)]) == set(near)
    at = pose.project(wheels)
    assert at[low, axis] < at[high, axis]


def test_a_model_stands_on_the_face_that_it_would_rest_on():
    """Wheels, the format, resting: the same car turned so that another axis is upwards."""
    for up, turn in (("z", np.eye(3)), ("y", np.eye(3)[[1, 2, 0]]), ("-x", np.eye(3)[[2, 0, 1]])):
        box = make_box((4.2, 1.7, 1.4))
        chocks = np.sign(box.vertices[:, 2:]) < 0.0  # wider below than above
        shape = box.vertices * np.where(chocks, 1.0, [0.6, 0.6, 1.0])
        sign = -1.0 if up == "-x" else 1.0
        mesh = replace(box, vertices=sign * shape @ turn)
        expected = sign * np.array([0.0, 0.0, 1.0]) @ turn
        np.testing.assert_allclose(upright_axes(mesh, None)[2], expected)
    assert upright_axes(replace(CAR_MESH, y_up=True), None)[2] == pytest.approx([0, 1, 0])
    axes = np.array(upright_axes(CAR_MESH, make_car()))
    np.testing.assert_allclose(axes, [[0, -1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)
