"""A set of three photos in real Chromium: looked at, dragged, searched, saved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator

from poseviewer.files.scene_file import load_scene
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.view_sets import CAMERA, MESH, NAMES, START, TRUTH, write_views

pytestmark = pytest.mark.slow
SIZE = (CAMERA.width, CAMERA.height)
SAVED = "a.scene.json"


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[AppPage]:
    of_set, model, start = write_views(tmp_path)
    with (
        AppProcess(tmp_path, "--views", of_set, model, "--pose", start) as app,
        AppPage(browser, app.url) as tab,
    ):
        tab.wait_for_text("mean of 3 photos")
        yield tab


def photos(tab: AppPage) -> Locator:
    return tab.page.locator(".pv-photo")


def outlines(tab: AppPage) -> list[str]:
    return photos(tab).evaluate_all(
        "cells => cells.map(cell => cell.querySelector('.pv-small path')?.getAttribute('d') || '')"
    )


def said(tab: AppPage) -> list[str]:
    return photos(tab).locator(".pv-said span").all_inner_texts()


def large(tab: AppPage) -> str:
    return tab.page.locator(".pv-photo.pv-at b").inner_text()


def test_three_photos_are_looked_at_dragged_searched_and_saved(page: AppPage, tmp_path: Path):
    assert photos(page).locator("b").all_inner_texts() == list(NAMES)
    page.until(lambda: all(outlines(page)))
    page.until(lambda: all(said(page)))
    # A drag in the large photo: the others follow while the button is down.
    before = outlines(page)
    x, y = START.project(MESH.centre).tolist()
    page.page.mouse.move(*page.on_screen((x, y), SIZE))
    page.page.mouse.down()
    page.page.mouse.move(*page.on_screen((x + 12.0, y + 4.0), SIZE), steps=4)
    page.until(lambda: all(a != b for a, b in zip(before, outlines(page), strict=True)))
    page.page.mouse.up()
    page.page.keyboard.press("z")
    page.until(lambda: outlines(page) == before)
    # One is left out, and taken back.
    photos(page).nth(2).get_by_role("button").click()
    page.until(lambda: said(page)[2] == "not compared")
    page.wait_for_text("mean of 2 photos")
    page.page.keyboard.press("z")
    page.wait_for_text("mean of 3 photos")
    # Another one is the large one, and moves all.
    photos(page).nth(1).click()
    page.until(lambda: large(page) == "b.png")
    before = outlines(page)
    page.page.keyboard.press("ArrowLeft")
    page.until(lambda: outlines(page) != before)
    page.page.keyboard.press("z")
    photos(page).nth(0).click()
    page.until(lambda: large(page) == "a.png")
    page.page.keyboard.press("Space")
    page.wait_for_text("Verdict: found")
    page.until(lambda: all("found" in text for text in said(page)))
    photos(page).nth(2).click()
    page.until(lambda: large(page) == "c.png")
    page.open_step(4)
    page.wait_for_text("How sure, if right")
    page.saved(tmp_path / SAVED)
    scene = load_scene(tmp_path / SAVED)
    for index, truth in enumerate(TRUTH):
        assert pose_error(MESH, scene.pose(0, index), truth).percent < 1.0
    result = scene.objects[0].result
    assert result is not None
    assert result.verdict is not None
    assert [one.word for one in result.verdict.views] == ["found"] * 3
