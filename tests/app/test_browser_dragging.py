"""Drags in real Chromium: the cursor shows what they do, and they begin anywhere."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from tests.app.browser import AppPage
from tests.app.running_app import running_app
from tests.scene import Scene

SIZE = (160, 120)
CURSOR = "window.__viserMutable.canvas.style.cursor"


@pytest.mark.slow
def test_a_drag_begins_anywhere_and_the_cursor_shows_what_it_does(
    browser: Browser, scene: Scene, tmp_path: Path
) -> None:
    with running_app(scene, tmp_path) as running, AppPage(browser, running.url) as tab:
        tab.wait_for_text("at this pose")
        cursors = set[str]()
        for key in ("", "Shift", "Control"):
            before = running.app.session.document.pose
            if key:
                tab.page.keyboard.down(key)
            tab.page.mouse.move(*tab.on_screen((4.0, 4.0), SIZE))
            tab.page.wait_for_function(f"{CURSOR} && !{sorted(cursors)}.includes({CURSOR})")
            cursors.add(tab.page.evaluate(CURSOR))
            if key:
                tab.page.keyboard.up(key)
            tab.drag((4.0, 4.0), (10.0, 9.0), SIZE, (key,) if key else ())
            tab.until(lambda: running.app.session.drag is None)
            tab.until(lambda before=before: running.app.session.document.pose is not before)
            after = running.app.session.document.pose
            was, now = (pose.camera_from_model for pose in (before, after))
            assert np.allclose(was.rotation, now.rotation, atol=1e-3) is (not key)
        assert "grab" in cursors
        tab.open_step(2)
        tab.page.get_by_role("button", name="Fit to box").click()
        tab.page.wait_for_function(f"{CURSOR} === 'crosshair'")
