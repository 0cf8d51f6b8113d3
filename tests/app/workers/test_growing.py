"""A scribble grows to the edge of the thing that it lies on."""

import cv2
import numpy as np
import pytest

from poseviewer.app.state.hiding import Stroke
from poseviewer.app.workers.tasks import segment
from poseviewer.errors import QuickStartError
from poseviewer.geometry.image import Photo


def photo_of(thing: np.ndarray, depth: type[np.unsignedinteger] = np.uint8) -> Photo:
    """A green thing before a red and grey ground, both noisy."""
    random = np.random.default_rng(0)
    ground = np.where(np.arange(thing.shape[1]) % 60 < 30, 200.0, 120.0)[None, :, None]
    ground = ground * np.array([1.0, 0.6, 0.5])
    pixels = np.where(thing[..., None], np.array([40.0, 160.0, 70.0]), ground)
    pixels = np.clip(pixels + random.normal(0.0, 8.0, (*thing.shape, 3)), 0.0, 255.0)
    top = np.iinfo(depth).max / 255.0
    return Photo(np.rint(pixels * top).astype(depth), "p.png", "0" * 64)


def assert_hides(found: np.ndarray, thing: np.ndarray, rim: int) -> None:
    """All of the thing is found, and nothing farther than ``rim`` px from it."""
    near = cv2.dilate(thing.astype(np.uint8), np.ones((2 * rim + 1,) * 2, np.uint8)) > 0
    assert np.mean(found[thing]) > 0.98
    assert not np.any(found & ~near)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("size", [(120, 160), (900, 1200)])
def test_a_scribble_grows_to_the_edge(size: tuple[int, int], depth):
    height, width = size
    v, u = np.mgrid[:height, :width] / height
    thing = np.hypot(u - 0.6, (v - 0.5) * 2.0) < 0.25
    points = np.array([[0.45, 0.5], [0.6, 0.48], [0.75, 0.5]]) * height
    found = segment(photo_of(thing, depth), Stroke("scribble", points, 0.01 * height))
    assert_hides(found, thing, rim=2 if height < 500 else 10)


def test_what_is_like_it_elsewhere_stays():
    thing = np.zeros((120, 160), bool)
    thing[40:80, 20:60] = thing[40:80, 90:130] = True
    points = np.array([[30.0, 60.0], [50.0, 60.0]])
    found = segment(photo_of(thing), Stroke("scribble", points, 2.0))
    assert found[45:75, 25:55].mean() > 0.95
    assert not found[:, 85:].any()


def test_a_thing_that_the_photo_cuts_off_is_taken_to_the_border():
    thing = np.zeros((120, 160), bool)
    thing[60:, 50:90] = True
    points = np.array([[60.0, 70.0], [80.0, 110.0]])
    found = segment(photo_of(thing), Stroke("scribble", points, 2.0))
    assert found[-1, 55:85].all()
    assert_hides(found, thing, rim=2)


def test_a_scribble_beside_the_photo_is_refused():
    thing = np.zeros((120, 160), bool)
    with pytest.raises(QuickStartError, match="beside the photo"):
        segment(photo_of(thing), Stroke("scribble", np.array([[-50.0, -50.0]]), 2.0))
