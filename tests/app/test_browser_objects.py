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
from tests.app.groceries import Groceries, make_groceries

pytestmark = pytest.mark.slow


Made = tuple[AppPage, Groceries]


def opened(browser: Browser, folder: Path, made: Groceries) -> Iterator[Made]:
    """The page of an app with the photo and its first model, at its start."""
    first = made.photo, made.models[0], "--pose", made.start
    with AppProcess(folder, *first) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        yield tab, made
        assert tab.errors == []
        tab.page.close()


@pytest.fixture
def five(browser: Browser, tmp_path: Path) -> Iterator[Made]:
    yield from opened(browser, tmp_path, make_groceries(tmp_path))


def size_of(made: Groceries) -> tuple[int, int]:
    camera = made.truths[0].camera
    return camera.width, camera.height


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
    mesh, size = load_mesh(path), (truth.camera.width, truth.camera.height)
    centre = truth.project(mesh.centre)
    tab.page.mouse.click(*tab.on_screen(centre.tolist(), size))
    tab.until(lambda: dict(cells(tab))[path.name] == "not searched")
    seen = truth.project(mesh.vertices)
    share = np.max(np.ptp(seen, axis=0) / (0.6 * np.array(size)))
    away = centre + np.array([60.0, 0.0])
    end = centre + share * 1.04 * (away - centre)
    tab.drag(away.tolist(), end.tolist(), size, keys=["Control"])


def place_others(tab: AppPage, made: Groceries) -> None:
    """Add all models but the first, and put them where they are."""
    for path, truth in list(zip(made.models, made.truths, strict=True))[1:]:
        add_object(tab, path)
        assert dict(cells(tab))[path.name] == "not placed"
        place(tab, path, truth)


def press_on(tab: AppPage, made: Groceries, index: int) -> None:
    """Press where an object's middle is in the photo."""
    middle = made.truths[index].project(load_mesh(made.models[index]).centre)
    tab.page.mouse.click(*tab.on_screen(middle.tolist(), size_of(made)))


def search(tab: AppPage, button: str = "Search (space)") -> None:
    tab.open_step(3)
    tab.page.get_by_role("button", name=button, exact=True).click()
    tab.page.get_by_role("button", name="Stop (space)").wait_for()
    tab.page.get_by_role("button", name="Keep it").wait_for()


def saved_near(tab: AppPage, made: Groceries, percents: Sequence[float]) -> Path:
    """Save; the scene file, which has each object within so much of its size."""
    tab.saved_pose(made.photo.with_suffix(".pose.json"))
    scene = made.photo.with_suffix(".scene.json")
    tab.until(scene.exists)
    objects = load_scene(scene).objects
    each = zip(objects, made.models, made.truths, percents, strict=True)
    for one, model, truth, percent in each:
        assert pose_error(load_mesh(model), one.record.pose, truth).percent < percent, one.id
        assert one.record.verdict is not None
    return scene


def opens_again(browser: Browser, folder: Path, scene: Path, words: list[list[str]]) -> None:
    """A scene file opens with all objects and their verdicts, as they were."""
    (folder / "again").mkdir()
    with AppProcess(folder / "again", scene) as again:
        tab = AppPage(browser, again.url)
        tab.until(lambda: rows(tab).count() == len(words))
        assert cells(tab) == words
        tab.wait_for_text("at this pose")
        keep_picture(tab, f"{scene.stem}_{len(words)}_again")
        assert tab.errors == []
        tab.page.close()


def test_five_objects_are_placed_fitted_saved_and_opened_again(
    five: Made, browser: Browser, tmp_path: Path
):
    page, made = five
    assert rows(page).count() == 0
    place_others(page, made)
    keep_picture(page, "objects_placed")
    assert [name for name, _ in cells(page)] == [path.name for path in made.models]
    # A press picks what is in front: the tea, where it hides the crackers.
    press_on(page, made, 2)
    page.until(lambda: picked(page) == "sugar.ply")
    press_on(page, made, 1)
    page.until(lambda: picked(page) == "tea.ply")
    search(page)
    page.until(lambda: dict(cells(page))["tea.ply"] == "found")
    search(page, "Search all")
    keep_picture(page, "objects_found")
    words = [word for _, word in cells(page)]
    assert words[:3] == ["found"] * 3
    assert words.count("found") >= 4
    # Undo takes all of a search of all back at once.
    page.page.keyboard.press("z")
    page.until(lambda: dict(cells(page))["crackers.ply"] == "not searched")
    page.page.keyboard.press("y")
    page.until(lambda: dict(cells(page))["crackers.ply"] == "found")
    scene = saved_near(page, made, [2.0] * 3 + [3.0] * 2)
    tea = load_pose(made.photo.with_suffix(".pose.json"), *size_of(made))
    assert tea.model is not None
    assert tea.model.file == "tea.ply"
    opens_again(browser, tmp_path, scene, cells(page))
