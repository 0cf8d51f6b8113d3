"""How sure a pose is, in the page: the sentence, and its region on the maps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture
from tests.scene import Scene

pytestmark = pytest.mark.slow

PHOTO = (160, 120)
MAPS = 15
REGIONS = "document.querySelectorAll('.pv-cell .pv-region').length"


@pytest.fixture
def page(browser: Browser, tmp_path: Path, scene: Scene) -> Iterator[AppPage]:
    """A small photo, searched."""
    with AppProcess(tmp_path, scene.photo, scene.model, "--pose", scene.start) as app:
        tab = AppPage(browser, app.url, (1440, 720))
        tab.wait_for_text("at this pose")
        assert tab.page.evaluate(REGIONS) == 0
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict:")
        tab.open_step(4)
        yield tab
        assert tab.errors == []
        tab.page.close()
        assert app.interrupt() == 0


def test_how_sure_it_is_is_said_and_mapped(page: AppPage) -> None:
    page.wait_for_text("How sure, if right:")
    page.until(lambda: page.page.evaluate(REGIONS) == MAPS)
    keep_picture(page, "sure")
    page.drag((86.0, 60.0), (90.0, 60.0), PHOTO)  # of the dragged pose it is not known
    page.page.get_by_text("How sure, if right:").wait_for(state="hidden")
    page.page.keyboard.press("z")
    page.wait_for_text("How sure, if right:")
