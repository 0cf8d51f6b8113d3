"""The README's pictures of the app, from the real app in a real browser.

Run from the repository's root: ``python -m assets.source.app_pictures`` (needs chromium).
"""

from __future__ import annotations

import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, open_browser

FOLDER = Path(__file__).resolve().parent.parent / "readme"
SIZE = (1500, 860)
PHOTO = (960, 720)
QUALITY = 84
SEARCHING_MS = 900
"""So long after its start a search is looked at."""


def main() -> None:
    """Make all pictures anew."""
    with (
        tempfile.TemporaryDirectory() as name,
        open_browser() as browser,
        AppProcess(Path(name)) as app,
    ):
        make_pictures(AppPage(browser, app.url, SIZE))


def make_pictures(tab: AppPage) -> None:
    """One after another, in one session."""
    tab.wait_for_text("at this pose")
    wait_for_maps(tab)
    save(tab, "app_start")
    drag_a_pin(tab)
    watch_a_search(tab)
    tab.wait_for_text("Converged")
    tab.page.wait_for_timeout(45_000)  # the maps, about the pose found
    save(tab, "app_found")
    tab.page.keyboard.press("3")
    tab.page.wait_for_timeout(2500)
    save(tab, "app_relit")
    tab.page.keyboard.press("5")
    tab.page.wait_for_timeout(2500)
    save(tab, "app_residual")
    tab.page.keyboard.press("1")
    tab.page.evaluate("window.poseviewerOpen(0, 2)")
    tab.page.wait_for_timeout(12_000)
    save(tab, "app_large_map")


def wait_for_maps(tab: AppPage) -> None:
    """Until all fifteen are there."""
    tab.page.wait_for_function("document.querySelectorAll('.pv-cell image').length === 15")
    tab.page.wait_for_timeout(4000)


def drag_a_pin(tab: AppPage) -> None:
    """The front wheel's pin in the middle of a drag, and let go back."""
    start = tab.page.evaluate(
        """() => {
            const pin = window.__viserMutable.nodePoseData["/handles/pin1"].position;
            return pin;
        }"""
    )
    unit = 10.0 / max(PHOTO) * 0.995
    pin = (start[0] / unit + PHOTO[0] / 2, start[1] / unit + PHOTO[1] / 2)
    tab.page.mouse.move(*tab.on_screen(pin, PHOTO))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.on_screen((pin[0] + 40, pin[1] + 40), PHOTO), steps=8)
    tab.page.wait_for_timeout(2000)
    save(tab, "app_pins")
    tab.page.keyboard.press("Escape")
    tab.page.mouse.up()


def watch_a_search(tab: AppPage) -> None:
    """The whole page while the search is under way."""
    tab.page.keyboard.press("r")
    tab.page.keyboard.press("Space")
    tab.page.wait_for_timeout(SEARCHING_MS)
    save(tab, "app_search")


def save(tab: AppPage, name: str) -> None:
    """A screenshot as JPEG."""
    picture = Image.open(BytesIO(tab.page.screenshot())).convert("RGB")
    picture.save(FOLDER / f"{name}.jpg", quality=QUALITY, optimize=True)


if __name__ == "__main__":
    main()
