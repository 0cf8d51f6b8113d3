"""Fits end at the truth: on photos drawn by OpenGL, and on the bundled path-traced photos."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.evaluation.synthetic import photograph, random_lighting
from poseviewer.files.demo import demo_case
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.scene import Scene as FitScene
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import PoseError, pose_error
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.loading import open_photo
from poseviewer.vehicle.chart import VehicleChart
from tests.opened import by, scene_of
from tests.renderers import require_opengl

pytestmark = pytest.mark.slow

CAMERAS = {
    "parallel": Parallel(1.0, 320.0, 240.0, 640, 480),
    "perspective": Perspective.from_field_of_view(40.0, 640, 480),
}
THETA = np.array([0.7, 0.62, -0.42, 0.06, 0.45, 0.2])
"""A car seen from its front left, from somewhat above."""


def make_photo(mesh: Mesh, chart: VehicleChart, seed: int) -> Photo:
    """A diffuse car before a plain background, in light that the fit does not know, with sensor
    noise."""
    require_opengl()
    lighting = random_lighting(np.random.default_rng(seed))
    pixels = photograph(mesh, chart.to_pose(THETA), lighting, noise=1.0, seed=seed)
    return Photo(pixels, "synthetic.png", "0" * 64)


def fit_from(scene: FitScene, renderer: Renderer, start: Pose) -> FitProgress:
    problem, note = make_problem(by(scene.with_pose(0, start), chart="vehicle"))
    assert not note
    *_, end = fit_pose(problem, renderer)
    return end


@pytest.mark.parametrize("projection", CAMERAS)
def test_demo_car_is_found_from_8_per_cent_off(projection):
    case = demo_case()
    mesh = load_mesh(case.model)
    keypoints = load_keypoints(case.model, mesh)
    assert keypoints is not None
    chart = VehicleChart(keypoints.left, CAMERAS[projection], depth=10.0)
    photo = make_photo(mesh, chart, seed=1)
    scene = scene_of(photo, mesh, chart.to_pose(THETA), keypoints=keypoints)
    renderer, random = make_renderer(mesh), np.random.default_rng(8)
    for _ in range(2):
        start = THETA * (1.0 + 0.08 * random.choice([-1.0, 1.0], 6))
        end = fit_from(scene, renderer, chart.to_pose(start))
        assert pose_error(mesh, end.pose, chart.to_pose(THETA)).reprojection_px < 1.0


def demo_error(projection: str, settings: FitSettings) -> tuple[PoseError, PoseError]:
    """Errors of the bundled start and of where a fit from it ends."""
    case = demo_case(projection)
    scene = open_photo(case.photo, case.model, case.start, settings)
    photo = load_photo(case.photo)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    problem, _ = make_problem(scene)
    *_, end = fit_pose(problem, make_renderer(scene.objects[0].mesh))
    before = pose_error(scene.objects[0].mesh, scene.pose(0), truth)
    return before, pose_error(scene.objects[0].mesh, end.pose, truth)


@pytest.mark.parametrize("projection", CAMERAS)
def test_the_bundled_photo_is_registered_within_1_5_per_cent(projection):
    before, after = demo_error(projection, FitSettings())
    assert before.percent > 4.0
    assert after.percent < 1.5
