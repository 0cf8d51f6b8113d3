"""Classes and edges: what alters them, what does not, and that all renderers see the same."""

import cv2
import numpy as np
import pytest

from poseviewer.geometry.camera import Parallel, Perspective, Pose, level_pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.losses.default_loss import structure_loss
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.moments import moments_of_images
from poseviewer.render.pyramid.levels import with_structure
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.render.structure import CLASSES, make_structure
from tests.meshes import make_bumpy
from tests.several import lit_on_noise

MESH = make_bumpy(4)


def make_pose(turn: float = 0.0, shift: float = 0.0, parallel: bool = False) -> Pose:
    place = 113.0, 77.0, 220, 160
    camera = Parallel(60.0, *place) if parallel else Perspective(400.0, 400.0, *place)
    rotation = [0.4 + turn, -0.3, 0.2]
    return Pose(camera, RigidTransform.from_rotation_vector(rotation, [0.1 + shift, 0.05, 7.0]))


def make_channels(pose: Pose) -> np.ndarray:
    return lit_on_noise(SoftwareRenderer(MESH), pose, 0.02).clip(0.0, 1.0)


def make_photo(pose: Pose, factor: int = 1) -> PhotoAttributes:
    channels = make_channels(pose)
    weights = np.ones(channels.shape[:2], np.float32)
    weights[:20, :30] = 0.0
    weights[40:60] = 0.5
    return with_structure(PhotoAttributes(channels, weights, False), factor)


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("factor", [1, 3])
def test_the_fast_path_gives_the_plain_moments(parallel, factor):
    """Also where the model is cut off by the picture, or out of it."""
    photo = make_photo(make_pose(parallel=parallel), factor)
    renderer = SoftwareRenderer(MESH)
    for shift in (0.0, 0.4, -1.6, 1.9, 30.0):
        pose = make_pose(0.2, shift, parallel)
        fast = renderer.moments(pose, photo)
        plain = moments_of_images(renderer.render(level_pose(pose, factor)), photo)
        assert fast.pixels == plain.pixels
        np.testing.assert_allclose(fast.mean, plain.mean, atol=1e-6)
        np.testing.assert_allclose(fast.covariance, plain.covariance, atol=1e-6)
        assert fast.edge_cosine == pytest.approx(plain.edge_cosine, abs=1e-5)
        assert structure_loss(fast) == pytest.approx(structure_loss(plain), rel=1e-5)


def test_a_photo_in_negative_has_the_same_edges():
    """Strength and sign of an edge say nothing; the tone curve in front of it does a little."""
    channels = make_channels(make_pose())
    weights = np.ones(channels.shape[:2], np.float32)
    field = make_structure(channels, weights).field
    turned = (1.0 - channels ** (1 / 2.2)) ** 2.2
    negative = make_structure(turned.astype(np.float32), weights).field
    assert float(np.vdot(field, negative)) > 0.999


@pytest.mark.parametrize("is_steep", [False, True])
def test_a_blurred_dark_thing_is_as_large_as_it_is(is_steep):
    """A lens mixes light: half way between dark and bright is not half way in a lightened photo."""
    v, u = np.mgrid[0.5:160, 0.5:220]
    disc = np.hypot(u - 110.0, v - 80.0) < 40.0
    random, size = np.random.default_rng(0), (220, 160)
    ground, dark = (
        cv2.resize(random.uniform(least, most, (16, 22, 3)), size, interpolation=cv2.INTER_CUBIC)
        for least, most in ((0.3, 0.9), (0.0, 0.05))
    )
    sharp = np.where(disc[..., None], dark, ground).astype(np.float32)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 1.0)
    weights = np.ones(disc.shape, np.float32)
    labels = make_structure(np.asarray(blurred, np.float32), weights, is_steep).labels
    of_disc, beside = (np.bincount(labels[part], minlength=16) for part in (disc, ~disc))
    wrong = (of_disc > beside)[labels] != disc
    # Without, a rim of the disc is taken for what is beside it, and nothing the other way round.
    # Made steep, a tenth of it is left, where the ground goes on changing.
    assert np.count_nonzero(wrong & ~disc) == 0
    rim = np.count_nonzero(wrong & disc)
    assert (rim < 20) if is_steep else (rim > 100)


def test_smooth_light_is_no_edge_to_be_made_steep():
    v, u = np.mgrid[0.5:160, 0.5:220]
    waves = 0.5 + 0.4 * np.sin(u / 4.0)  # as much apart within 5 px as a clear edge
    smooth = np.stack((waves, 0.5 + 0.4 * np.cos(v / 4.0), np.full(u.shape, 0.5)), axis=-1)
    weights = np.ones(u.shape, np.float32)
    plain, steep = (make_structure(smooth.astype(np.float32), weights, on) for on in (False, True))
    np.testing.assert_array_equal(plain.labels, steep.labels)


def test_a_photo_of_few_colours_has_as_many_classes():
    channels = np.zeros((40, 50, 3), np.float32)
    channels[10:, :, 0], channels[20:, :, 1] = 0.5, 0.8
    structure = make_structure(channels, np.ones((40, 50), np.float32))
    assert len(structure.class_weights) == 3
    assert structure.class_weights.sum() == 40 * 50
    many = np.random.default_rng(0).uniform(size=(60, 60, 3)).astype(np.float32)
    assert len(make_structure(many, np.ones((60, 60), np.float32)).class_weights) == CLASSES
    rare = np.zeros((60, 60, 3), np.float32)  # colours that a few pixels have
    rare[1, 1 : CLASSES - 2, 0] = np.arange(1, CLASSES - 2) / CLASSES
    assert len(make_structure(rare, np.ones((60, 60), np.float32)).class_weights) == CLASSES - 2
