"""The status above the steps in real Chromium: what it says, and that nothing moves by it."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from poseviewer.app.page.panels import STEPS
from poseviewer.app.state.edits import open_document
from poseviewer.confidence.verdict import Verdict
from poseviewer.scene.types import SearchResult
from tests.app.browser import AppPage
from tests.app.running_app import RunningApp, running_app
from tests.scene import Scene

pytestmark = [pytest.mark.slow, pytest.mark.long]
HEIGHTS = """() => [...document.querySelectorAll("[role=tab], .mantine-Button-root")]
    .filter((node) => /^(Open|Place|Search|Stop|Undo)/.test(node.textContent.trim()))
    .map((node) => node.getBoundingClientRect()).filter((box) => box.width)
    .map((box) => box.top)"""
"""Heights of the tabs, of the search, and of the step's last buttons, in CSS px."""


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


def test_nothing_moves_while_a_search_begins_ends_and_is_judged(
    browser: Browser, running: RunningApp
) -> None:
    with AppPage(browser, running.url) as tab:
        tab.wait_for_text("at this pose")
        search = tab.page.get_by_role("button", name="Search (space)")
        before = tab.page.evaluate(HEIGHTS)
        assert len(before) == 4
        search.click()
        tab.page.get_by_role("button", name="Stop (space)").wait_for()
        tab.open_step(2)
        assert tab.page.evaluate(HEIGHTS) == before
        tab.wait_for_text("Verdict: found")
        assert tab.page.evaluate(HEIGHTS) == before
        tab.wait_for_text("S saves")
        for step in range(1, len(STEPS) + 1):
            tab.open_step(step)
            assert search.count() == 1
            assert tab.page.evaluate(HEIGHTS)[:3] == before[:3]
        tab.page.keyboard.press("Shift+ArrowRight")
        tab.page.locator(".pv-badge", has_text="not searched").wait_for()
        assert tab.page.evaluate(HEIGHTS)[:3] == before[:3]


def test_a_lost_pose_is_saved_with_a_word(browser: Browser, running: RunningApp) -> None:
    document = running.app.session.document
    verdict = Verdict("lost", 0.1, ("Searches from near by ended 30 % away.",))
    result = SearchResult(verdict=verdict, loss=1.0, unexplained=0.9)
    running.app._mailbox.post(open_document(document.with_object(result=result)))
    with AppPage(browser, running.url) as tab:
        tab.wait_for_text("Verdict: lost")
        tab.wait_for_text("ended 30 % away")
        tab.page.keyboard.press("s")
        tab.wait_for_text("lost: saved all the same")
