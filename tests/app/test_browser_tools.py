"""The photo keeps its place while a tool is active, whatever is pressed meanwhile."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser

from poseviewer.app.state.hiding import HIDING
from tests.app.browser import AppPage
from tests.app.running_app import running_app
from tests.scene import Scene

pytestmark = pytest.mark.slow
PHOTO = (160, 120)
MIDDLE = (83.0, 58.0)
"""Place of the model in the photo, px."""
NOT_PLACED = "is not placed yet"
PLACING = {"box": "Fit to box", "pairs": "Point pairs", "wheels": "Wheels"}
"""Buttons of tools in the step Place."""


@pytest.fixture(scope="module")
def page(
    browser: Browser, scene: Scene, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[AppPage]:
    """The page on a model without a pose."""
    state = tmp_path_factory.mktemp("state")
    with running_app(scene, state, has_start=False) as app, AppPage(browser, app.url) as tab:
        tab.page.keyboard.press("Escape")
        tab.wait_for_text(NOT_PLACED)
        yield tab


def place_of_photo(tab: AppPage) -> Any:
    """Box of the photo's canvas once it rests, px of the window."""
    boxes = [tab.view()["box"]]
    tab.until(lambda: boxes.append(tab.view()["box"]) or boxes[-1] == boxes[-2])
    return boxes[-1]


def take(tab: AppPage, tool: str) -> None:
    button = tab.page.get_by_role("button", name=PLACING.get(tool, tool.capitalize()))
    if tool in PLACING:
        tab.open_step(2)
        button.click()
    elif tool in HIDING:
        tab.page.keyboard.press("h")
        button.click()
    elif tool == "measure":
        tab.page.keyboard.press("m")
    else:
        tab.open_step(3)
        button = tab.page.get_by_role("button", name="Draw a region")
        if not button.is_visible():
            tab.page.get_by_text("Settings", exact=True).click()
        button.click()


def undo_until_it_has_no_pose(tab: AppPage) -> None:
    text = tab.page.get_by_text(NOT_PLACED)
    for _ in range(5):
        tab.page.keyboard.press("z")
        tab.page.wait_for_timeout(200.0)
        if text.is_visible():
            return
    raise AssertionError("the model keeps its pose")


@pytest.mark.parametrize("tool", [*HIDING, "measure", "region", "pairs", "wheels", "box"])
def test_the_photo_stays_where_it_is_while_a_tool_is_active(page: AppPage, tool: str) -> None:
    folded = place_of_photo(page)
    at = page.on_screen(MIDDLE, PHOTO)
    page.page.mouse.click(*at)
    page.wait_for_text("too large or too small?")  # its size is by chance
    page.until(lambda: page.view()["box"] != folded)  # there is something to tell
    place_of_photo(page)
    take(page, tool)
    before = place_of_photo(page)
    undo_until_it_has_no_pose(page)  # with the usual tool this folds the panel at the right
    assert place_of_photo(page) == before
    page.page.keyboard.press("y")
    x, y = page.on_screen(MIDDLE, PHOTO)
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 20.0, y + 15.0, steps=3)
    assert place_of_photo(page) == before
    page.page.mouse.up()
    if tool not in ("box", "region"):  # they end with their rectangle
        assert place_of_photo(page) == before
    for _ in range(2):  # the first one may drop a polygon
        page.page.keyboard.press("Escape")
    undo_until_it_has_no_pose(page)
    page.until(lambda: page.view()["box"] == folded)
