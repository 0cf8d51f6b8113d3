"""Documents, their charts, and history that goes back to the very same objects."""

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.camera_change import with_camera
from poseviewer.app.state.document import MOST_OPENED, History
from poseviewer.app.state.dragging import radius_in_photo
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.placing import look_from
from poseviewer.vehicle.chart import VehicleChart
from tests.app.state.documents import (
    BUMPY,
    CAR,
    PARALLEL,
    PERSPECTIVE,
    after,
    assert_same_pose,
    make_document,
    make_photo,
    make_session,
    moved_document,
)
from tests.meshes import make_box

CAMERAS = pytest.mark.parametrize("camera", [PARALLEL, PERSPECTIVE], ids=["parallel", "pinhole"])


@pytest.mark.parametrize("other", ["photo", "model", "both"])
def test_history_keeps_few_photos_and_models(other):
    photo, history = make_photo(), History()
    documents = []
    for i in range(MOST_OPENED + 3):
        photo_now = photo if other == "model" else make_photo(i)
        mesh = BUMPY if other == "photo" else make_box((1.0, 1.0, 1.0 + i))
        opened = make_document(photo=photo_now, mesh=mesh)
        documents += [opened, moved_document(opened, 0.1)]
    for document in documents:
        history = history.with_step(document)
    assert history.past == tuple(documents[-2 * MOST_OPENED :])


@CAMERAS
def test_another_camera_keeps_the_centres_pixel_and_size(camera):
    pose = make_document(camera).pose
    for new in (
        Perspective(500.0, 400.0, 70.0, 66.0, 160, 120),
        Parallel(1.0, 70.0, 66.0, 160, 120),
    ):
        seen = with_camera(pose, new, BUMPY.centre)
        assert type(seen.camera) is type(new)
        assert seen.project(BUMPY.centre) == pytest.approx(pose.project(BUMPY.centre), abs=1e-9)
        assert radius_in_photo(seen, BUMPY) == pytest.approx(radius_in_photo(pose, BUMPY))
        assert np.array_equal(seen.camera_from_model.rotation, pose.camera_from_model.rotation)


def test_there_and_back_between_projections_is_the_same_pose():
    session = make_session(PERSPECTIVE)
    flat = after(session, c.set_projection("parallel"))
    assert isinstance(flat.document.pose.camera, Parallel)
    back = after(flat, c.set_projection("perspective"))
    assert_same_pose(back.document.pose, session.document.pose)
    assert after(session, c.set_projection("perspective")) is session
    assert after(flat, c.set_projection("parallel")) is flat


@pytest.mark.parametrize("free_focal", [False, True])
@pytest.mark.parametrize(
    "camera",
    [
        PARALLEL,
        Parallel(31.0, 70.0, 66.0, 160, 120),
        Perspective(500.0, 410.0, 70.0, 66.0, 160, 120),
    ],
    ids=["parallel", "shifted parallel", "longer pinhole"],
)
@pytest.mark.parametrize("start", [PARALLEL, PERSPECTIVE], ids=["from parallel", "from pinhole"])
def test_the_chart_gives_the_pose_back_whatever_the_camera_has_become(start, camera, free_focal):
    document = make_document(start, settings=FitSettings(free_focal=free_focal))
    pose = with_camera(moved_document(document, 0.3).pose, camera, BUMPY.centre)
    document = document.at_pose(pose)
    again = document.chart.to_pose(document.parameters)
    assert type(again.camera) is type(camera)
    assert again.project(BUMPY.vertices) == pytest.approx(pose.project(BUMPY.vertices), abs=1e-7)
    if isinstance(camera, Perspective) and isinstance(again.camera, Perspective):
        assert again.camera.fx == pytest.approx(camera.fx)
        assert again.camera.fy == pytest.approx(camera.fy)
        assert again.camera.cx == camera.cx
    # Not all zero: they are told from the start, not from the pose itself.
    assert abs(document.parameters[3]) > 0.05


@CAMERAS
def test_a_vehicle_seen_head_on_has_the_other_chart(camera):
    document = make_document(camera, vehicle=True)
    assert isinstance(document.chart, VehicleChart)
    front = look_from("front", CAR, document.model.keypoints, camera)
    document = document.at_pose(front)
    assert isinstance(document.chart, FreeBodyChart)
    again = document.chart.to_pose(document.parameters)
    assert again.project(CAR.vertices) == pytest.approx(front.project(CAR.vertices), abs=1e-6)
