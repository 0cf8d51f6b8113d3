"""Points of the picture on a model tell its motion, and what they cannot tell they leave."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.evaluation.synthetic import Lighting, photograph
from poseviewer.fit.point_motion import Grey, follow_points, grey_of
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import PlacedModel
from tests.fit.test_probing import CAN, TRUTH
from tests.renderers import require_opengl


def moved(degrees: float, shift: tuple[float, float, float]) -> Pose:
    """The can turned about its own axis, and moved."""
    turn = RigidTransform.from_rotation_vector([0.0, 0.0, np.radians(degrees)], np.zeros(3))
    place = TRUTH.camera_from_model @ turn
    return replace(
        TRUTH, camera_from_model=RigidTransform(place.rotation, place.translation + shift)
    )


def photo_of(pose: Pose, seed: int = 3) -> Photo:
    require_opengl()
    light = Lighting(np.full(3, 0.9), np.zeros((0, 3)), np.zeros((0, 3)))
    pixels = photograph(CAN, pose, light, (0.45, 0.5, 0.4), blur_px=0.7, noise=2.0, seed=seed)
    return Photo(pixels, f"{seed}.png", f"{seed:064d}")


def photo_at(pose: Pose, seed: int = 3) -> Grey:
    return grey_of(photo_of(pose, seed))


@pytest.mark.parametrize(
    ("degrees", "shift", "percent"),
    [(2.0, (0.02, 0.0, 0.0), 0.5), (12.0, (0.3, 0.1, 0.15), 2.0)],
    ids=["small", "large"],
)
def test_printed_things_are_followed_and_the_deviation_is_stated(degrees, shift, percent):
    truth = moved(degrees, shift)
    told = follow_points(photo_at(TRUTH), photo_at(truth, seed=4), PlacedModel(CAN, TRUTH))
    assert told is not None
    away = pose_error(CAN, told.pose, truth)
    assert away.percent < percent
    assert away.reprojection_px < 4.0 * told.px


def test_what_has_too_few_points_or_other_ones_tells_nothing():
    before, after = photo_at(TRUTH), photo_at(moved(2.0, (0.02, 0.0, 0.0)), seed=4)
    here = PlacedModel(CAN, TRUTH)
    noise = np.random.default_rng(0).integers(0, 255, before.shape).astype(np.uint8)
    assert follow_points(before, noise, here) is None  # a cut
    assert follow_points(before, after, here, np.ones((60, 80), bool)) is None  # all hidden
    assert follow_points(np.full_like(before, 90), after, here) is None
    assert follow_points(before, after[:100], here) is None
    beside = RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.2]))
    assert (
        follow_points(noise, noise, PlacedModel(CAN, replace(TRUTH, camera_from_model=beside)))
        is None
    )
    parallel = Parallel(60.0, 160.0, 120.0, 320, 240)
    assert follow_points(before, after, PlacedModel(CAN, replace(TRUTH, camera=parallel))) is None


def test_a_single_corner_tells_nothing():
    before, after = (np.full((240, 320), 90, np.uint8) for _ in range(2))
    column, row = (round(float(at)) for at in TRUTH.project(CAN.centre))
    before[row - 4 : row, column - 4 : column] = after[
        row - 3 : row + 1, column - 2 : column + 2
    ] = 220
    assert follow_points(before, after, PlacedModel(CAN, TRUTH)) is None


def test_a_still_background_behind_a_wrong_pose_holds_the_model_where_it_is():
    """What points on the background tell is their own motion, and how exactly."""
    background = np.random.default_rng(2).integers(0, 255, (60, 80)).astype(np.uint8)
    still = np.kron(background, np.ones((4, 4), np.uint8))
    told = follow_points(still, still, PlacedModel(CAN, TRUTH))
    assert told is not None
    assert pose_error(CAN, told.pose, TRUTH).percent < 0.1


def test_points_on_something_in_front_do_not_move_the_model():
    """A board with another picture stands still before half of the can, which moves."""
    truth = moved(4.0, (0.06, 0.0, 0.0))
    before, after = photo_at(TRUTH).copy(), photo_at(truth, seed=4).copy()
    board = np.random.default_rng(1).integers(0, 255, (12, 16)).astype(np.uint8)
    board = np.kron(board, np.ones((10, 10), np.uint8))[:, :70]
    before[60:180, 90:160] = after[60:180, 90:160] = board
    hidden = np.zeros(before.shape, bool)
    hidden[60:180, 90:160] = True
    told = follow_points(before, after, PlacedModel(CAN, TRUTH), hidden)
    assert told is not None
    assert pose_error(CAN, told.pose, truth).percent < 1.0
