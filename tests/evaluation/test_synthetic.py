"""Synthetic photographs are where, and as bright as, the models of the program say."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.evaluation.synthetic import Lighting, cut_out, photograph, random_lighting
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.opengl import OpenGLRenderer
from tests.meshes import make_box, make_bumpy, make_waves
from tests.renderers import require_opengl

LIGHTING = Lighting(
    np.array([0.3, 0.25, 0.28]),
    np.array([np.divide(v, np.linalg.norm(v)) for v in ([0.3, -0.5, -0.8], [-0.8, 0.1, -0.3])]),
    np.array([[0.6, 0.55, 0.5], [0.1, 0.12, 0.1]]),
)
PLACE = RigidTransform.from_rotation_vector([0.7, -0.4, 0.2], [0.1, -0.05, 4.0])
BUMPY = make_bumpy()
TEXTURED = replace(
    BUMPY,
    uvs=BUMPY.vertices[:, :2] * 0.4,
    face_texture=np.where(BUMPY.vertices[BUMPY.faces[:, 0], 2] > 0.0, 0, -1),
    textures=(make_waves(64, 128),),
)
POSES = pytest.mark.parametrize(
    "pose",
    [
        Pose(Perspective(310.0, 300.0, 103.3, 91.8, 240, 181), PLACE),
        Pose(Parallel(70.0, 131.2, 81.7, 240, 181), PLACE),
    ],
    ids=["perspective", "parallel"],
)


@pytest.fixture(autouse=True, scope="module")
def _opengl():
    require_opengl()


def on_border(values):
    """Pixels with a neighbour of another value: there, a photo shows a mixture."""
    moved = [np.roll(values, step, axis) for axis in (0, 1) for step in (-1, 1)]
    return np.any([values != one for one in moved], axis=0)


@POSES
@pytest.mark.parametrize("mesh", [BUMPY, TEXTURED], ids=["colours", "texture"])
def test_diffuse_photo_is_affine_in_reflectance_and_its_product_with_the_normal(mesh, pose):
    colour, coverage = cut_out(OpenGLRenderer(mesh), pose, LIGHTING)
    image = OpenGLRenderer(mesh).render(pose)
    cosines = [image.normals @ towards for towards in LIGHTING.towards]
    lit = (coverage == 1.0) & image.mask & (cosines[0] > 0.05) & (cosines[1] > 0.05)
    lit &= ~on_border(mesh.face_texture[image.face_ids])
    assert lit.sum() > 1000
    for channel in range(3):
        k = image.reflectance[lit][:, channel].astype(float)
        attributes = np.column_stack([k, k[:, None] * image.normals[lit]])
        seen = colour[lit][:, channel].astype(float)
        found, *_ = np.linalg.lstsq(attributes, seen, rcond=None)
        light = LIGHTING.intensity[:, channel] @ LIGHTING.towards
        assert found == pytest.approx([LIGHTING.ambient[channel], *light], abs=0.005)
        residual = seen - attributes @ found
        assert np.median(np.abs(residual)) < 0.5 / 255
        assert 1 - residual.var() / seen.var() > 0.999


@POSES
@pytest.mark.parametrize("mesh", [make_box(), BUMPY], ids=["box", "bumpy"])
def test_coverage_is_the_share_of_each_pixel_that_the_model_covers(mesh, pose):
    _, coverage = cut_out(OpenGLRenderer(mesh), pose, LIGHTING)
    opengl = OpenGLRenderer(mesh)
    fine = opengl.render_mask(pose.rescale(8))
    exact = fine.reshape(pose.camera.height, 8, pose.camera.width, 8).mean(axis=(1, 3))
    assert np.abs(coverage - exact).max() < 0.15  # of 16 samples each
    for axis in (0, 1):
        place = np.arange(exact.shape[1 - axis]) + 0.5
        sums = coverage.sum(axis=axis, dtype=float), exact.sum(axis=axis)
        first, second = (np.average(place, weights=w) for w in sums)
        assert first == pytest.approx(second, abs=0.005)
    mask = opengl.render(pose).mask
    assert mask[coverage == 1.0].all()
    assert not mask[coverage == 0.0].any()


def test_highlights_only_add_light():
    pose, renderer = Pose(Parallel(60.0, 120.0, 90.0, 240, 180), PLACE), OpenGLRenderer(BUMPY)
    diffuse, glossy = (cut_out(renderer, pose, LIGHTING, much)[0] for much in (0.0, 0.4))
    assert (glossy >= diffuse - 1e-6).all()
    assert (glossy - diffuse).max() > 0.1


def test_background_blur_and_noise():
    pose, mesh = Pose(Parallel(30.0, 60.0, 40.0, 120, 80), PLACE), make_box()
    picture = np.random.default_rng(0).integers(0, 256, (80, 120, 3), dtype=np.uint8)
    photo = photograph(mesh, pose, LIGHTING, picture / 255.0)
    _, coverage = cut_out(OpenGLRenderer(mesh), pose, LIGHTING)
    assert (photo[coverage == 0.0] == picture[coverage == 0.0]).all()
    grey = (0.5, 0.5, 0.5)
    plain = photograph(mesh, pose, LIGHTING, grey)
    noisy = [photograph(mesh, pose, LIGHTING, grey, noise=4.0, seed=s) for s in (1, 1, 2)]
    assert (noisy[0] == noisy[1]).all()
    assert (noisy[0] != noisy[2]).any()
    assert np.std(noisy[0].astype(float) - plain) == pytest.approx(4.0, rel=0.1)
    blurred = photograph(mesh, pose, LIGHTING, picture / 255.0, blur_px=2.0)
    steps = [np.abs(np.diff(one.astype(float), axis=0)).mean() for one in (blurred, photo)]
    assert steps[0] < 0.3 * steps[1]


def test_random_light_comes_from_before_the_model():
    for seed in range(50):
        lighting = random_lighting(np.random.default_rng(seed))
        assert 1 <= len(lighting.towards) == len(lighting.intensity) <= 2
        assert np.linalg.norm(lighting.towards, axis=1) == pytest.approx(1.0)
        assert (lighting.towards @ [0.0, -0.6, -0.8] >= np.cos(np.radians(65.0)) - 1e-9).all()
