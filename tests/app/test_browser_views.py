"""A set of three photos in real Chromium: looked at, dragged, searched, saved."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator

from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.view_sets import (
    BOX,
    BOX_SYMMETRY,
    BOX_TRUTH,
    CAMERA,
    MESH,
    NAMES,
    START,
    TRUTH,
    write_two,
    write_views,
)

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


@pytest.mark.long
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
    # One photo alone may leave another pose open.
    page.until(lambda: all("found" in text or "doubtful" in text for text in said(page)))
    photos(page).nth(2).click()
    page.until(lambda: large(page) == "c.png")
    page.open_step(4)
    page.wait_for_text("How sure, if right")
    page.saved(tmp_path / "a.m.scene.json")
    scene = load_scene(tmp_path / "a.m.scene.json")
    for index, truth in enumerate(TRUTH):
        assert pose_error(MESH, scene.pose(0, index), truth).percent < 1.0
    result = scene.objects[0].result
    assert result is not None
    assert result.verdict is not None
    assert len(result.verdict.views) == 3


def lines_in(tab: AppPage) -> list[int]:
    """How many outlines each small photo has."""
    drawn = ".pv-small path:not(.pv-halo):not([d=''])"
    count = f"cells => cells.map(cell => cell.querySelectorAll(`{drawn}`).length)"
    return photos(tab).evaluate_all(count)


@pytest.mark.long
def test_two_things_in_three_photos_are_placed_in_one_fitted_in_all_saved_and_opened_again(
    browser: Browser, tmp_path: Path
):
    cameras, ball, box = write_two(tmp_path)
    with AppProcess(tmp_path, "--views", cameras, ball) as app, AppPage(browser, app.url) as tab:
        tab.wait_for_text("is not placed yet")
        tab.fit_to_box(TRUTH[0].project(MESH.vertices), SIZE)
        tab.add_object(box)
        tab.until(lambda: tab.verdicts().get("box.ply") == "not placed")
        tab.fit_to_box(BOX_TRUTH[0].project(BOX.vertices), SIZE)
        tab.until(lambda: tab.verdicts()["box.ply"] == "not searched")
        # Placed in one photo, both are drawn in all.
        tab.until(lambda: lines_in(tab) == [2, 2, 2])
        tab.open_step(3)
        tab.page.get_by_role("button", name="Search all", exact=True).click()
        tab.page.get_by_role("button", name="Keep it").wait_for()
        verdicts = tab.verdicts()
        assert verdicts["ball.ply"] == "found"
        assert verdicts["box.ply"] in ("found", "doubtful")
        # What each photo alone says, whichever it is.
        tab.until(lambda: all(re.search("found|doubtful|lost", text) for text in said(tab)))
        tab.saved(tmp_path / SAVED)
    scene = load_scene(tmp_path / SAVED)
    for view in range(3):
        assert pose_error(MESH, scene.pose(0, view), TRUTH[view]).percent < 1.0
        off = pose_error(BOX, scene.pose(1, view), BOX_TRUTH[view], BOX_SYMMETRY)
        assert off.percent < 1.5
    (tmp_path / "again").mkdir()
    with AppProcess(tmp_path / "again", tmp_path / SAVED) as app, AppPage(browser, app.url) as tab:
        tab.until(lambda: tab.verdicts() == verdicts)
        tab.until(lambda: lines_in(tab) == [2, 2, 2])
