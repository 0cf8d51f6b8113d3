"""Coarser levels of a photo: what they average, and that they have the full photo's minimum."""

import tracemalloc

import numpy as np
import pytest

from poseviewer.geometry.camera import Parallel, Perspective, Pose, level_pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.pyramid.levels import downsample, make_level
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_bumpy
from tests.several import lit_on_noise

MESH = make_bumpy(4)


def make_pose(parallel: bool) -> Pose:
    place = 166.0, 117.0, 320, 240
    camera = Parallel(90.0, *place) if parallel else Perspective(600.0, 600.0, *place)
    return Pose(camera, RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [0.1, 0.05, 7.0]))


def make_photo(pose: Pose, **settings) -> PhotoAttributes:
    """The model lit from one side, on a grey ground with noise that has nothing to do with it."""
    channels = lit_on_noise(SoftwareRenderer(MESH), pose)
    return PhotoAttributes(channels, np.ones(channels.shape[:2], np.float32), **settings)


@pytest.mark.parametrize("parallel", [False, True])
def test_pixels_of_a_level_are_those_that_its_poses_project_to(parallel):
    pose = make_pose(parallel)
    points = pose.project(MESH.vertices)
    for factor in (2, 3, 8):
        assert level_pose(pose, factor).project(MESH.vertices) == pytest.approx(points / factor)


def test_models_have_no_more_triangles_than_the_level_shows():
    pose = make_pose(False)
    photo, renderer = make_photo(pose), SoftwareRenderer(MESH)
    pixels = renderer.moments(pose, photo).pixels
    for factor in (2, 4):
        level = make_level(photo, renderer, factor, pixels)
        shown = np.unique(level.renderer.render(level_pose(pose, factor)).face_ids)
        area = pixels / factor**2
        assert 0.1 * area < len(shown) < area


@pytest.mark.parametrize(("width", "height", "factor"), [(320, 240, 4), (317, 241, 4), (5, 3, 8)])
def test_sizes_are_those_of_level_poses_and_the_mean_stays(width, height, factor):
    random = np.random.default_rng(3)
    photo = PhotoAttributes(
        random.uniform(size=(height, width, 1)).astype(np.float32),
        random.uniform(0.5, 1.0, (height, width)).astype(np.float32),
        clipped=False,
        colour_reflectance=True,
    )
    small = downsample(photo, factor)
    pose = Pose(
        Perspective(300.0, 300.0, width / 2, height / 2, width, height), RigidTransform.identity()
    )
    camera = level_pose(pose, factor).camera
    assert small.channels.shape == (camera.height, camera.width, 1)
    assert (small.clipped, small.colour_reflectance) == (False, True)
    assert small.origin == pytest.approx(photo.origin, abs=1e-5)
    assert small.weights.sum() * factor**2 == pytest.approx(photo.weights.sum(), rel=1e-5)


def test_what_does_not_count_does_not_show_in_a_coarser_pixel():
    channels = np.full((8, 8, 3), 0.25, np.float32)
    weights = np.ones((8, 8), np.float32)
    weights[:, 3:] = 0.0
    channels[:, 3:] = np.nan
    small = downsample(PhotoAttributes(channels, weights), 2)
    assert small.weights.shape == (4, 4)
    assert small.weights[0] == pytest.approx([1.0, 0.5, 0.0, 0.0])
    assert small.channels[:, :2] == pytest.approx(np.full((4, 2, 3), 0.25))
    assert np.all(small.channels[:, 2:] == 0.0)


def test_a_large_photo_is_reduced_in_strips_that_show_nowhere(monkeypatch):
    random = np.random.default_rng(0)
    weights = random.integers(0, 2, (1500, 1001)).astype(np.float32)
    channels = random.random((1500, 1001, 3), dtype=np.float32)
    photo = PhotoAttributes(channels, weights)
    whole = downsample(photo, 7)
    monkeypatch.setattr("poseviewer.render.pyramid.levels.STRIP_PIXELS", 50_000)
    tracemalloc.start()
    striped = downsample(photo, 7)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(striped.channels, whole.channels)
    np.testing.assert_array_equal(striped.weights, whole.weights)
    assert peak < 0.5 * channels.nbytes
