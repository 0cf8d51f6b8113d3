"""One model in several views, by the same numbers."""

from collections.abc import Sequence

import numpy as np
import pytest

from poseviewer.geometry.camera import Camera
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.geometry.world_pose import triangulate_scale
from poseviewer.scene.types import View
from tests.view_sets import CAMERA, CAMERAS_FROM_SET, MESH, START, TRUTH, focal_length, make_views

REFERENCE = FreeBodyChart.near(MESH, TRUTH[0])


def chart(index: int, free_size: bool = False, focals: int = 0, principals: int = 0) -> ViewChart:
    turn = CAMERAS_FROM_SET[index] @ CAMERAS_FROM_SET[0].inverse()
    of_cameras = focals, min(index, 1), principals
    return ViewChart(REFERENCE, CAMERA, turn, free_size, 1.0, *of_cameras)


@pytest.mark.parametrize(
    ("free_size", "focals", "principals"),
    [(False, 0, 0), (True, 0, 0), (True, 2, 0), (True, 2, 2), (False, 0, 2)],
)
@pytest.mark.parametrize("index", range(3))
def test_numbers_of_a_pose_give_the_pose_back(index, free_size, focals, principals):
    own = chart(index, free_size, focals, principals)
    numbers = np.zeros(len(own.names))
    numbers[:6] = [0.1, -0.2, 0.05, 0.1, -0.1, 0.05]
    if principals:
        numbers[own.principal_index :][:2] = 0.1, -0.05
        assert own.to_pose(numbers).camera.cx == pytest.approx(CAMERA.cx + 32.0)
    if focals:
        numbers[6 + own.focal_index] = -0.1
    np.testing.assert_allclose(own.from_pose(own.to_pose(numbers)), numbers, atol=1e-12)


def test_a_focal_length_changes_the_photos_of_its_camera_and_no_place():
    numbers = np.array([*np.zeros(6), 0.0, np.log(1.1)])
    for index, zoom in ((0, 1.0), (1, 1.1), (2, 1.1)):
        was, now = (chart(index, focals=2).to_pose(at) for at in (np.zeros(8), numbers))
        np.testing.assert_array_equal(
            now.camera_from_model.translation, was.camera_from_model.translation
        )
        assert focal_length(now.camera) == pytest.approx(zoom * focal_length(was.camera))


@pytest.mark.parametrize("index", range(3))
def test_a_larger_model_stays_where_it_is_and_grows_in_every_view(index):
    own = chart(index, True)
    numbers = np.append(np.zeros(6), np.log(1.25))
    was, now = own.to_pose(np.zeros(7)), own.to_pose(numbers)
    np.testing.assert_allclose(now.project(MESH.centre), was.project(MESH.centre), atol=1e-9)
    depths = [pose.camera_from_model.apply(MESH.centre)[2] for pose in (was, now)]
    assert depths[0] == pytest.approx(1.25 * depths[1])
    assert own.distance_factor(numbers) == pytest.approx(1.0 / 1.25)


def test_behind_the_camera_of_a_view_there_is_no_pose():
    turn = RigidTransform(np.eye(3), np.array([0.0, 0.0, -20.0]))
    with pytest.raises(OutsideChartError):
        ViewChart(REFERENCE, CAMERA, turn).to_pose(np.zeros(6))


def cameras(views: Sequence[View]) -> list[tuple[Camera, RigidTransform]]:
    return [(view.camera, view.camera_from_world) for view in views]


def test_lines_of_sight_tell_the_scale_about():
    at = START.camera_from_model.apply(MESH.centre)
    found = triangulate_scale(cameras(make_views(unit=2.5).views), 0, at / at[2], float(at[2]))
    assert found == pytest.approx(2.5, rel=0.15)


def test_cameras_that_look_the_same_way_tell_no_scale():
    same = cameras(make_views().views[:1])
    assert triangulate_scale(same * 2, 0, np.array([0.0, 0.0, 1.0]), 1.0) is None
