"""A real Chromium on the real app, for tests and for the README's pictures."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Error, Page, sync_playwright

from poseviewer.app.page.panels import STEPS

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
    "--disable-gpu-rasterization",
)
WINDOW = (1120, 700)
"""Little more than the page has another layout for: without a GPU each pixel takes time."""
COARSE = 0.25
"""Pixels of the photo's canvas to one of the page, where no test looks at colours."""
PATIENCE_MS = 300_000
"""Longest wait: a search takes minutes on slow cores that other tests share."""
READY = """window.__viserMutable?.cameraControl && window.poseviewer &&
    document.documentElement.dataset.poseviewerView &&
    document.documentElement.classList.contains("pv-ready") &&
    [...document.querySelectorAll("[role=tab][aria-selected=true]")]
        .some((tab) => tab.textContent === "Place")"""

COUNT_DROPS = "() => { window.drops = 0; addEventListener('drop', () => window.drops++, true); }"
TWO_FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
LOOK_AGAIN_MS = 50


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
    """One tab, without errors at its end; places are px of the photo, pixel centres at i + 0.5."""

    def __init__(
        self,
        browser: Browser,
        url: str,
        size: tuple[int, int] = WINDOW,
        before: str = "",
        pixel_ratio: float = COARSE,
        **options: Any,
    ) -> None:
        """``before``: a script that runs first; ``options``: playwright's ``new_page`` has them."""
        viewport: Any = {"width": size[0], "height": size[1]}
        self.page: Page = browser.new_page(viewport=viewport, **options)
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.set_default_timeout(PATIENCE_MS)
        self.page.add_init_script(f"({COUNT_DROPS})(); {before}")
        # Else viser draws fewer pixels where frames take long, as without a GPU.
        self.page.goto(f"{url}&fixedDpr={pixel_ratio}")
        self.page.wait_for_function(READY)

    def reload(self) -> None:
        """Load the page anew."""
        self.page.reload()
        self.page.wait_for_function(READY)

    def __enter__(self) -> AppPage:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if error is None:
            assert self.errors == []
        self.page.close()

    def view(self) -> dict[str, Any]:
        """Zoom, centre and scale, and the canvas's box."""
        return self.page.evaluate(
            """() => {
                const box = window.__viserMutable.canvas.getBoundingClientRect();
                const view = JSON.parse(document.documentElement.dataset.poseviewerView);
                return { ...view, box: [box.left, box.top, box.width, box.height] };
            }"""
        )

    def on_screen(self, point: Sequence[float], photo: tuple[int, int]) -> tuple[float, float]:
        """Place of a photo point in the window, worked out here from zoom and centre alone."""
        view = self.view()
        left, top, width, height = view["box"]
        scale = min(width / photo[0], height / photo[1]) * view["zoom"]
        centre = view["centre"]
        return (
            left + width / 2 + (point[0] - centre[0] * photo[0]) * scale,
            top + height / 2 + (point[1] - centre[1] * photo[1]) * scale,
        )

    def open_step(self, number: int) -> None:
        """Open a step of the left panel, once it is there."""
        tab = self.page.get_by_role("tab", name=list(STEPS)[number - 1], exact=True)
        self.until(lambda: tab.click() or tab.get_attribute("aria-selected") == "true")

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

    def photo_picture(
        self, around: Sequence[float] | None = None, reach: float = 0.0
    ) -> np.ndarray:
        """(height, width, 3) RGB: the window as it looks, black beside the photo's part of it, and
        farther than ``reach`` px from a place in the window.
        """
        size = self.page.viewport_size
        assert size is not None
        left, top, width, height = (int(v) for v in self.view()["box"])
        left, right, bottom = left + 1, left + width - 1, top + height
        if around is not None:
            left, right = max(left, int(around[0] - reach)), min(right, int(around[0] + reach))
            top, bottom = max(top, int(around[1] - reach)), min(bottom, int(around[1] + reach))
        clip = {"x": left, "y": top, "width": right - left, "height": bottom - top}
        shot = Image.open(BytesIO(self.page.screenshot(clip=clip)))  # pyright: ignore
        picture = np.zeros((size["height"], size["width"], 3), np.uint8)
        picture[top:bottom, left:right] = np.asarray(shot.convert("RGB"))
        return picture

    def settled_picture(
        self, around: Sequence[float] | None = None, reach: float = 0.0
    ) -> np.ndarray:
        """The photo's part of the window once nothing moves in it any more."""
        self.page.evaluate(TWO_FRAMES)
        before = self.photo_picture(around, reach)
        for _ in range(60):
            self.page.wait_for_timeout(100)
            now = self.photo_picture(around, reach)
            if np.array_equal(now, before):
                return now
            before = now
        return before

    def verdicts(self) -> dict[str, str]:
        """The verdict of every object in the list, by its name."""
        cells = "rows => rows.map(row => [...row.cells].slice(1, 3).map(cell => cell.textContent))"
        return dict(self.page.locator(".pv-objects tr").evaluate_all(cells))

    def wait_for_text(self, text: str) -> None:
        """Until the page says so where it is seen: a step that is closed may say so as well."""
        try:
            self.page.get_by_text(text).filter(visible=True).first.wait_for()
        except Error:
            notices = self.page.get_by_role("alert").all_inner_texts()
            words = " ".join(self.page.inner_text("body").split())[:500]
            message = f"no {text!r} on the page; its notices: {notices}; it says: {words}"
            raise AssertionError(message) from None

    def until(self, predicate: Callable[[], Any]) -> None:
        """Until something is true, asked again and again."""
        for _ in range(PATIENCE_MS // LOOK_AGAIN_MS):
            if predicate():
                return
            self.page.wait_for_timeout(LOOK_AGAIN_MS)
        raise AssertionError("in vain")

    def drop_files(self, paths: Sequence[Path]) -> None:
        """Drop files and folders of the disk, in this order, as a hand drops them.

        A busy browser may let a drag go before its drop: then it is dropped again.
        """
        before = self.page.evaluate("window.drops")
        for _ in range(5):
            self._drop([str(path) for path in paths])
            if self.page.evaluate(f"{TWO_FRAMES}.then(() => window.drops)") > before:
                return
        raise AssertionError(f"the browser hands no drop of {paths} to the page")

    def hold_files(self, paths: Sequence[Path], *kinds: str) -> None:
        """Drag files over the page by events of these kinds, without a drop."""
        self._drop([str(path) for path in paths], kinds)

    def _drop(
        self, paths: Sequence[str], kinds: Sequence[str] = ("dragEnter", "dragOver", "drop")
    ) -> None:
        session = self.page.context.new_cdp_session(self.page)
        left, top, width, height = self.view()["box"]
        data = {"items": [], "files": paths, "dragOperationsMask": 1}
        for kind in kinds:
            session.send(
                "Input.dispatchDragEvent",
                {"type": kind, "x": left + width / 2, "y": top + height / 2, "data": data},
            )
        session.detach()

    def choose_file(self, button: str, path: Path) -> None:
        """Give a file to an upload button."""
        self.open_step(1)
        with self.page.expect_file_chooser() as chooser:
            self.page.get_by_role("button", name=button).click()
        chooser.value.set_files(str(path))

    def fit_to_box(self, shown: np.ndarray, photo: tuple[int, int]) -> None:
        """Draw a box about points (n, 2) of the photo, and start from what is proposed there."""
        self.open_step(2)
        self.page.get_by_role("button", name="Fit to box").click()
        self.wait_for_text("drag a rectangle about the object")
        self.drag(shown.min(axis=0) - 4.0, shown.max(axis=0) + 4.0, photo)
        self.wait_for_text("proposal 1 of")

    def add_object(self, path: Path) -> None:
        """Add a model as a further object."""
        self.open_step(1)
        button = self.page.get_by_role("button", name="Add another object")
        if not button.is_visible():
            self.page.get_by_text("Several objects", exact=True).click()
        self.choose_file("Add another object", path)

    def saved(self, path: Path) -> dict[str, Any]:
        """Press S, and read the file that appears."""
        before = path.stat().st_mtime_ns if path.exists() else 0
        self.page.keyboard.press("s")
        self.until(lambda: path.exists() and path.stat().st_mtime_ns != before)
        return json.loads(path.read_text())
