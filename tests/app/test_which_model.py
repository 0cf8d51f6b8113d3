"""Which model is it, in real Chromium: models are added, told apart, and shown by their rows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh
from playwright.sync_api import Browser, Locator

from poseviewer.app.page.comparisons import candidates_table
from poseviewer.app.state.candidates import CandidateModel, CandidateRow
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import load_pose
from poseviewer.fit.registration import LoadedModel
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture, table_texts
from tests.meshes import make_box
from tests.scene import Scene, make_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("which")


@pytest.fixture(scope="module")
def scene(folder: Path) -> Scene:
    """One of its own: poses are saved beside the photo."""
    return make_scene(folder)


@pytest.fixture(scope="module")
def others(folder: Path) -> list[Path]:
    """Two models that the scene's photo does not show."""
    paths = [folder / "box.ply", folder / "cone.ply"]
    trimesh.creation.box((1.6, 1.0, 1.2)).export(str(paths[0]))
    trimesh.creation.cone(0.8, 1.8).export(str(paths[1]))
    return paths


@pytest.fixture(scope="module")
def app(folder: Path, scene: Scene, others: list[Path]) -> Iterator[AppProcess]:
    """The app on a model that it is not; the right one is named beside it."""
    with AppProcess(folder, scene.photo, others[0], scene.model, "--pose", scene.start) as process:
        yield process


@pytest.fixture(scope="module")
def page(browser: Browser, app: AppProcess) -> Iterator[AppPage]:
    tab = AppPage(browser, app.url)
    tab.wait_for_text("at this pose")
    tab.open_step(4)
    tab.page.get_by_text("Which model is it?", exact=True).click()
    yield tab
    assert tab.errors == []
    tab.page.close()


def rows(tab: AppPage) -> Locator:
    return tab.page.locator(".pv-models tbody tr")


def cells(tab: AppPage) -> list[list[str]]:
    """Rank, name, loss and margin of every row."""
    return table_texts(rows(tab), 0, 4)


def add(tab: AppPage, path: Path) -> None:
    with tab.page.expect_file_chooser() as chooser:
        tab.page.get_by_role("button", name="Add a model").click()
    chooser.value.set_files(str(path))


@pytest.mark.slow
def test_what_cannot_be_compared_is_said_and_nothing_is_lost(
    page: AppPage, tmp_path: Path, scene: Scene
):
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"ply\nnonsense\n")
    add(page, broken)
    page.page.get_by_text("broken.ply: ").first.wait_for()
    add(page, scene.model)
    page.page.get_by_text("M.ply: is among the models already").first.wait_for()
    assert rows(page).count() == 2
    page.open_step(3)
    page.page.get_by_text("Settings", exact=True).click()
    page.page.get_by_label("Pixels").click()
    page.page.get_by_role("option", name="what the model covers").click()
    page.open_step(4)
    page.page.get_by_role("button", name="Tell them apart").click()
    page.page.get_by_text("cannot be compared").first.wait_for()
    assert rows(page).count() == 2
    page.page.keyboard.press("z")  # the pixels are as they were
    pixels = page.page.get_by_label("Pixels", exact=True)
    page.until(lambda: pixels.input_value() != "what the model covers")


@pytest.mark.slow
def test_models_are_told_apart_and_rows_show_their_fits(
    page: AppPage, app: AppProcess, scene: Scene, others: list[Path]
):
    assert cells(page) == [["", "box.ply", "", ""], ["", "m.ply", "", ""]]
    add(page, others[1])
    rows(page).nth(2).wait_for()
    page.page.get_by_role("button", name="Tell them apart").click()
    page.wait_for_text("Press a row to see its fit")
    keep_picture(page, "which_model")
    first, second, third = cells(page)
    assert first[:2] == ["1", "m.ply"]
    assert sorted([second[1], third[1]]) == ["box.ply", "cone.ply"]
    margin = float(second[2]) - float(first[2])
    assert margin > 0.1
    assert float(first[3]) == pytest.approx(margin, abs=0.002)
    # The likeliest is at hand, at the pose that was found for it.
    path = app.folder / "p.pose.json"
    page.saved_pose(path)
    record = load_pose(path, 160, 120)
    assert record.model is not None
    assert record.model.file == "m.ply"
    truth = load_pose(scene.truth, 160, 120).pose
    assert pose_error(load_mesh(scene.model), record.pose, truth).percent < 2.0
    # A row brings its model; undo leads to before all of that.
    rows(page).nth(1).click()
    page.page.locator(".pv-models .pv-at").get_by_text(second[1]).wait_for()
    page.page.keyboard.press("z")
    page.page.locator(".pv-models .pv-at").get_by_text("box.ply").wait_for()
    page.saved_pose(path)
    start = load_pose(scene.start, 160, 120).pose
    assert load_pose(path, 160, 120).pose.project([0, 0, 0]) == pytest.approx(
        start.project([0, 0, 0])
    )
    # What is taken away is gone, and the margin is to the next one that is there.
    rows(page).nth(1).locator("button").click()
    page.page.wait_for_function("document.querySelectorAll('.pv-models tbody tr').length == 2")
    assert [row[1] for row in cells(page)] == ["m.ply", third[1]]


def test_names_cannot_write_into_the_page():
    model = LoadedModel(make_box(), '<img src=x onerror=alert(1)>".ply', "0" * 64, None)
    table = candidates_table((CandidateRow(0, CandidateModel(model, None)),), "", running=False)
    assert "<img" not in table
    assert '"alert' not in table
