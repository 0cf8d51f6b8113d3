"""A model without a pose is looked for as soon as it is opened, until somebody places it; what is
found by an assumed focal length; its maps, and the sheet that is saved of them.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from playwright.sync_api import Browser

from poseviewer.app.app import App
from poseviewer.app.workers.maps import is_fine
from poseviewer.figures.landscape_sheet import INK, figure_bytes
from tests.app.browser import AppPage
from tests.app.running_app import RunningApp, running_app
from tests.two_boxes import CAMERA, make_two, off

pytestmark = pytest.mark.slow
SIZE = (640, 480)
LOOKING = "Looking for the object"
SHEET = "Sheet (PNG)"


def has_maps(app: App, fine: bool = False) -> bool:
    """Whether the page has maps about the pose that it shows, perhaps the finest ones."""
    now, maps = app.session, app.session.results.landscapes
    return bool(maps) and all(
        own.document.pose is now.document.pose and (is_fine(own) or not fine) for own in maps
    )


def is_written(text: str, size: float, sheet: NDArray[np.uint8], upwards: bool = False) -> bool:
    """Whether a sheet shows a text, at any part of a pixel."""
    scores = []
    for part in np.arange(4) / 4.0 / 300.0:
        figure = Figure(figsize=(2.0, 2.0), facecolor="white")
        at = (0.5, 0.5 + part) if upwards else (0.5 + part, 0.5)
        figure.text(*at, text, fontsize=size, color=INK, rotation=90.0 * upwards)
        drawn = grey_of(figure_bytes(figure))
        rows, columns = np.nonzero(drawn < 255)
        drawn = drawn[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        scores.append(float(cv2.matchTemplate(sheet, drawn, cv2.TM_CCOEFF_NORMED).max()))
    return max(scores) > 0.75  # another text has up to 0.63


def grey_of(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE))


def assert_assumed_focal_length_is_said(tab: AppPage, focal: float) -> None:
    condition = f"if {focal:,.0f} px is right"
    result = tab.page.locator(".pv-result")
    tab.until(lambda: f"all ± hold {condition}" in result.inner_text())
    text = result.inner_text()
    assert "assumed*" in text
    assert re.search(r"\bZ\s+[\d.]+ ± [\d.]+ ", text)
    tab.wait_for_text("before you save")
    tab.page.get_by_role("button", name="Find the focal length").wait_for()
    tab.open_step(4)
    tab.wait_for_text(f"if the assumed focal length of {focal:,.0f} px is right")
    tab.wait_for_text("Z ±")
    assert re.search(r"Z ±[\d.]+ units", tab.page.inner_text("body"))


def assert_sheet_has_the_pages_words(tab: AppPage, running: RunningApp) -> None:
    """The saved sheet has the names, the path and the 90 % region of the page's maps."""
    tab.until(lambda: has_maps(running.app, fine=True))
    words = {kind: tab.page.locator(f".pv-{kind}").all_inner_texts() for kind in ("col", "row")}
    assert [*map(len, words.values())] == [5, 5]
    key = tab.page.locator(".pv-marks span").all_inner_texts()
    tab.page.get_by_text("Save the maps", exact=True).click()
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name=SHEET).click()
    sheet = grey_of(download.value.path().read_bytes())
    for kind, names in words.items():
        for name in names:
            assert is_written(name, 9.0, sheet, kind == "row"), name
    for mark in ("90 % region", "search path"):
        assert mark in key
        assert is_written(mark, 8.0, sheet), mark
    assert not is_written("ψy", 9.0, sheet)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[RunningApp]:
    """The app on two printed boxes and their model, without a pose."""
    with running_app(make_two(tmp_path), tmp_path, has_start=False) as app:
        yield app


@pytest.mark.long
def test_a_press_ends_it_and_what_it_placed_stays(browser: Browser, running: RunningApp):
    app = running.app
    with AppPage(browser, running.url) as tab:
        tab.wait_for_text(LOOKING)
        assert "/model/outline" not in app._page.scene._nodes  # it is nowhere yet
        tab.page.mouse.click(*tab.on_screen((120.0, 400.0), SIZE))
        tab.page.get_by_text(LOOKING).first.wait_for(state="hidden")
        placed = app.session.document
        assert placed.object.is_placed
        assert placed.pose.project(placed.mesh.centre) == pytest.approx((120.0, 400.0), abs=2.0)
        app._proposer._thread.submit(int).result(60.0)  # what was under way is over
        tab.wait_for_text("at this pose")
        assert app.session.document is placed
        # While the model is dragged its maps are coarse: they are not saved.
        tab.page.get_by_text("Save the maps", exact=True).click()
        tab.page.mouse.move(*tab.on_screen((120.0, 400.0), SIZE))
        tab.page.mouse.down()
        tab.page.mouse.move(*tab.on_screen((140.0, 390.0), SIZE), steps=3)
        tab.until(lambda: app.session.is_moving and has_maps(app) and not has_maps(app, True))
        tab.page.get_by_role("button", name=SHEET).evaluate("button => button.click()")
        tab.wait_for_text("the maps are still coarse")
        tab.page.mouse.up()


@pytest.mark.long
def test_what_is_found_is_placed_and_taken_back_in_one_step(browser: Browser, running: RunningApp):
    with AppPage(browser, running.url) as tab:
        tab.wait_for_text("Verdict: found")
        tab.wait_for_text("of 2: fitted")
        assert off(running.app.session.document.pose) < 2.0
        assert_assumed_focal_length_is_said(tab, CAMERA.fx)
        assert_sheet_has_the_pages_words(tab, running)
        tab.open_step(2)
        tab.page.keyboard.press("z")
        tab.wait_for_text("press a picture at the left")
        assert not running.app.session.document.object.is_placed
        tab.page.locator(".pv-starts button").nth(1).click()
        tab.wait_for_text("proposal 2 of 2")
