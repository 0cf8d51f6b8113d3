"""Quick starts as a person makes them: clicks in a real Chromium on the demo."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from poseviewer.app.workers.overlay import ALONE_MARGIN
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.placing import fit_into_rectangle, surface_point
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.scene.assets import ModelFile
from poseviewer.starts.sides import look_from
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage

pytestmark = pytest.mark.slow

PHOTO = (960, 720)
SIZE = "node => (box => [box.width, box.height])(node.getBoundingClientRect())"
SPOTS = ((180.0, 420.0), (420.0, 300.0), (780.0, 380.0), (540.0, 460.0))
"""Places in the photo, on the car, that are seen from the app's own first view as well."""


def click(tab: AppPage, point) -> None:
    tab.page.mouse.click(*tab.on_screen(point, PHOTO))


def saved(tab: AppPage, app: AppProcess) -> Pose:
    path = app.folder / "demo_photo.demo_car.pose.json"
    tab.saved(path)
    return load_pose(path, *PHOTO).pose


def click_pair(tab: AppPage, model: ModelFile, drawn: Pose, truth: Pose, spot) -> None:
    """The model point that the photo shows at a spot, as it is drawn beside; then the spot."""
    point = surface_point(model.mesh, truth, spot)
    assert point is not None
    place = drawn.project(point)
    seen = surface_point(model.mesh, drawn, place)
    assert seen is not None
    picture = tab.page.locator(".pv-model svg")
    x, y = place / PHOTO * picture.evaluate(SIZE)
    picture.click(position={"x": x, "y": y})  # once it rests
    click(tab, truth.project(seen))


@pytest.mark.long
def test_four_point_pairs_place_the_model(browser: Browser, tmp_path: Path):
    case = demo_case()  # without its start: the model in the middle, seen from a corner
    model, truth = load_model(case.model), load_pose(case.truth, *PHOTO).pose
    camera = load_photo(case.photo).default_camera()
    now = look_from("three-quarter", model.mesh, model.keypoints, camera)
    drawn = fit_into_rectangle(now, model.mesh, Rectangle(0, 0, *PHOTO).expand(-ALONE_MARGIN))
    with AppProcess(tmp_path, case.photo, case.model) as app, AppPage(browser, app.url) as page:
        page.page.get_by_role("button", name="Point pairs").click()
        page.wait_for_text("pair 1: click a point of the model")
        page.page.locator(".pv-model image").wait_for()
        page.settled_picture()
        for count, spot in enumerate(SPOTS):
            click_pair(page, model, drawn, truth, spot)
            if count < 3:
                page.wait_for_text(f"{3 - count} more pair")
        page.wait_for_text("pair 5: ")
        found = saved(page, app)
        assert pose_error(model.mesh, found, truth).percent < 3.0
        # A mark that is dragged takes the pose along; undo brings both back.
        page.drag(SPOTS[0], (SPOTS[0][0], SPOTS[0][1] + 40.0), PHOTO)
        assert pose_error(model.mesh, saved(page, app), found).percent > 0.5
        page.page.keyboard.press("z")
        again = saved(page, app)
        np.testing.assert_array_equal(again.project([0, 0, 0]), found.project([0, 0, 0]))
        page.page.get_by_role("button", name="Remove last mark").click()
        page.wait_for_text("1 more pair needed")
        page.page.keyboard.press("Escape")
        page.wait_for_text("roll, scale")
