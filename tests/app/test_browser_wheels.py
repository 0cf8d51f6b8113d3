"""Wheels of a model without any are marked on its picture, which is turned by a drag."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import make_scene


def press(picture: Locator, u: float, v: float) -> None:
    box = picture.bounding_box()
    assert box is not None
    picture.click(position={"x": u * box["width"], "y": v * box["height"]})


@pytest.mark.slow
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
        press(picture, 0.5, 0.5)
        tab.wait_for_text("middle of the front wheel")
        tab.page.get_by_role("button", name="Remove last mark").click()
        tab.wait_for_text("middle of the rear wheel")
        assert tab.view()["box"] == canvas
