"""The first start on a machine: the page is there while the kernels are compiled for it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
import pytest
from playwright.sync_api import Browser

from poseviewer.render.software.kernel import kernels_folder
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture
from tests.app.socket_page import PHOTO, SocketPage

pytestmark = pytest.mark.slow

DEMO_PHOTO, WORLD_PX = (960, 720), 96.0
SHIFT = np.array([40.0, -15.0])
COMPILING = "Compiling, this once"
EVALUATIONS = 100
WAITING = "Waiting to begin"
COMPILED_S = 900.0
MISSING = "sums.structure_sums"
"""The kernel that is left to compile: for one the page is what it is for all, and sooner done."""


def middle_of(outline: np.ndarray) -> np.ndarray:
    """(2,): of an outline's box, in px from the photo's middle."""
    points = outline.reshape(-1, 3)[:, :2]
    return (points.min(axis=0) + points.max(axis=0)) / 2.0 * WORLD_PX


@contextmanager
def held(app: AppProcess, page: SocketPage) -> Iterator[None]:
    """The process that compiles stands still: on a fast machine, too, the page can be looked at."""
    page.wait_until(lambda: compilers(app))
    (compiler,) = compilers(app)
    compiler.suspend()
    try:
        yield
    finally:
        compiler.resume()


def compilers(app: AppProcess) -> list[psutil.Process]:
    """The app's processes that compile what is missing."""
    children = psutil.Process(app.pid).children()
    return [child for child in children if "compile_sums" in command_line(child)]


def command_line(process: psutil.Process) -> str:
    """Of a process, "" of one that has ended."""
    with suppress(psutil.Error):
        return " ".join(process.cmdline())
    return ""


def test_a_page_is_of_use_while_kernels_are_compiled(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept, cache = kernels_folder(), tmp_path / "cache"
    shutil.copytree(kept, cache / kept.name, ignore=shutil.ignore_patterns(f"{MISSING}-*"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    with AppProcess(tmp_path) as app, SocketPage(app.url) as shown:
        with held(app, shown):
            tab = AppPage(browser, app.url)
            page = tab.page
            tab.wait_for_text(COMPILING)
            shown.wait_until(lambda: shown.is_shown(PHOTO) and len(shown.outline()))
            shown.set("Most evaluations", EVALUATIONS)
            page.keyboard.press("Space")
            tab.wait_for_text(WAITING)
            page.keyboard.press("Space")
            page.get_by_text(WAITING).wait_for(state="hidden")
            keep_picture(tab, "compiling")
            before = middle_of(shown.outline())
            start = before + np.array(DEMO_PHOTO) / 2.0
            tab.drag(tuple(start), tuple(start + SHIFT), DEMO_PHOTO)
            shown.wait_until(
                lambda: np.allclose(middle_of(shown.outline()) - before, SHIFT, rtol=0.1, atol=2.0)
            )
            page.keyboard.press("r")
            page.keyboard.press("Space")
            tab.wait_for_text(WAITING)
            assert page.get_by_text(COMPILING).is_visible()
            assert not shown.maps()
        shown.wait_until(lambda: "Keep it" in shown.labels(), COMPILED_S)
        assert not page.get_by_text(COMPILING).is_visible()
        shown.wait_until(lambda: shown.maps() == 15)
        assert tab.errors == []
        assert app.interrupt() == 0
