"""Fits end at the truth: on photos drawn by OpenGL, on the bundled path-traced one, and cropped."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.api import load, make_registration
from poseviewer.app.state.document import with_camera
from poseviewer.evaluation.photos import demo_photo
from poseviewer.evaluation.synthetic import photograph, random_lighting
from poseviewer.files.demo import demo_case
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import load_pose
from poseviewer.geometry.camera import Perspective, Pose, principal_offset
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.scene.settings import FitSettings
from poseviewer.vehicle.chart import VehicleChart
from tests.opened import by, scene_of
from tests.renderers import require_opengl
from tests.view_sets import focal_length

pytestmark = pytest.mark.slow

CAMERA = Perspective.from_field_of_view(40.0, 640, 480)
THETA = np.array([0.7, 0.62, -0.42, 0.06, 0.45, 0.2])
"""A car seen from its front left, from somewhat above."""
CUT = 160
"""Columns of the demo's 960 that are cut off: its middle is then a tenth of the width off."""
FREE = FitSettings(free_principal_point=True)
NAMES = ("principal_x", "principal_y")


def test_demo_car_is_found_from_8_per_cent_off():
    """A diffuse car on plain ground, in light that the fit does not know, with sensor noise."""
    require_opengl()
    model = demo_case().model
    mesh = load_mesh(model)
    keypoints = load_keypoints(model, mesh)
    chart = VehicleChart(keypoints.left, CAMERA, depth=10.0)
    truth, lighting = chart.to_pose(THETA), random_lighting(np.random.default_rng(1))
    photo = Photo(photograph(mesh, truth, lighting, noise=1.0, seed=1), "synthetic.png", "0" * 64)
    signs = np.random.default_rng(8).choice([-1.0, 1.0], 6)
    start = chart.to_pose(THETA * (1.0 + 0.08 * signs))
    found = make_registration(
        by(scene_of(photo, mesh, start, keypoints=keypoints), chart="vehicle")
    ).fit()
    assert pose_error(mesh, found.pose, truth).reprojection_px < 1.0


def test_the_bundled_photo_is_registered_by_the_papers_loss():
    files, truth = demo_case(), demo_photo("photo-perspective").truth
    found = load(files.photo, files.model, files.start, loss="paper").fit()
    before, after = (pose_error(found.mesh, one.pose, truth) for one in (found.start, found))
    assert before.percent > 4.0
    assert after.percent < 0.5


def test_the_focal_length_is_found_from_a_third_off():
    files, truth = demo_case(), demo_photo("photo-perspective").truth
    known, focal = load(files.photo, files.model, files.start), focal_length(truth.camera)
    off = replace(known.pose.camera, fx=4.0 / 3.0 * focal, fy=4.0 / 3.0 * focal)
    start = with_camera(known.pose, off, known.mesh.centre)
    end = load(files.photo, files.model, start, free_focal=True).fit(threads=2)
    assert focal_length(end.pose.camera) == pytest.approx(focal, rel=0.06)
    assert pose_error(end.mesh, end.pose, truth).reprojection_px < 2.0


def test_a_cropped_photo_of_a_car_tells_its_principal_point(tmp_path: Path) -> None:
    files, size = demo_case(), (960 - CUT, 720)
    photo = tmp_path / "cropped.png"
    save_image(photo, np.ascontiguousarray(load_photo(files.photo).pixels[:, CUT:]))
    whole = load(files.photo, files.model, files.start)
    truth, start = (
        Pose(pose.camera.crop(CUT, 0, size), pose.camera_from_model)
        for pose in (demo_photo("photo-perspective").truth, whole.pose)
    )
    middle = replace(start.camera, cx=400.0, cy=360.0)
    assert principal_offset(middle, truth.camera) == pytest.approx((-0.1, 0.0))
    start = with_camera(start, middle, whole.mesh.centre)
    known = load(photo, files.model, start).fit(threads=2)
    free = load(photo, files.model, start, FREE, free_focal=True).fit(threads=2)
    before, after = (pose_error(whole.mesh, end.pose, truth) for end in (known, free))
    assert after.percent < 0.5 * before.percent
    assert after.rotation_deg < before.rotation_deg
    off = np.subtract(principal_offset(middle, free.pose.camera), (-0.1, 0.0))
    assert np.linalg.norm(off) < np.linalg.norm(principal_offset(middle, truth.camera))
    assert free.covariance is not None
    assert free.covariance.deviations["principal_px"] > 800 * abs(off).max()
    assert "principal point ±" in free.covariance.words("m")
    assert known.covariance is not None
    assert known.covariance.deviations["sideways"] < free.covariance.deviations["sideways"]
    free.save(tmp_path / "pose.json")
    saved: Any = load_pose(tmp_path / "pose.json", *size)
    assert saved.pose.camera == free.pose.camera
    assert saved.covariance.names[6:] == ("log_focal", *NAMES)
    assert saved.chart.names[6:] == ("width_per_focal", *NAMES)
    assert saved.covariance.deviations == pytest.approx(free.covariance.deviations)
    assert saved.settings["free_principal_point"]


def test_a_car_that_shows_two_wheels_is_found_anywhere():
    case = demo_case()
    end = load(case.photo, case.model, "auto").fit()
    truth = load_pose(case.truth, end.pose.camera.width, end.pose.camera.height).pose
    assert pose_error(end.object.mesh, end.pose, truth).percent < 1.0
