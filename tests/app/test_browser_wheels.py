"""Wheels of a model without any are marked on its picture, which is turned by a drag."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.vehicle.chart import visible_side
from poseviewer.vehicle.wheel_pose import wheel_rims
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import make_scene

PHOTO = (960, 720)
"""Size of the demo's photo, px."""


@pytest.mark.slow
@pytest.mark.long
def test_the_picture_turns_and_stays_in_its_place_while_wheels_are_marked(
    browser: Browser, tmp_path: Path
):
    scene = make_scene(tmp_path)
    with AppProcess(tmp_path, scene.photo, scene.model) as app, AppPage(browser, app.url) as tab:
        tab.page.keyboard.press("Escape")
        tab.open_step(2)
        tab.page.get_by_role("button", name="Wheels", exact=True).click()
        picture = tab.page.locator(".pv-model svg")
        picture.wait_for()
        box, shown = picture.bounding_box(), picture.locator("image").get_attribute("href")
        assert box is not None
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        tab.page.mouse.move(*middle)
        tab.page.mouse.down()
        tab.page.mouse.move(middle[0] + 60, middle[1] + 10, steps=4)
        tab.page.mouse.up()
        tab.until(lambda: picture.locator("image").get_attribute("href") != shown)
        assert picture.locator("text").count() == 0  # a drag marks nothing
        canvas = tab.view()["box"]
        picture.click(position={"x": box["width"] / 2, "y": box["height"] / 2})
        tab.wait_for_text("middle of the front wheel")
        tab.page.get_by_role("button", name="Remove last mark").click()
        tab.wait_for_text("middle of the rear wheel")
        assert tab.view()["box"] == canvas


@pytest.mark.slow
@pytest.mark.long
def test_the_photo_stays_where_it_is_while_rims_place_a_car(browser: Browser, tmp_path: Path):
    case = demo_case()
    model, truth = load_model(case.model), load_pose(case.truth, *PHOTO).pose
    assert model.keypoints is not None
    rims = wheel_rims(truth, visible_side(model.keypoints, truth), 0.3)
    points = [point.tolist() for rim in rims for point in rim[[1, 6, 11, 16, 20]]]
    with AppProcess(tmp_path, case.photo, case.model) as app, AppPage(browser, app.url) as tab:
        tab.page.keyboard.press("Escape")
        tab.open_step(2)
        before = tab.view()["box"]
        tab.page.get_by_role("button", name="Wheels", exact=True).click()
        tab.until(lambda: tab.view()["box"] != before)  # the panel opens at once
        tab.settled_picture()
        canvas = tab.view()["box"]
        for number, point in enumerate(points, 1):
            tab.page.mouse.click(*tab.on_screen(point, PHOTO))
            count = f"point {number % 5 + 1} of 5" if number < 10 else "search from here"
            tab.wait_for_text(count)
        tab.wait_for_text("at this pose")
        assert tab.view()["box"] == canvas
        tab.page.keyboard.press("Escape")
        tab.wait_for_text("roll, scale")
        assert tab.view()["box"] == canvas
