"""A model placed in a photo is seen whole, from the side asked for; surface points are visible."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.placing import (
    FILLED,
    SIDES,
    fit_into_rectangle,
    look_from,
    surface_hit,
    upright_axes,
)
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from tests.geometry.test_charts import make_keypoints
from tests.meshes import make_box, make_bumpy, make_soup

SEEDS = st.integers(0, 2**32 - 1)
CAMERAS = pytest.mark.parametrize(
    "camera",
    [
        Parallel(1.0, 250.0, 270.0, 640, 480),
        Perspective(700.0, 560.0, 250.0, 270.0, 640, 480),
        Perspective(350.0, 350.0, 150.0, 320.0, 300, 640),
    ],
    ids=["parallel", "pinhole", "wide and upright"],
)
MESHES = {"box": make_box((2.0, 1.0, 0.5)), "bumpy": make_bumpy(3), "soup": make_soup(1, 60)}
RENDERERS = {name: SoftwareRenderer(mesh) for name, mesh in MESHES.items()}


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


@CAMERAS
def test_a_model_is_framed_by_a_rectangle(camera):
    mesh, rectangle = MESHES["bumpy"], (0.1 * camera.width, 0.2 * camera.height, 90.0, 60.0)
    start = look_from("three-quarter", mesh, None, camera)
    pose = fit_into_rectangle(start, mesh, rectangle)
    seen = pose.project(mesh.vertices)
    low, high = seen.min(axis=0), seen.max(axis=0)
    assert np.min(np.array(rectangle[2:]) / (high - low)) == pytest.approx(1.0, rel=0.01)
    middle = np.array(rectangle[:2]) + np.array(rectangle[2:]) / 2.0
    assert (low + high) / 2.0 == pytest.approx(middle, abs=0.5)
    np.testing.assert_allclose(
        pose.camera_from_model.rotation, start.camera_from_model.rotation, atol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("name", MESHES)
@given(seed=SEEDS)
@settings(deadline=None, max_examples=20)
def test_a_surface_point_is_what_the_renderer_sees_there(name, parallel, seed):
    random = np.random.default_rng(seed)
    mesh, renderer = MESHES[name], RENDERERS[name]
    camera = Perspective(120.0, 100.0, 50.0, 40.0, 96, 72)
    if parallel:
        camera = Parallel(15.0, 50.0, 40.0, 96, 72)
    place = [*random.uniform(-0.5, 0.5, 2), random.uniform(9.0, 14.0)]
    pose = Pose(camera, RigidTransform.from_rotation_vector(random.normal(size=3) * 2.0, place))
    image = renderer.render(pose)
    same = []
    for row, column in zip(random.integers(0, 72, 40), random.integers(0, 96, 40), strict=True):
        pixel = np.array([column, row]) + 0.5
        hit = surface_hit(mesh, pose, pixel)
        assert (hit is not None) == image.mask[row, column]
        if hit is not None:
            assert pose.project(hit[1]) == pytest.approx(pixel, abs=1e-6)
            same.append(hit[0] == image.face_ids[row, column])
    assert sum(same) >= len(same) - 1  # an edge that two faces share
