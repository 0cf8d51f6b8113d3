"""Model and photo coincide to half a pixel in real Chromium."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from playwright.sync_api import Browser

from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage

SIZES = ((1100, 700), (900, 800), (1400, 520))
ZOOMS = (1.0, 3.3, 9.0)
PHOTO = (640, 400)


def make_dots(folder: Path, camera: Perspective) -> np.ndarray:
    """A model of small balls, and a photo with a white dot wherever numpy projects one; (k, 2)."""
    places = np.array([[-1.6, -0.8, 0.2], [1.5, -0.7, -0.3], [0.1, 0.1, 0.5], [1.2, 0.9, 0.0]])
    balls = [trimesh.creation.icosphere(4, 0.1).apply_translation(place) for place in places]
    trimesh.util.concatenate(balls).export(str(folder / "dots.ply"))
    pose = Pose(camera, RigidTransform.from_rotation_vector([0.2, -0.1, 0.1], [0.0, 0.0, 8.0]))
    save_pose(folder / "dots.json", PoseRecord.of(pose))
    seen = pose.project(places)
    v, u = np.mgrid[0 : PHOTO[1], 0 : PHOTO[0]] + 0.5
    fine = np.full((PHOTO[1], PHOTO[0], 3), (70.0, 70.0, 70.0))
    for x, y in seen:
        share = np.clip(4.0 - np.hypot(u - x, v - y), 0.0, 1.0)[..., None]
        fine = fine * (1.0 - share) + share * 235.0
    save_image(folder / "dots.png", np.rint(fine).astype(np.uint8))
    return seen


def centre_of(weights: np.ndarray, near: tuple[float, float], reach: float) -> np.ndarray:
    """(2,): the weighted mean place near another, pixel centres at i + 0.5."""
    v, u = np.mgrid[0 : weights.shape[0], 0 : weights.shape[1]] + 0.5
    close = weights * (np.hypot(u - near[0], v - near[1]) < reach)
    assert close.any(), f"nothing marked within {reach:.0f} px of {near}"
    return np.array([(close * u).sum(), (close * v).sum()]) / close.sum()


def circle_centre(weights: np.ndarray, near: tuple[float, float], reach: float) -> np.ndarray:
    """(2,): the centre of the circle through marked pixels, by least squares (Kasa's): a line of
    two pixels is not as bright all around, so its mean place is no measure.
    """
    v, u = np.nonzero(weights)
    close = np.hypot(u + 0.5 - near[0], v + 0.5 - near[1]) < reach
    u, v = u[close] + 0.5 - near[0], v[close] + 0.5 - near[1]
    assert len(u) > 8, f"no outline within {reach:.0f} px of {near}"
    root = np.sqrt(weights[weights > 0][close])
    rows = root[:, None] * np.column_stack([u, v, np.ones_like(u)])
    found = np.linalg.lstsq(rows, root * (u * u + v * v), rcond=None)[0]
    return found[:2] / 2.0 + near


@pytest.mark.slow
@pytest.mark.long
def test_model_and_photo_coincide(browser: Browser, tmp_path: Path):
    seen = make_dots(tmp_path, Perspective(900.0, 900.0, 290.3, 231.7, *PHOTO))
    files = (tmp_path / "dots.png", tmp_path / "dots.ply", "--pose", tmp_path / "dots.json")
    with AppProcess(tmp_path, *files) as app, AppPage(browser, app.url, pixel_ratio=1.0) as tab:
        tab.wait_for_text("at this pose")
        for size in SIZES:
            tab.page.set_viewport_size({"width": size[0], "height": size[1]})
            tab.until(lambda: is_at_rest(tab))
            for zoom in ZOOMS:
                assert_coincident(tab, seen, zoom)


def is_at_rest(tab: AppPage) -> bool:
    """Whether no panel glides: nothing is animated, and for a while the photo stays where it is."""
    before = tab.view()
    tab.page.wait_for_timeout(400)
    return tab.page.evaluate("document.getAnimations().length") == 0 and tab.view() == before


def assert_coincident(tab: AppPage, seen: np.ndarray, zoom: float) -> None:
    for point in seen[:2] if zoom == 1.0 else seen[2:3]:
        for _ in range(5):  # until no panel moves the photo meanwhile
            tab.page.evaluate("window.poseviewer.showAll()")
            x, y = tab.on_screen(point, PHOTO)
            left, top = tab.view()["box"][:2]
            # What lies under the cursor stays there: only points inside the window can be seen.
            tab.page.evaluate(f"window.poseviewer.zoomAt({x - left}, {y - top}, {zoom})")
            wanted, scale = tab.on_screen(point, PHOTO), tab.view()["scale"]
            picture = tab.settled_picture(wanted, 18.0 * scale + 10.0).astype(int)
            if tab.on_screen(point, PHOTO) == wanted:
                break
        np.testing.assert_allclose(wanted, (x, y), atol=1e-6)
        red, blue = picture[..., 0], picture[..., 2]
        # The dot is white on grey, the outline around it cyan.
        dot = centre_of(np.clip(red - 90, 0, None), wanted, 6.5 * scale)
        outline = circle_centre(np.clip(blue - red - 20, 0, None), wanted, 18.0 * scale)
        assert np.abs(dot - wanted).max() < 0.5
        # Outlines are found in three samples a photo px: what zoom shows of a photo px, it shows.
        assert np.abs(outline - wanted).max() < max(0.5, 0.08 * scale)
