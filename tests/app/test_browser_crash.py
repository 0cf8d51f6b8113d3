"""A crash of the app in real Chromium: the session is offered, the page comes back."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import Scene

OFFER = "An earlier session ended without saving"


@pytest.mark.slow
@pytest.mark.long
def test_after_a_crash_page_and_session_come_back(browser: Browser, tmp_path: Path, scene: Scene):
    files = (scene.photo, scene.model, "--pose", scene.start)
    with AppProcess(tmp_path, *files) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        tab.page.keyboard.press("Shift+ArrowRight")
        tab.until(lambda: any((tmp_path / "state" / "sessions").glob("*.json")))
        tab.page.evaluate("document.activeElement.blur()")
        tab.page.keyboard.press("Space")
        app.kill()
        tab.wait_for_text("Your work is kept")
    port = int(app.url.partition("/?")[0].rpartition(":")[2])
    with AppProcess(tmp_path, *files, port=port) as again, tab:
        with tab.page.expect_popup() as later:  # as the new app has the browser open it
            tab.page.evaluate(f"open({again.url!r})")
        tab.page.wait_for_url(again.url)
        later.value.close()
        tab.page.get_by_text("Your work is kept").wait_for(state="hidden")
        tab.page.get_by_text(OFFER).wait_for()
        assert tab.page.get_by_role("dialog").count() == 0
        tab.page.keyboard.press("Shift+ArrowRight")  # what is open can be worked on
        tab.page.get_by_role("button", name="Undo").click()
        tab.page.get_by_role("button", name="Open it again").click()
        tab.page.get_by_text(OFFER).wait_for(state="hidden")
        tab.open_step(5)
        tab.page.get_by_text("● unsaved changes").wait_for()
        tab.wait_for_text("at this pose")
        # The new server's page: what is done on it comes through, and it draws what comes back.
        picture = tab.settled_picture()
        tab.page.keyboard.press("Control+ArrowRight")
        tab.until(lambda: not np.array_equal(tab.photo_picture(), picture))
