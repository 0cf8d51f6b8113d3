"""The time line of a long sequence in real Chromium: pointer, wheel, arrows, its last frame."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, FloatRect

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.app.sequences import COUNT, write_sequence
from tests.videos import write_pictures

pytestmark = pytest.mark.slow
FRAMES = 400
STEP_S = 0.04
LONG = 2000
"""Frames of a video that takes seconds to be read."""


@pytest.fixture(scope="module")
def tab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppPage]:
    """Frames whose names are seconds, over and over the same few pictures."""
    folder = tmp_path_factory.mktemp("long")
    frames, model, camera, start = write_sequence(folder)
    pictures = [path.rename(folder / path.name) for path in sorted(frames.iterdir())]
    for index in range(FRAMES):
        shutil.copy(pictures[index % COUNT], frames / f"{STEP_S * index:.2f}.png")
    options = "--calibration", camera, "--pose", start
    with (
        AppProcess(folder, frames, model, *options) as app,
        AppPage(browser, app.url) as page,
    ):
        page.wait_for_text("at this pose")
        yield page


def box_of(tab: AppPage) -> FloatRect:
    box = tab.page.locator(".pv-frames").bounding_box()
    assert box is not None
    return box


def place(tab: AppPage, share: float) -> tuple[float, float]:
    """Place in the window of a share of the time line."""
    box = box_of(tab)
    return box["x"] + share * box["width"], box["y"] + box["height"] / 2


def shown(tab: AppPage, index: int) -> bool:
    text = tab.page.locator(".pv-frames + div > span").first.inner_text()
    return text.startswith(f"frame {index + 1} of {FRAMES}")


def tip(tab: AppPage) -> str:
    tab.page.locator(".pv-tip").wait_for()
    return tab.page.locator(".pv-tip").inner_text()


def span(tab: AppPage) -> tuple[float, float]:
    """First and last frame of the part of the time line that is seen."""
    box = tab.page.locator(".pv-frames").get_attribute("viewBox")
    assert box is not None
    left, _, width, _ = map(float, box.split())
    return left, left + width


@pytest.mark.long
def test_the_first_and_the_last_frame_can_be_pressed(tab: AppPage):
    box = box_of(tab)
    for x, index in ((box["x"] + box["width"] - 0.3, FRAMES - 1), (box["x"] + 0.3, 0)):
        tab.page.mouse.click(x, box["y"] + box["height"] / 2)
        tab.until(lambda index=index: shown(tab, index))


def test_frame_and_time_under_the_pointer_are_said(tab: AppPage):
    tab.page.mouse.move(*place(tab, 200.5 / FRAMES))
    assert tip(tab) == "frame 201 · 8.00 s"
    tab.page.mouse.move(*place(tab, 1.0 - 0.3 / FRAMES))
    assert tip(tab) == f"frame {FRAMES} · {STEP_S * (FRAMES - 1):.2f} s"
    x, y = place(tab, 0.5)
    tab.page.mouse.move(x, y - 200)
    tab.page.locator(".pv-tip").wait_for(state="hidden")


@pytest.mark.long
def test_the_wheel_zooms_at_the_pointer_and_the_shown_frame_stays_in_sight(tab: AppPage):
    tab.page.mouse.move(*place(tab, 200.5 / FRAMES))
    for _ in range(30):
        tab.page.mouse.wheel(0, -120)
    first, last = span(tab)
    assert last - first == pytest.approx(8.0)
    assert first < 200.5 < last
    assert tip(tab).startswith(("frame 200 ", "frame 201 "))  # whole px, a frame each before
    # Each frame is wide enough to be pressed, and the next one to be looked at.
    at = (202.5 - first) / (last - first)
    tab.page.mouse.click(*place(tab, at))
    tab.until(lambda: shown(tab, 202))
    assert span(tab) == (first, last)
    # Arrows step frames, with shift by ten; the part that is seen follows.
    tab.page.keyboard.press("ArrowRight")
    tab.until(lambda: shown(tab, 203))
    tab.page.keyboard.press("Shift+ArrowLeft")
    tab.until(lambda: shown(tab, 193))
    left, right = span(tab)
    assert left <= 193 < right
    assert right - left == pytest.approx(8.0)
    # A wheel turned sidewise moves it; turned back, all is seen again.
    tab.page.mouse.move(*place(tab, 0.5))
    tab.page.mouse.wheel(100, 0)
    assert span(tab)[0] > left
    for _ in range(30):
        tab.page.mouse.wheel(0, 120)
    assert span(tab) == (0.0, FRAMES)


def test_arrows_move_the_model_with_alt_alone(tab: AppPage):
    def key_frames() -> int:
        return (tab.page.locator(".pv-key-at").get_attribute("d") or "").count("M")

    tab.page.keyboard.press("ArrowRight")
    tab.page.keyboard.press("ArrowUp")
    tab.until(lambda: shown(tab, 0))
    tab.page.keyboard.press("ArrowRight")
    tab.until(lambda: shown(tab, 1))
    assert key_frames() == 1
    tab.page.keyboard.press("Alt+ArrowRight")
    tab.until(lambda: key_frames() == 2)
    assert shown(tab, 1)
    tab.page.keyboard.press("z")
    tab.until(lambda: key_frames() == 1)


@pytest.mark.long
def test_while_poses_are_propagated_keys_leave_the_model_and_progress_is_said(tab: AppPage):
    tab.page.keyboard.press("ArrowUp")
    tab.until(lambda: shown(tab, 0))
    tab.page.locator(".pv-time").get_by_role("button", name="to end").click()
    tab.until(lambda: " a second, " in tab.page.locator(".pv-end").inner_text())
    text = tab.page.locator(".pv-end").inner_text()
    assert text.startswith("propagating: frame ")
    assert f" of {FRAMES - 1}, " in text
    assert text.endswith(" left")
    tab.page.keyboard.press("j")
    tab.wait_for_text("Poses are being propagated")
    assert tab.page.get_by_role("button", name="Stop (Esc)").count() == 1
    tab.page.keyboard.press("Space")
    tab.until(lambda: "stopped by you" in tab.page.locator(".pv-end").inner_text())
    tab.page.keyboard.press("z")


@pytest.mark.long
def test_a_long_video_is_asked_about_read_with_progress_and_stopped(
    browser: Browser, tmp_path: Path
):
    shades = np.linspace(20, 220, 640).astype(np.uint8)
    picture = np.ascontiguousarray(np.broadcast_to(shades[:, None], (480, 640, 3)))
    video = write_pictures(tmp_path / "clip.mp4", [picture] * LONG)
    with AppProcess(tmp_path) as app, AppPage(browser, app.url) as page:
        page.wait_for_text("at this pose")  # the demo
        page.drop_files([video])
        dialog = page.page.get_by_role("dialog")
        dialog.get_by_text(f"{LONG:,} frames", exact=True).wait_for()
        dialog.get_by_role("button", name="Open").click()
        page.wait_for_text(f" of {LONG:,}, ")
        page.wait_for_text(" left")
        assert page.page.locator(".pv-time").count() == 0
        page.page.get_by_role("button", name="Stop (Esc)").click()
        page.until(lambda: page.page.get_by_role("alert").count() == 0)
        # Of every 500th frame the reading is soon over.
        page.drop_files([video])
        every = dialog.get_by_label("Every N-th frame")
        every.fill("500")
        every.press("Enter")
        dialog.get_by_text("4 frames", exact=True).wait_for()
        dialog.get_by_role("button", name="Open").click()
        page.page.locator(".pv-time").get_by_text(" of 4 ").first.wait_for()
