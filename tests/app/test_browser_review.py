"""A review in real Chromium: the list of rows, verdicts, a corrected pose."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from poseviewer.batch.run import open_batch
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.batches import fit_all, write_table
from tests.scene import Scene

pytestmark = pytest.mark.slow


@pytest.mark.long
def test_rows_are_accepted_rejected_corrected_and_noted(
    browser: Browser, tmp_path: Path, scene: Scene
) -> None:
    table, out = write_table(scene, tmp_path, 3), tmp_path / "out"
    fit_all(open_batch(table, out, FitSettings(limits=Limits(10, 600.0))))
    with AppProcess(tmp_path, "review", out) as app, AppPage(browser, app.url) as tab:
        is_open = tab.page.locator(".pv-rows .pv-at")
        note = tab.page.locator("input.mantine-TextInput-input").filter(visible=True).first
        tab.wait_for_text("3 rows, 0 accepted, 0 rejected")
        tab.wait_for_text("at this pose")
        assert tab.page.locator(".pv-rows img[src^='data:image/jpeg']").count() == 3
        first = is_open.inner_text()
        tab.page.keyboard.press("a")
        tab.wait_for_text("3 rows, 1 accepted, 0 rejected")
        tab.until(lambda: is_open.inner_text() != first)
        note.fill("blurred")
        note.press("Enter")
        tab.page.evaluate("document.activeElement.blur()")
        tab.page.keyboard.press("ArrowRight")
        tab.wait_for_text("● pose changed")
        tab.page.keyboard.press("n")
        tab.wait_for_text("The pose is changed: accept it (A)")
        tab.page.get_by_role("button", name="Accept (A)").click()
        tab.wait_for_text("3 rows, 2 accepted, 0 rejected")
        tab.page.get_by_text("pose changed").wait_for(state="hidden")
        tab.until(lambda: note.input_value() == "")
        tab.page.keyboard.press("x")
        tab.wait_for_text("3 rows, 2 accepted, 1 rejected")
        tab.page.locator(".pv-rows > div").first.click()
        tab.until(lambda: is_open.inner_text().split("\n")[0] == first.split("\n")[0])
        assert app.interrupt() == 0
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "2 accepted and 1 rejected" in report
    assert "<q>blurred</q>" in report
