"""Ellipses in pictures: where they are, whatever is bright or dark; and none in texture."""

import cv2
import numpy as np
import pytest

from poseviewer.starts.wheels import find_ellipses
from poseviewer.vehicle.wheel_pose import Ellipse

WIDTH, HEIGHT = 400, 200
WHEEL = Ellipse(131.0, 117.0, 38.0, 24.0, np.radians(97.0))
OTHER = Ellipse(301.5, 92.5, 31.0, 27.0, np.radians(90.0))


def picture(*ellipses: Ellipse, levels=(0.2,), noise: float = 0.02) -> np.ndarray:
    """Disks on a ground that goes from dark at the left to bright at the right."""
    fine = 4
    ground = np.tile(np.linspace(0.0, 0.8, fine * WIDTH), (fine * HEIGHT, 1))
    for ellipse, level in zip(ellipses, levels, strict=True):
        points = np.rint(fine * ellipse.outline(200) - 0.5).astype(np.int32)
        cv2.fillPoly(ground, [points], level)
    small = cv2.resize(ground, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    noisy = small + np.random.default_rng(0).normal(0.0, noise, small.shape)
    return np.asarray(noisy, np.float32)


def is_it(found: Ellipse, wanted: Ellipse) -> bool:
    """Within half a pixel, 4 per cent of the axes, and 4 degrees where that can be told."""
    turn = np.degrees(found.angle - wanted.angle + np.pi / 2.0) % 180.0 - 90.0
    return bool(
        np.hypot(found.cx - wanted.cx, found.cy - wanted.cy) < 0.5
        and abs(np.log(found.a / wanted.a)) < 0.04
        and abs(np.log(found.b / wanted.b)) < 0.04
        and (abs(turn) < 4.0 or wanted.b > 0.85 * wanted.a)
    )


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 2.7], ids=["as it is", "larger"])
def test_both_ellipses_are_found_wherever_they_are(size: float):
    grey = picture(WHEEL, OTHER, levels=(0.9, 0.1))
    grey = cv2.resize(grey, None, fx=size, fy=size, interpolation=cv2.INTER_CUBIC)
    best = [one.ellipse for one in find_ellipses(np.asarray(grey, np.float32))[:2]]
    best.sort(key=lambda ellipse: ellipse.cx)
    for found, wanted in zip(best, (WHEEL, OTHER), strict=True):
        cx, cy, a, b = np.array([found.cx, found.cy, found.a, found.b]) / size
        assert is_it(Ellipse(cx, cy, a, b, found.angle), wanted), (found, wanted)


def test_an_edge_that_changes_its_sign_is_one_outline():
    """The ground is darker than the disk at the left, and brighter at the right."""
    wide = Ellipse(200.0, 100.0, 75.0, 60.0, np.radians(90.0))
    (best, *_) = find_ellipses(picture(wide, levels=(0.4,), noise=0.005))
    assert is_it(best.ellipse, wide)
    assert best.support > 0.6


def test_there_is_none_in_texture():
    noise = np.random.default_rng(1).normal(0.5, 0.2, (HEIGHT, WIDTH))
    assert find_ellipses(np.asarray(noise, np.float32)) == []
