"""Quick starts as a person makes them: clicks in a real Chromium on the demo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser

from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.fit.scene import LoadedModel
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.starts.loading import load_model
from poseviewer.starts.placing import look_from, surface_point
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture

pytestmark = pytest.mark.slow

PHOTO = (960, 720)
SPOTS = ((180.0, 420.0), (420.0, 300.0), (780.0, 380.0), (540.0, 460.0))
"""Places in the photo, on the car, that are seen from the app's own first view as well."""


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model(demo_case().model)


@pytest.fixture
def truth() -> Pose:
    return load_pose(demo_case().truth, *PHOTO).pose


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppProcess]:
    """Without a start pose: the model in the middle, seen from a corner."""
    case = demo_case()
    with AppProcess(tmp_path_factory.mktemp("demo"), case.photo, case.model) as process:
        yield process


@pytest.fixture(scope="module")
def tab(browser: Browser, app: AppProcess) -> Iterator[AppPage]:
    opened = AppPage(browser, app.url)
    opened.wait_for_text("at this pose")
    opened.page.get_by_text("Quick start", exact=True).click()
    yield opened
    opened.page.close()


@pytest.fixture
def page(tab: AppPage) -> Iterator[AppPage]:
    """One tab for all tests; each begins at the start pose, without marks."""
    yield tab
    assert tab.errors == []
    tab.page.get_by_role("button", name="Point pairs").click()
    tab.page.get_by_role("button", name="Clear marks").click()
    done = tab.page.get_by_role("button", name="Done (Esc)")
    done.click()
    done.wait_for(state="hidden")
    tab.page.keyboard.press("r")


def click(tab: AppPage, point) -> None:
    tab.page.mouse.click(*tab.on_screen(point, PHOTO))


def saved(tab: AppPage, app: AppProcess) -> Pose:
    path = app.folder / "demo_photo.pose.json"
    tab.saved(path)
    return load_pose(path, *PHOTO).pose


def click_pair(tab: AppPage, model: LoadedModel, now: Pose, truth: Pose, spot) -> None:
    """The model point that the photo shows at a spot, as it is drawn now; then the spot."""
    point = surface_point(model.mesh, truth, spot)
    assert point is not None
    drawn = now.project(point)
    seen = surface_point(model.mesh, now, drawn)
    assert seen is not None
    click(tab, drawn)
    click(tab, truth.project(seen))


def test_four_point_pairs_place_the_model(
    page: AppPage, app: AppProcess, model: LoadedModel, truth: Pose
):
    camera = load_photo(demo_case().photo).default_camera()
    now = look_from("three-quarter", model.mesh, model.keypoints, camera)
    page.page.get_by_role("button", name="Point pairs").click()
    page.wait_for_text("pair 1: click a point of the model")
    for count, spot in enumerate(SPOTS[:4]):
        click_pair(page, model, now, truth, spot)
        if count < 3:
            page.wait_for_text(f"{3 - count} more pair")
    page.wait_for_text("pair 4: ")
    keep_picture(page, "pairs")
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


CAR, ROAD = ((810.0, 550.0), (140.0, 220.0)), ((600.0, 600.0), (900.0, 690.0))
"""Corners of rectangles, from where no notice lies: about the car, and where there is none."""


def test_wheels_are_found_in_the_region_that_is_drawn(
    page: AppPage, app: AppProcess, model: LoadedModel, truth: Pose
):
    page.page.get_by_role("button", name="Find wheels: draw a region").click()
    page.wait_for_text("drag a rectangle on the photo")
    page.drag(*ROAD, PHOTO)
    button = page.page.get_by_role("button", name="Find wheels in the region")
    button.click()
    page.wait_for_text("No two wheels were found")
    page.page.get_by_role("button", name="Draw another region").click()
    page.drag(*CAR, PHOTO)
    button.click()
    page.wait_for_text("Looking for wheels")
    keep_picture(page, "looking")
    page.wait_for_text("10 of 10 points on the rims")
    keep_picture(page, "found_wheels")
    assert pose_error(model.mesh, saved(page, app), truth).percent < 5.0
    page.page.keyboard.press("z")
    page.wait_for_text("0 of 10 points on the rims")
