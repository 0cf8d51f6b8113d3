"""A real Chromium on the real app, for tests and for the README's pictures."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--ignore-gpu-blocklist",
    "--use-gl=angle",
    "--use-angle=gl-egl",
)
PATIENCE_MS = 120_000
READY = (
    "window.__viserMutable && window.__viserMutable.cameraControl && window.poseviewer && "
    "document.documentElement.dataset.poseviewerView"
)


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Debian's Chromium, headless; a machine without one skips the test, but CI fails."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        reason = "no chromium on this machine: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield browser
        browser.close()


class AppPage:
    """One tab; places are px of the photo, pixel centres at i + 0.5."""

    def __init__(self, browser: Browser, url: str, size: tuple[int, int] = (1400, 900)) -> None:
        self.page: Page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.set_default_timeout(PATIENCE_MS)
        # Where frames take long, as without a GPU, viser draws fewer pixels: not for measuring.
        self.page.goto(f"{url}?fixedDpr=1")
        self.page.wait_for_function(READY)
        # viser says that there is no GPU, over the photo's corner: once.
        notice = self.page.get_by_text("Software WebGL rendering detected")
        if "SwiftShader" in self._graphics() or "llvmpipe" in self._graphics():
            notice.wait_for()
            self.page.locator(".mantine-Notification-closeButton").first.click()
            notice.wait_for(state="hidden")

    def _graphics(self) -> str:
        """What draws the scene."""
        return self.page.evaluate(
            """() => {
                const gl = document.createElement("canvas").getContext("webgl2");
                const names = gl && gl.getExtension("WEBGL_debug_renderer_info");
                return names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
            }"""
        )

    def view(self) -> dict[str, Any]:
        """Zoom, centre and scale, and the canvas's box, as the page has them."""
        return self.page.evaluate(
            """() => {
                const box = window.__viserMutable.canvas.getBoundingClientRect();
                return {
                    ...JSON.parse(document.documentElement.dataset.poseviewerView),
                    box: [box.left, box.top, box.width, box.height],
                };
            }"""
        )

    def on_screen(self, point: Sequence[float], photo: tuple[int, int]) -> tuple[float, float]:
        """Where a photo point lies in the window, worked out here from zoom and centre alone."""
        view = self.view()
        left, top, width, height = view["box"]
        scale = min(width / photo[0], height / photo[1]) * view["zoom"]
        centre = view["centre"]
        return (
            left + width / 2 + (point[0] - centre[0] * photo[0]) * scale,
            top + height / 2 + (point[1] - centre[1] * photo[1]) * scale,
        )

    def drag(
        self,
        start: Sequence[float],
        end: Sequence[float],
        photo: tuple[int, int],
        keys: Sequence[str] = (),
    ) -> None:
        """Press at one photo point, move to another, let go."""
        for key in keys:
            self.page.keyboard.down(key)
        self.page.mouse.move(*self.on_screen(start, photo))
        self.page.mouse.down()
        self.page.mouse.move(*self.on_screen(end, photo), steps=6)
        self.page.mouse.up()
        for key in keys:
            self.page.keyboard.up(key)

    def picture(self) -> np.ndarray:
        """The window as it looks, (height, width, 3) RGB."""
        image = Image.open(BytesIO(self.page.screenshot())).convert("RGB")
        return np.asarray(image)

    def photo_picture(self) -> np.ndarray:
        """The window as it looks, black beside the photo's part of it."""
        left, top, width, height = (int(v) for v in self.view()["box"])
        picture = np.zeros_like(whole := self.picture())
        part = slice(top, top + height), slice(left + 1, left + width - 1)
        picture[part] = whole[part]
        return picture

    def settled_picture(self) -> np.ndarray:
        """The photo's part of the window once nothing moves in it any more."""
        before = self.photo_picture()
        for _ in range(40):
            self.page.wait_for_timeout(150)
            now = self.photo_picture()
            if np.array_equal(now, before):
                return now
            before = now
        return before

    def wait_for_text(self, text: str) -> None:
        """Until the page says so."""
        self.page.get_by_text(text).first.wait_for()

    def saved_pose(self, path: Path) -> dict[str, Any]:
        """Press S, and read the pose file that appears."""
        before = path.stat().st_mtime_ns if path.exists() else 0
        self.page.keyboard.press("s")
        for _ in range(600):
            if path.exists() and path.stat().st_mtime_ns != before:
                return json.loads(path.read_text())
            self.page.wait_for_timeout(50)
        raise AssertionError(f"{path.name} was not written")


def keep_picture(tab: AppPage, name: str) -> None:
    """Where POSEVIEWER_PICTURES names a folder, the page as it looks, to be looked at."""
    folder = os.environ.get("POSEVIEWER_PICTURES")
    if folder:
        tab.page.wait_for_timeout(1500)
        tab.page.screenshot(path=str(Path(folder) / f"{name}.png"))
