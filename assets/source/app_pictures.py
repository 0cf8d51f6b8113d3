"""The README's pictures of the app, from the real app in a real browser.

Run from the repository's root: ``python -m assets.source.app_pictures`` (needs chromium). On a busy
machine it takes minutes: every picture waits until maps and overlay have settled.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, open_browser

FOLDER = Path(__file__).resolve().parent.parent / "readme"
SIZE = (1440, 720)
"""CSS px: a window in which the maps lie beside the photo by themselves."""
PHOTO = (960, 720)
QUALITY = 84
SEARCHING = 400
"""Evaluations after which a search is looked at: the population is still wide."""
SETTLED_S, LONGEST_S = 12, 150
"""What the page shows is settled when it has not changed for so long; it is waited for at most so
long."""
LOOK_MS = 6000
"""Until another look is drawn, on a busy machine."""
LONGEST_WAIT_S = 600
"""For an end of a search on a busy machine."""
SHOWN = """() => document.querySelector(".pv-dim") ? "" : [
    ...[...document.querySelectorAll(".pv-cell image")].map((map) => map.getAttribute("href")),
    document.body.innerText].join()"""
"""Maps and texts of a page; "" while the maps are about another pose."""


def main() -> None:
    """Make all pictures anew."""
    with tempfile.TemporaryDirectory() as name, open_app(Path(name), SIZE) as tab:
        make_pictures(tab)


def make_pictures(tab: AppPage) -> None:
    """One after another, in one session."""
    settle(tab)
    save(tab, "app_start")
    drag_a_pin(tab)
    watch_a_search(tab)
    tab.wait_for_text("Verdict:")
    tab.open_step(4)
    settle(tab)
    save(tab, "app_found")
    for key, name in (("3", "app_relit"), ("5", "app_residual")):
        tab.page.keyboard.press(key)
        tab.page.wait_for_timeout(LOOK_MS)
        tab.settled_picture()
        save(tab, name)
    tab.page.keyboard.press("1")
    tab.page.evaluate("window.poseviewerOpen(0, 2)")
    settle(tab)
    save(tab, "app_large_map")


@contextmanager
def open_app(
    folder: Path, size: tuple[int, int], *arguments: str | Path, maps: str = ""
) -> Iterator[AppPage]:
    """The app's page, dark and without hints, when the first loss is there; ``maps`` beside, below
    or away, else where the page puts them by itself.
    """
    kept = {"poseviewer.guide": "away"} | ({"poseviewer.maps": maps} if maps else {})
    storage = [{"name": name, "value": value} for name, value in kept.items()]
    with open_browser() as browser, AppProcess(folder, *arguments) as app:
        state = {"origins": [{"origin": app.url.rstrip("/"), "localStorage": storage}]}
        tab = AppPage(browser, app.url, size, color_scheme="dark", storage_state=state)
        tab.page.set_default_timeout(1000 * LONGEST_WAIT_S)
        tab.wait_for_text("at this pose")
        yield tab


def settle(tab: AppPage) -> None:
    """Until the page has not changed for a while, the photo's part neither."""
    before, still = "", 0
    for _ in range(LONGEST_S):
        tab.page.wait_for_timeout(1000)
        now = tab.page.evaluate(SHOWN)
        still = still + 1 if now and now == before else 0
        before = now
        if still == SETTLED_S:
            break
    tab.settled_picture()


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
    settle(tab)
    save(tab, "app_pins")
    tab.page.keyboard.press("Escape")
    tab.page.mouse.up()


def watch_a_search(tab: AppPage) -> None:
    """The whole page while the search is under way."""
    tab.open_step(3)
    tab.page.keyboard.press("r")
    settle(tab)
    tab.page.keyboard.press("Space")
    tab.page.wait_for_function(
        """least => {
            const said = document.body.innerText.match(/(\\d+) evaluations/);
            return said && Number(said[1]) >= least;
        }""",
        arg=SEARCHING,
    )
    save(tab, "app_search")


def save(tab: AppPage, name: str) -> None:
    """A screenshot as JPEG."""
    shot_of(tab).save(FOLDER / f"{name}.jpg", quality=QUALITY, optimize=True)


def shot_of(tab: AppPage) -> Image.Image:
    """What a page shows."""
    return Image.open(BytesIO(tab.page.screenshot())).convert("RGB")


if __name__ == "__main__":
    main()
