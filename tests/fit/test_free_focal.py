"""An unknown focal length: freed, it comes nearer to the true one, and the pose with it."""

from dataclasses import replace

import pytest

from poseviewer.api import load
from poseviewer.app.state.camera_change import with_camera
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.pose_error import pose_error


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.75, 4.0 / 3.0])
def test_on_the_demo_it_is_found_from_a_quarter_or_a_third_off(factor):
    case = demo_case()
    photo, model = load_photo(case.photo), load_model(case.model)
    start, truth = (
        load_pose(path, photo.width, photo.height).pose for path in (case.start, case.truth)
    )
    assert isinstance(start.camera, Perspective)
    assert isinstance(truth.camera, Perspective)
    focal = factor * truth.camera.fx
    begin = with_camera(start, replace(start.camera, fx=focal, fy=focal), model.mesh.centre)
    end = load(case.photo, model, begin, free_focal=True).fit(threads=2)
    assert isinstance(end.pose.camera, Perspective)
    assert end.pose.camera.fx == pytest.approx(truth.camera.fx, rel=0.06)
    assert pose_error(model.mesh, end.pose, truth).reprojection_px < 2.0
