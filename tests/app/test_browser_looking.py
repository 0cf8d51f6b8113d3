"""A model without a pose is looked for as soon as it is opened, until somebody places it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.app.browser import AppPage
from tests.app.running_app import RunningApp, running_app
from tests.two_boxes import make_two, off

pytestmark = pytest.mark.slow
SIZE = (640, 480)
LOOKING = "Looking for the object"


@pytest.fixture
def running(tmp_path: Path) -> Iterator[RunningApp]:
    """The app on two printed boxes and their model, without a pose."""
    with running_app(make_two(tmp_path), tmp_path, has_start=False) as app:
        yield app


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


def test_what_is_found_is_placed_and_taken_back_in_one_step(browser: Browser, running: RunningApp):
    with AppPage(browser, running.url) as tab:
        tab.wait_for_text("Verdict: found")
        tab.wait_for_text("of 2: fitted")
        assert off(running.app.session.document.pose) < 2.0
        tab.page.keyboard.press("z")
        tab.wait_for_text("press a picture at the left")
        assert not running.app.session.document.object.is_placed
        tab.page.locator(".pv-starts button").nth(1).click()
        tab.wait_for_text("proposal 2 of 2")
