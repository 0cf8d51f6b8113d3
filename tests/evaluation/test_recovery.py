"""Fits end at the truth: on photos drawn by OpenGL, and on the bundled path-traced photos."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from poseviewer.api import load, make_registration
from poseviewer.app.state.document import with_camera
from poseviewer.evaluation.photos import demo_photo
from poseviewer.evaluation.synthetic import photograph, random_lighting
from poseviewer.files.demo import demo_case
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.vehicle.chart import VehicleChart
from tests.opened import by, scene_of
from tests.renderers import require_opengl
from tests.view_sets import focal_length

pytestmark = pytest.mark.slow

CAMERA = Perspective.from_field_of_view(40.0, 640, 480)
THETA = np.array([0.7, 0.62, -0.42, 0.06, 0.45, 0.2])
"""A car seen from its front left, from somewhat above."""


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


@pytest.mark.parametrize(
    ("kind", "loss", "percent"), [("parallel", "default", 1.5), ("perspective", "paper", 0.5)]
)
def test_the_bundled_photo_is_registered(kind: Any, loss, percent):
    files, truth = demo_case(kind), demo_photo(cast(Any, f"photo-{kind}")).truth
    found = load(files.photo, files.model, files.start, loss=loss).fit()
    before, after = (pose_error(found.mesh, one.pose, truth) for one in (found.start, found))
    assert before.percent > 4.0
    assert after.percent < percent


def test_the_focal_length_is_found_from_a_third_off():
    files, truth = demo_case(), demo_photo("photo-perspective").truth
    known, focal = load(files.photo, files.model, files.start), focal_length(truth.camera)
    off = replace(known.pose.camera, fx=4.0 / 3.0 * focal, fy=4.0 / 3.0 * focal)
    start = with_camera(known.pose, off, known.mesh.centre)
    end = load(files.photo, files.model, start, free_focal=True).fit(threads=2)
    assert focal_length(end.pose.camera) == pytest.approx(focal, rel=0.06)
    assert pose_error(end.mesh, end.pose, truth).reprojection_px < 2.0
