"""A free principal point, as that of a cropped photo."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.api import load
from poseviewer.errors import SettingsError
from poseviewer.fit.problem import choose_chart
from poseviewer.fit.progress import SearchProgress
from poseviewer.fit.search import Search
from poseviewer.geometry.camera import Parallel, offset_principal, principal_offset
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene
from tests.fit.test_chart_choice import CAR, pose_turned
from tests.fit.test_views import make_scene
from tests.view_sets import CAMERA, MESH, TRUTH, write_views

FREE = FitSettings(free_principal_point=True)
NAMES = ("principal_x", "principal_y")


def find_with_wrong_cameras() -> tuple[SearchProgress, Scene, float]:
    """End of a search in photos of wrong cameras, its scene and its largest error in them, px."""
    scene, renderer = make_scene(), SoftwareRenderer(MESH)
    wrong = offset_principal(CAMERA, -0.1, 0.05), offset_principal(CAMERA, 0.05, 0.0)
    pairs = zip(scene.views, (wrong[0], *wrong), strict=True)
    scene = replace(scene, views=tuple(replace(view, camera=camera) for view, camera in pairs))
    search = Search(scene.with_object(0, settings=FREE), {0: renderer}, threads=2)
    *_, end = search.run()
    poses = (search.scene.pose(0, number) for number in range(3))
    errors = [pose_error(MESH, *pair) for pair in zip(poses, TRUTH, strict=True)]
    return end, search.scene, max(error.reprojection_px for error in errors)


@pytest.mark.slow
@pytest.mark.long
def test_several_photos_tell_the_principal_points_of_their_cameras() -> None:
    end, scene, px = find_with_wrong_cameras()
    chart, joint = end.problem.chart, end.progress.covariance
    assert chart.names[-4:] == (*NAMES, "principal_x_2", "principal_y_2")
    assert px < 1.0
    assert scene.views[0].camera == scene.views[1].camera != scene.views[2].camera
    off = [principal_offset(CAMERA, view.camera) for view in scene.views]
    assert np.abs(off).max() < 0.03  # a tenth at the start
    assert joint is not None
    assert joint.names[6:] == NAMES
    assert np.abs(off[0] * np.array([320, 240])).max() < 2 * joint.deviations["principal_px"]
    own = np.sqrt(np.diag(joint.in_chart(chart))[-4])
    assert 0.0 < 320 * own <= 1.001 * joint.deviations["principal_px"] < 40.0


@pytest.mark.slow
@pytest.mark.long
def test_a_scene_file_keeps_the_principal_point(tmp_path: Path) -> None:
    views, model, start = write_views(tmp_path)
    end = load(views, model, start, FREE).fit(evaluations=60)
    end.save(tmp_path / "found.scene.json")
    again: Any = load(tmp_path / "found.scene.json")
    found = [view.camera for view in end.views]
    assert [view.camera for view in again.views] == found != [CAMERA] * 3
    assert again.object.result.settings["free_principal_point"]


def test_what_cannot_tell_a_principal_point_is_refused() -> None:
    pose = pose_turned(20.0)
    parallel = replace(pose, camera=Parallel(40.0, 320.0, 240.0, 640, 480))
    of_one = "one photo of one object cannot tell"
    for keypoints, at, words in ((None, pose, of_one), (CAR, parallel, "no principal point")):
        with pytest.raises(SettingsError, match=words):
            choose_chart("auto", MESH, keypoints, at, free_principal_point=True)
    with pytest.raises(SettingsError, match=of_one):
        choose_chart("free-body", MESH, CAR, pose, free_principal_point=True)
    chart, _ = choose_chart("auto", MESH, CAR, pose, free_principal_point=True)
    assert chart.names[6:] == NAMES
