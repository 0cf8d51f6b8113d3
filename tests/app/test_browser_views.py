"""A set of three photos in real Chromium: looked at, dragged, searched, saved, opened again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator

from poseviewer.files.pose import load_pose
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture
from tests.view_sets import CAMERA, MESH, NAMES, START, TRUTH, write_views

pytestmark = pytest.mark.slow
SIZE = (CAMERA.width, CAMERA.height)
SAVED = "a.pose.json"


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[AppPage]:
    of_set, model, start = write_views(tmp_path)
    with AppProcess(tmp_path, "--views", of_set, model, "--pose", start) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("mean of 3 photos")
        yield tab
        assert tab.errors == []
        tab.page.close()


def photos(tab: AppPage) -> Locator:
    return tab.page.locator(".pv-photo")


def outlines(tab: AppPage) -> list[str]:
    return photos(tab).evaluate_all(
        "cells => cells.map(cell => cell.querySelector('path').getAttribute('d') || '')"
    )


def said(tab: AppPage) -> list[str]:
    return photos(tab).locator(".pv-said span").all_inner_texts()


def large(tab: AppPage) -> str:
    return tab.page.locator(".pv-photo.pv-at b").inner_text()


def test_three_photos_are_looked_at_dragged_searched_saved_and_opened_again(
    page: AppPage, browser: Browser, tmp_path: Path
):
    assert photos(page).locator("b").all_inner_texts() == list(NAMES)
    page.until(lambda: all(outlines(page)))
    page.until(lambda: all(said(page)))
    keep_picture(page, "views_start")
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
    keep_picture(page, "views_found")
    photos(page).nth(2).click()
    page.until(lambda: large(page) == "c.png")
    page.open_step(4)
    page.wait_for_text("How sure, if right")
    keep_picture(page, "views_other")
    page.saved_pose(tmp_path / SAVED)
    found = load_pose(tmp_path / SAVED, *SIZE)
    assert found.photo is not None
    assert found.photo.file == "a.png"
    assert pose_error(MESH, found.pose, TRUTH[0]).percent < 1.0
    data = json.loads((tmp_path / SAVED).read_text())
    assert [one["verdict"]["word"] for one in data["set"]["views"]] == ["found"] * 3
    # Undo leads back to before the search.
    page.page.keyboard.press("z")
    page.until(lambda: not any("found" in text for text in said(page)))
    again = tmp_path / "again"
    again.mkdir()
    files = tmp_path / "set.json", tmp_path / "m.ply"
    with AppProcess(again, "--views", *files, "--pose", tmp_path / SAVED) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("mean of 3 photos")
        tab.until(lambda: len(said(tab)) == 3 and all(said(tab)))
        losses = np.array([float(text) for text in said(tab)])
        assert np.all(losses < 0.35)
        assert tab.errors == []
        tab.page.close()
