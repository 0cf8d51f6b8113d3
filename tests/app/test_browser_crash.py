"""In real Chromium, what a crash of the app leaves: the session is offered, the page comes back."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from poseviewer.files.photo import save_image
from poseviewer.files.state.autosave import load_autosave
from tests.app.app_process import AppProcess
from tests.app.browser import READY, AppPage
from tests.scene import Scene
from tests.textured import write_obj

OFFER = "An earlier session ended without saving"


@pytest.mark.slow
def test_after_a_crash_page_session_and_models_come_back(
    browser: Browser, tmp_path: Path, scene: Scene
):
    """The models that the photo may show come back with their textures."""
    (tmp_path / "quad").mkdir()
    write_obj(tmp_path / "quad", "wood.png")
    save_image(tmp_path / "quad" / "wood.png", np.full((8, 8, 3), (230, 30, 20), np.uint8))
    quad = [str(path) for path in sorted((tmp_path / "quad").iterdir())]
    files = (scene.photo, scene.model, "--pose", scene.start)
    with AppProcess(tmp_path, *files) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        # The photo's size comes by another way than the panel's texts, and shows the whole photo.
        tab.page.wait_for_function("window.poseviewer.view().photo[0] > 1")
        tab.page.evaluate("window.poseviewer.zoomAt(200, 300, 1.7)")
        view = tab.view()
        tab.page.keyboard.press("Shift+ArrowRight")
        open_candidates(tab)
        with tab.page.expect_file_chooser() as chooser:
            tab.page.get_by_role("button", name="Add a model").click()
        chooser.value.set_files(quad)
        tab.page.locator(".pv-models").get_by_text("quad.obj").wait_for()
        tab.until(lambda: "quad.obj" in kept_candidates(tmp_path / "state" / "sessions"))
        tab.page.evaluate("document.activeElement.blur()")
        tab.page.keyboard.press("Space")
        app.kill()
    shutil.rmtree(tmp_path / "quad")
    port = int(app.url.rstrip("/").rpartition(":")[2])
    with AppProcess(tmp_path, *files, port=port) as again:
        assert again.url == app.url
        tab.page.get_by_text(OFFER).wait_for()
        tab.page.get_by_text("no unsaved changes").wait_for(state="attached")
        tab.page.get_by_role("button", name="Open it again").click()
        tab.page.get_by_text(OFFER).wait_for(state="hidden")
        tab.page.get_by_text("● unsaved changes").wait_for(state="attached")
        tab.wait_for_text("at this pose")
        tab.until(lambda: all(tab.view()[of] == view[of] for of in ("zoom", "centre")))
        # The new server's page: what is done on it comes through, and it draws what comes back.
        picture = tab.settled_picture()
        tab.page.keyboard.press("Control+ArrowRight")
        tab.until(lambda: not np.array_equal(tab.photo_picture(), picture))
        open_candidates(tab)
        tab.page.locator(".pv-models").get_by_text("quad.obj").click()
        tab.open_step(1)
        tab.wait_for_text("2 triangles, 1 part, 1 texture")
        assert tab.errors == []
        tab.page.close()


@pytest.mark.slow
def test_an_upload_that_is_cut_off_is_one_sentence_and_nothing_is_lost(
    browser: Browser, tmp_path: Path, scene: Scene
):
    large = tmp_path / "slow.ply"
    with large.open("wb") as file:
        file.truncate(180_000_000)
    files = (scene.photo, scene.model, "--pose", scene.start)
    with AppProcess(tmp_path, *files) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        begin_upload(tab, large)
        tab.page.reload()
        assert_cut_off(tab)
        begin_upload(tab, large)
        tab.wait_for_text("Esc stops the upload")
        tab.page.keyboard.press("Escape")
        tab.page.locator("[id^=upload-]").wait_for(state="detached")
        begin_upload(tab, large)
        app.kill()
    port = int(app.url.rstrip("/").rpartition(":")[2])
    with AppProcess(tmp_path, *files, port=port):
        assert_cut_off(tab)
        assert not [path for path in (tmp_path / "state").rglob("*") if path.is_file()]
        tab.choose_file("Photo ...", scene.photo)
        tab.page.get_by_text("Uploading").wait_for(state="hidden")
        assert tab.errors == []
        tab.page.close()


def begin_upload(tab: AppPage, path: Path) -> None:
    """Drop a file, and wait until a part of it has come."""
    tab.drop_files([path])
    tab.page.wait_for_function(
        """() => {
            const bar = document.querySelector("[id^=upload-] [role=progressbar]");
            return bar && Number(bar.getAttribute("aria-valuenow")) > 0;
        }"""
    )


def assert_cut_off(tab: AppPage) -> None:
    """The page says so, once, shows no upload any more, and has what it had."""
    said = tab.page.get_by_text("slow.ply: the upload was cut off")
    said.wait_for()
    assert said.count() == 1
    tab.page.wait_for_function(READY)
    tab.page.locator("[id^=upload-]").wait_for(state="detached")
    tab.page.get_by_text("1,280 triangles").wait_for(state="attached")


def open_candidates(tab: AppPage) -> None:
    """Show the models that the photo may show."""
    tab.open_step(4)
    tab.page.get_by_text("Which model is it?", exact=True).click()


def kept_candidates(sessions: Path) -> list[str]:
    """The names of the models that an autosaved session names."""
    paths = sessions.glob("session-*.json")
    return [one.name for path in paths for one in load_autosave(path).candidates]
