"""A model is framed by a rectangle; surface points are those that a renderer sees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.placing import fit_into_rectangle, surface_hit
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.sides import look_from
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
