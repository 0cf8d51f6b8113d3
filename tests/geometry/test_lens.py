from dataclasses import astuple

import numpy as np
import pytest

from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import (
    MIRRORED,
    WAY_BACK,
    Lens,
    Undistortion,
    opencv_matrix,
    rotate_camera,
    rotate_lens,
    turn_axes,
    undistort,
)

TAKEN = Perspective(420.0, 430.0, 321.3, 236.8, 640, 480)
LENSES = {
    "5": Lens("opencv", (-0.25, 0.08, 0.002, -0.0015, -0.01)),
    "8": Lens("opencv", (0.3, -0.1, 0.001, 0.002, 0.02, 0.45, 0.05, -0.01)),
    "12": Lens("opencv", (-0.2, 0.05, 1e-3, 1e-3, 0.0, 0.01, 0.0, 0.0, 4e-3, -1e-3, -3e-3, 1e-3)),
    "fisheye": Lens("fisheye", (0.05, -0.02, 0.006, -0.001)),
    "pincushion": Lens("opencv", (0.2, 0.05, 0.0, 0.0, 0.0)),
}
POINTS = np.array([(u, v) for u in (90.0, 250.25, 430.5, 560.0) for v in (70.0, 200.4, 410.7)])
"""Points of the undistorted photo; pixel centres at i + 0.5."""


def taken_by_the_book(points: np.ndarray, lens: Lens) -> np.ndarray:
    """Map points of the undistorted photo by OpenCV's formulas, written out."""
    x, y = ((points - [TAKEN.cx, TAKEN.cy]) / [TAKEN.fx, TAKEN.fy]).T
    r = np.hypot(x, y)
    if lens.model == "fisheye":
        k1, k2, k3, k4 = lens.coefficients
        angle = np.arctan(r)
        seen = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
        moved = np.array([x, y]) * seen / r
    else:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = np.pad(
            lens.coefficients, (0, 12 - len(lens.coefficients))
        )
        radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        moved = np.array([
            x * radial + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2) + s1 * r**2 + s2 * r**4,
            y * radial + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y + s3 * r**2 + s4 * r**4,
        ])  # fmt: skip
    return moved.T * [TAKEN.fx, TAKEN.fy] + [TAKEN.cx, TAKEN.cy]


def picture_of_dots(centres: np.ndarray, deep: bool = False) -> np.ndarray:
    """(480, 640, 3): a round blot about each centre."""
    v, u = np.mgrid[:480, :640] + 0.5
    blots = sum(np.exp(-((u - a) ** 2 + (v - b) ** 2) / (2 * 2.5**2)) for a, b in centres)
    top, kind = (65535.0, np.uint16) if deep else (255.0, np.uint8)
    grey = np.rint(np.clip(blots, 0.0, 1.0) * top).astype(kind)
    return np.repeat(grey[..., None], 3, axis=2)


def centroid(picture: np.ndarray, near: np.ndarray) -> np.ndarray:
    left, top = np.floor(near).astype(int) - 12
    weights = picture[top : top + 25, left : left + 25, 0].astype(float)
    v, u = np.mgrid[top : top + 25, left : left + 25] + 0.5
    return np.array([np.sum(weights * u), np.sum(weights * v)]) / weights.sum()


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
@pytest.mark.parametrize("deep", [False, True], ids=["8 bit", "16 bit"])
def test_known_points_land_where_a_pinhole_sees_them(lens, deep):
    taken = taken_by_the_book(POINTS, lens)
    assert np.abs(taken - POINTS).max() > 10.0  # it is a lens to speak of
    inside = np.all((taken > 12) & (taken < [628, 468]), axis=1)
    assert inside.sum() >= 6
    picture, covered = undistort(picture_of_dots(taken, deep), Undistortion.of(lens, TAKEN))
    assert picture.dtype == (np.uint16 if deep else np.uint8)
    for point in POINTS[inside]:
        assert covered[int(point[1]), int(point[0])]
        assert np.linalg.norm(centroid(picture, point) - point) < 0.1


def test_what_the_photo_does_not_show_is_black_and_said_so():
    white = np.full((480, 640, 1), 255, np.uint8)
    picture, covered = undistort(white, Undistortion.of(LENSES["pincushion"], TAKEN))
    assert not covered[0, 0]
    assert covered[240, 320]
    assert 0.3 < covered.mean() < 0.95
    assert np.all(picture[covered] == 255)
    assert np.all(picture[~covered] == 0)


def test_a_polynomial_that_turns_back_shows_nothing_twice():
    """Beyond r = 1 / sqrt(-3 k1) the radius falls again, into the photo."""
    lens = Lens("opencv", (-0.8, 0.0, 0.0, 0.0, 0.0))
    white = np.full((480, 640, 1), 255, np.uint8)
    _, covered = undistort(white, Undistortion.of(lens, TAKEN))
    v, u = np.nonzero(covered)
    radii = np.hypot((u + 0.5 - TAKEN.cx) / TAKEN.fx, (v + 0.5 - TAKEN.cy) / TAKEN.fy)
    assert radii.max() == pytest.approx(1.0 / np.sqrt(2.4), abs=0.01)


@pytest.mark.parametrize(("model", "count"), [("opencv", 3), ("opencv", 6), ("fisheye", 5)])
def test_an_unknown_number_of_coefficients_is_refused(model, count):
    with pytest.raises(ValueError, match=f"{count} coefficients"):
        Lens(model, (0.0,) * count)


def upright(points: np.ndarray, orientation: int) -> np.ndarray:
    """Points of the picture as stored, px from its corner, in the upright one, by EXIF's words."""
    x, y = points.T
    width, height = TAKEN.width, TAKEN.height
    return np.stack({
        1: (x, y), 2: (width - x, y), 3: (width - x, height - y), 4: (x, height - y),
        5: (y, x), 6: (height - y, x), 7: (height - y, width - x), 8: (y, width - x),
    }[orientation], axis=-1)  # fmt: skip


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", LENSES)
def test_a_turned_camera_sees_what_the_stored_one_does(name, orientation):
    lens, axes = LENSES[name], turn_axes(orientation)
    in_camera = np.random.default_rng(0).uniform((-0.5, -0.5, 1.5), (0.5, 0.5, 2.5), (20, 3))

    def seen(points, camera, lens):
        still = np.zeros(3), np.zeros(3), opencv_matrix(camera), lens.array
        return lens.module.projectPoints(points[:, None], *still)[0][:, 0] + 0.5

    camera = rotate_camera(TAKEN, orientation)
    found = seen(in_camera @ axes.T, camera, rotate_lens(lens, orientation))
    np.testing.assert_allclose(found, upright(seen(in_camera, TAKEN, lens), orientation), atol=1e-9)
    assert (camera.width, camera.height) == ((480, 640) if orientation > 4 else (640, 480))
    back = rotate_camera(camera, WAY_BACK[orientation])
    np.testing.assert_allclose(astuple(back), astuple(TAKEN))
    assert (np.linalg.det(axes) < 0.0) == (orientation in MIRRORED)


def test_a_tilted_sensor_turns_upside_down_alone():
    tilted = Lens("opencv", (*LENSES["12"].coefficients, 0.02, -0.01))
    assert rotate_lens(tilted, 3).coefficients[12:] == (-0.02, 0.01)
    with pytest.raises(ValueError, match="tilted"):
        rotate_lens(tilted, 6)
