"""A sequence in real Chromium: one key, propagated both ways, mended, exported, saved, reopened."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.app.sequences import CAMERA, COUNT, MESH, true_pose, write_sequence

pytestmark = pytest.mark.slow
SIZE = (CAMERA.width, CAMERA.height)
MIDDLE = COUNT // 2
SAVED = "frames.m.scene.json"


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[AppPage]:
    frames, model, camera, start = write_sequence(tmp_path)
    options = "--calibration", camera, "--pose", start
    with (
        AppProcess(tmp_path, frames, model, *options) as app,
        AppPage(browser, app.url) as tab,
    ):
        tab.wait_for_text("at this pose")
        yield tab


def said(tab: AppPage) -> str:
    """What the time line says of the shown frame."""
    return tab.page.locator(".pv-frames + div > span").first.inner_text()


def look_at(tab: AppPage, index: int) -> None:
    """Press on a frame of the time line, and wait for it."""
    line = tab.page.locator(".pv-frames")
    box = line.bounding_box()
    assert box is not None
    line.click(position={"x": (index + 0.5) / COUNT * box["width"], "y": box["height"] / 2})
    tab.until(lambda: said(tab).startswith(f"frame {index + 1} of {COUNT}"))


def do(tab: AppPage, button: str) -> None:
    tab.page.locator(".pv-time").get_by_role("button", name=button).click()


def states(tab: AppPage) -> dict[str, int]:
    """Number of frames in each state, stale ones by themselves."""
    return tab.page.locator(".pv-frames").evaluate(
        """svg => Object.fromEntries([...svg.querySelectorAll("path[class^='pv-']:not(.pv-halo)" +
            ":not(.pv-key-at):not(.pv-here)")].map(path => [path.className.baseVal,
            path.getBBox().width]).reduce((sum, [name, width]) =>
            sum.set(name, (sum.get(name) ?? 0) + width), new Map()))"""
    )


def propagate(tab: AppPage, button: str) -> None:
    do(tab, button)
    tab.until(lambda: tab.page.get_by_role("button", name="Stop (Esc)").count() == 1)
    tab.until(lambda: "propagated" in tab.page.locator(".pv-end").inner_text())


def search(tab: AppPage) -> None:
    tab.page.keyboard.press("Space")
    tab.until(lambda: "key, found" in said(tab))


@pytest.mark.long
def test_a_sequence_is_labelled_from_one_key(page: AppPage, browser: Browser, tmp_path: Path):
    # One key, in the middle, from the pose in the first frame.
    assert said(page) == f"frame 1 of {COUNT} · 0000.png · key"
    look_at(page, MIDDLE)
    assert "no pose" in said(page)
    search(page)
    look_at(page, 0)
    do(page, "remove key")
    page.until(lambda: "no pose" in said(page))
    # Both ways; the shown frame follows.
    page.page.keyboard.press("]")
    page.until(lambda: said(page).startswith(f"frame {MIDDLE + 1} "))
    propagate(page, "to start")
    page.until(lambda: said(page).startswith("frame 1 "))
    look_at(page, MIDDLE)
    propagate(page, "to end")
    page.until(lambda: said(page).startswith(f"frame {COUNT} "))
    assert states(page) == {"pv-found": COUNT}
    # One frame is mended by hand: the poses beside it are stale until the search mends them.
    page.page.keyboard.press(",")
    page.until(lambda: said(page).startswith(f"frame {COUNT - 1} "))
    x, y = true_pose(COUNT - 2).project(MESH.centre).tolist()
    page.drag((x, y), (x + 8.0, y), SIZE)
    page.until(lambda: " key" in said(page))
    page.until(lambda: states(page).get("pv-found pv-stale") == 2)
    search(page)
    page.until(lambda: "mended" in page.page.locator(".pv-end").inner_text())
    assert states(page) == {"pv-found": COUNT}
    assert said(page).startswith(f"frame {COUNT - 1} ")
    propagate(page, "between keys")
    assert f"{COUNT - MIDDLE - 2} frames propagated" in page.page.locator(".pv-end").inner_text()
    page.until(lambda: states(page) == {"pv-found": COUNT})
    # The graph is open once it is asked for, and a press on it shows a frame.
    assert page.page.locator(".pv-motion").count() == 0
    do(page, "graph")
    page.until(lambda: page.page.locator(".pv-motion").count() == 2)
    page.page.locator(".pv-motion svg").first.click(position={"x": 2, "y": 20})
    page.until(lambda: said(page).startswith("frame 1 "))
    # A table of all frames is downloaded.
    page.open_step(5)
    page.page.get_by_label("Format", exact=True).first.click()
    page.page.get_by_role("option", name="all frames: csv").click()
    with page.page.expect_download() as download:
        page.page.get_by_role("button", name="Export as").click()
    table = Path(download.value.path()).read_text().splitlines()
    assert len(table) == 1 + COUNT
    saved = page.saved(tmp_path / SAVED)
    assert [sorted(f["poses"]) for f in saved["frames"]] == [["1"]] * COUNT
    # Another app opens what was saved.
    scene = load_scene(tmp_path / SAVED)
    for index, frame in enumerate(scene.frames):
        pose = scene.views[0].pose(frame.poses["1"].world_from_model)
        assert pose_error(MESH, pose, true_pose(index)).percent < 1.0
    with AppProcess(tmp_path, SAVED) as app, AppPage(browser, app.url) as tab:
        tab.until(lambda: states(tab) == {"pv-found": COUNT})
        assert "propagated, found" in said(tab)
