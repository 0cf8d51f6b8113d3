"""Several objects in one photo, in real Chromium: added, placed, fitted, saved, opened again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator

from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import load_pose
from poseviewer.files.scene import load_scene
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture, table_texts
from tests.app.groceries import HEIGHT, SIZE, WIDTH, Groceries, make_groceries

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def groceries(tmp_path_factory: pytest.TempPathFactory) -> Groceries:
    return make_groceries(tmp_path_factory.mktemp("groceries"))


@pytest.fixture
def app(tmp_path: Path, groceries: Groceries) -> Iterator[AppProcess]:
    with AppProcess(
        tmp_path, groceries.photo, groceries.models[0], "--pose", groceries.start
    ) as process:
        yield process


@pytest.fixture
def page(browser: Browser, app: AppProcess) -> Iterator[AppPage]:
    tab = AppPage(browser, app.url)
    tab.wait_for_text("at this pose")
    yield tab
    assert tab.errors == []
    tab.page.close()


def rows(tab: AppPage) -> Locator:
    return tab.page.locator(".pv-objects tr")


def cells(tab: AppPage) -> list[list[str]]:
    """Name and verdict of every object."""
    return table_texts(rows(tab), 1, 3)


def picked(tab: AppPage) -> str:
    return tab.page.locator(".pv-objects .pv-at td:nth-child(2)").inner_text()


def add_object(tab: AppPage, path: Path) -> None:
    tab.open_step(1)
    button = tab.page.get_by_role("button", name="Add another object")
    if not button.is_visible():
        tab.page.get_by_text("Several objects", exact=True).click()
    with tab.page.expect_file_chooser() as chooser:
        button.click()
    chooser.value.set_files(str(path))
    tab.until(lambda: rows(tab).count() > 1 and picked(tab) == path.name)


def place(tab: AppPage, path: Path, truth: Pose) -> None:
    """Press where the object is, and make it about as large: as a person does."""
    mesh = load_mesh(path)
    centre = truth.project(mesh.centre)
    tab.page.mouse.click(*tab.on_screen(centre.tolist(), SIZE))
    tab.until(lambda: dict(cells(tab))[path.name] == "not searched")
    seen = truth.project(mesh.vertices)
    share = np.max(np.ptp(seen, axis=0) / (0.6 * np.array([WIDTH, HEIGHT])))
    away = centre + np.array([60.0, 0.0])
    end = centre + share * 1.04 * (away - centre)
    tab.drag(away.tolist(), end.tolist(), SIZE, keys=["Control"])


def press_on(tab: AppPage, point: Sequence[float]) -> None:
    tab.page.mouse.click(*tab.on_screen(point, SIZE))


def search(tab: AppPage, button: str = "Search (space)") -> None:
    tab.open_step(3)
    tab.page.get_by_role("button", name=button, exact=True).click()
    tab.page.get_by_role("button", name="Stop (space)").wait_for()
    tab.page.get_by_role("button", name="Keep it").wait_for()


def test_three_groceries_are_placed_fitted_saved_and_opened_again(
    page: AppPage, app: AppProcess, browser: Browser, groceries: Groceries
):
    assert rows(page).count() == 0
    names = [path.name for path in groceries.models]
    for path, truth in list(zip(groceries.models, groceries.truths, strict=True))[1:]:
        add_object(page, path)
        assert dict(cells(page))[path.name] == "not placed"
        place(page, path, truth)
    keep_picture(page, "objects_placed")
    assert [name for name, _ in cells(page)] == names
    # A press picks what is in front: the tea, where it hides the crackers.
    meshes = [load_mesh(path) for path in groceries.models]
    middles = [t.project(m.centre).tolist() for t, m in zip(groceries.truths, meshes, strict=True)]
    press_on(page, middles[2])
    page.until(lambda: picked(page) == "sugar.ply")
    press_on(page, middles[1])
    page.until(lambda: picked(page) == "tea.ply")
    search(page)
    page.until(lambda: dict(cells(page))["tea.ply"] == "found")
    search(page, "Search all")
    keep_picture(page, "objects_found")
    assert {word for _, word in cells(page)} == {"found"}
    # What is locked or hidden stays so, and undo takes all of a search of all back at once.
    page.page.keyboard.press("z")
    page.until(lambda: dict(cells(page))["crackers.ply"] == "not searched")
    page.page.keyboard.press("y")
    page.until(lambda: dict(cells(page))["crackers.ply"] == "found")
    page.saved_pose(groceries.photo.with_name("shelf.pose.json"))
    scene = groceries.photo.with_name("shelf.scene.json")
    page.until(scene.exists)
    record = load_scene(scene)
    assert [one.record.verdict.word for one in record.objects if one.record.verdict] == 3 * [
        "found"
    ]
    for one, mesh, truth in zip(record.objects, meshes, groceries.truths, strict=True):
        assert pose_error(mesh, one.record.pose, truth).percent < 2.0
    tea = load_pose(groceries.photo.with_name("shelf.pose.json"), WIDTH, HEIGHT)
    assert tea.model is not None
    assert tea.model.file == "tea.ply"
    # The scene file opens all of them, where they were.
    (app.folder / "again").mkdir()
    with AppProcess(app.folder / "again", scene) as again:
        tab = AppPage(browser, again.url)
        tab.until(lambda: rows(tab).count() == 3)
        assert cells(tab) == [[name, "found"] for name in names]
        tab.wait_for_text("at this pose")
        keep_picture(tab, "objects_again")
        assert tab.errors == []
        tab.page.close()
