"""Point pairs give back the pose that they were made with, under both projections."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.errors import QuickStartError
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from poseviewer.starts.point_pairs import focal_from_pairs, likeliest, poses_from_pairs
from tests.meshes import make_box

PINHOLE = Perspective(900.0, 850.0, 300.0, 260.0, 640, 480)
FLAT = Parallel(40.0, 300.0, 260.0, 640, 480)
SEEDS = pytest.mark.parametrize("seed", range(3))


def make_pose(camera, seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    turn, place = rng.normal(size=3), [*rng.uniform(-1, 1, 2), rng.uniform(9, 16)]
    return Pose(camera, RigidTransform.from_rotation_vector(turn, place))


def make_points(count: int, seed: int, flat: bool = False) -> np.ndarray:
    """Far from the origin, in a unit of its own: neither may matter."""
    points = np.random.default_rng(100 + seed).uniform(-2.0, 2.0, (count, 3))
    return points * [1.0, 1.0, 0.0] if flat else points


def rotation_off(one: Pose, other: Pose) -> float:
    return rotation_angle(one.camera_from_model.rotation, other.camera_from_model.rotation)


@SEEDS
@pytest.mark.parametrize("count", [4, 6, 20])
@pytest.mark.parametrize(("camera", "unit"), [(PINHOLE, 1.0), (PINHOLE, 1000.0), (FLAT, 1.0)])
def test_a_pose_comes_back(seed: int, count: int, camera, unit: float):
    """Of a parallel projection but for its depth, and with its scale."""
    pose, points = make_pose(camera, seed), make_points(count, seed)
    asked = replace(FLAT, scale=1.0) if camera is FLAT else camera
    far = points * unit + 50.0 * unit
    best = poses_from_pairs(far, pose.project(points), asked)[0]
    assert best.rms_px < 1e-3
    assert rotation_off(best.pose, pose) < 1e-4
    np.testing.assert_allclose(best.pose.project(far), pose.project(points), atol=1e-3)
    if isinstance(best.pose.camera, Parallel):
        assert best.pose.camera.scale == pytest.approx(FLAT.scale, rel=1e-7)


@SEEDS
@pytest.mark.parametrize("count", [3, 7])
def test_points_in_a_plane_have_both_mirror_images(seed: int, count: int):
    pose, points = make_pose(FLAT, seed), make_points(count, seed, flat=True)
    fits = poses_from_pairs(points, pose.project(points), FLAT)
    assert len(fits) == 2
    assert max(fit.rms_px for fit in fits) < 1e-6
    assert min(rotation_off(fit.pose, pose) for fit in fits) < 1e-6


@SEEDS
def test_six_pairs_give_the_focal_length(seed: int):
    near = RigidTransform.from_rotation_vector(make_points(1, seed)[0], [0.2, 0.1, 7.0])
    pose, points = Pose(PINHOLE, near), make_points(6, seed)
    guess = replace(PINHOLE, fx=500.0, fy=500.0 * 850.0 / 900.0)
    fit, doubt = focal_from_pairs(points, pose.project(points), guess)
    camera = fit.pose.camera
    assert isinstance(camera, Perspective)
    assert camera.fx == pytest.approx(900.0, rel=1e-3)
    assert camera.fy / camera.fx == pytest.approx(850.0 / 900.0)
    assert doubt < 0.3


def test_pairs_from_afar_leave_the_focal_length_open():
    far = Perspective(90_000.0, 90_000.0, 320.0, 240.0, 640, 480)
    place = RigidTransform.from_rotation_vector([0.3, 0.5, 0.1], [0.0, 0.0, 1500.0])
    points = make_points(8, 1)
    with pytest.raises(QuickStartError, match="leave the focal length open"):
        focal_from_pairs(points, Pose(far, place).project(points), far)


def test_too_few_pairs_are_counted():
    pose, points = make_pose(PINHOLE, 0), make_points(5, 0)
    pixels = pose.project(points)
    with pytest.raises(QuickStartError, match=r"3 point pairs.* at least 4: add 1"):
        poses_from_pairs(points[:3], pixels[:3], PINHOLE)
    with pytest.raises(QuickStartError, match=r"2 point pairs.* at least 3: add 1"):
        poses_from_pairs(points[[0, 1, 1]], pixels[[0, 1, 1]], FLAT)
    with pytest.raises(QuickStartError, match="focal length needs at least 6: add 1"):
        focal_from_pairs(points, pixels, PINHOLE)


@pytest.mark.parametrize("camera", [PINHOLE, FLAT])
def test_pairs_on_a_line_are_refused(camera):
    points = np.outer(np.arange(5.0), [1.0, 0.5, -0.2])
    pixels = make_pose(camera, 0).project(make_points(5, 0))
    apart, in_line = make_points(5, 0), np.outer(np.arange(5.0), [30.0, 10.0])
    for given, seen, words in ((points, pixels, "on a line in the model"),
                               (apart, in_line, "on a line in the photo"),
                               (apart, np.full((5, 2), np.nan), "not finite")):  # fmt: skip
        with pytest.raises(QuickStartError, match=words):
            poses_from_pairs(given, seen, camera)


def test_of_mirror_images_the_one_whose_points_can_be_seen_is_taken():
    mesh = make_box((2.0, 2.0, 2.0))
    forward = np.array([-0.98, -0.14, -0.14]) / np.linalg.norm([0.98, 0.14, 0.14])
    across = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)
    rotation = np.array([across, np.cross(forward, across), forward], float)
    turn = RigidTransform(np.asarray(rotation, np.float64), np.array([0.0, 0.0, 9.0]))
    pose = Pose(FLAT, turn)
    # One point on each of the three faces that are seen: in the mirror image one is hidden.
    points = np.eye(3) + 0.1 * (1.0 - np.eye(3))
    fits = poses_from_pairs(points, pose.project(points), FLAT)
    assert len(fits) == 2
    for order in (fits, fits[::-1]):
        assert rotation_off(likeliest(order, points, mesh).pose, pose) < 1e-6
        assert likeliest(order[:1], points, mesh) is order[0]
