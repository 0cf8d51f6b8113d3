"""A film of a table in real Chromium: cameras found, two things placed once, sent as a data set."""

import json
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from playwright.sync_api import Browser

from poseviewer.files.formats.bop import load_bop_images
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.transform import Similarity
from poseviewer.opening.photo_sets import load_views
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.meshes import make_box
from tests.several import save_model
from tests.still_scene import CAMERA, MARKER, MARKERS, arc, write_pictures

pytestmark = [pytest.mark.slow, pytest.mark.long]
COUNT = 14
CAMERAS = arc(COUNT)
SIZE = (CAMERA.width, CAMERA.height)
CENTRES = {"low.ply": (0.05, -0.12, 0.04), "high.ply": (0.14, 0.12, 0.09)}
"""Of two boxes in the world, m."""


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[AppPage]:
    write_pictures(tmp_path / "film", CAMERAS, MARKERS)
    save_model(tmp_path / "low.ply", make_box((0.2, 0.08, 0.08)))
    save_model(tmp_path / "high.ply", make_box((0.12, 0.12, 0.18)))
    files = tmp_path / "film", tmp_path / "low.ply"
    with AppProcess(tmp_path, *files) as app, AppPage(browser, app.url) as tab:
        tab.until(lambda: said(tab).startswith(f"frame 1 of {COUNT}"))
        yield tab


def said(tab: AppPage) -> str:
    line = tab.page.locator(".pv-frames + div > span")
    return line.first.inner_text() if line.count() else ""


def place(tab: AppPage, name: str, view: int) -> None:
    """Press where a box is seen in a view."""
    centre = CAMERA.project(CAMERAS[view].apply(np.array(CENTRES[name])))
    tab.page.mouse.click(*tab.on_screen(centre.tolist(), SIZE))


def test_a_film_of_a_table_becomes_a_data_set(page: AppPage, tmp_path: Path):
    # What is placed in the shown frame stays there.
    page.page.keyboard.press("Escape")
    place(page, "low.ply", 0)
    page.until(lambda: "key" in said(page))
    page.page.get_by_role("button", name="it stands still").click()
    page.page.get_by_label("Markers' side").first.fill(f"{MARKER}")
    page.page.get_by_label("Markers' side").first.blur()
    page.page.get_by_label("Cameras by").first.click()
    page.page.get_by_role("option", name="markers (ArUco, AprilTag)").click()
    page.page.get_by_role("button", name="Find the cameras").click()
    page.wait_for_text(f"{COUNT} of {COUNT} pictures have cameras, by markers")
    page.until(lambda: said(page).startswith(f"photo 1 of {COUNT} · 0000.png"))
    # Undo brings the sequence back, and the views again.
    page.page.keyboard.press("z")
    page.until(lambda: said(page).startswith("frame 1 "))
    page.page.get_by_role("button", name="it stands still").click()
    assert page.page.get_by_label("Markers' side").first.input_value() == f"{MARKER}"
    assert page.page.get_by_label("Cameras by").first.input_value() == "markers (ArUco, AprilTag)"
    page.page.get_by_role("button", name="Close").click()
    page.until(lambda: not page.page.get_by_label("Markers' side").count())
    page.page.keyboard.press("y")
    page.until(lambda: said(page).startswith("photo 1 "))
    # Another thing is placed in another photo, once for all.
    for number in (2, 3):
        page.page.keyboard.press(".")
        page.until(lambda number=number: said(page).startswith(f"photo {number} "))
    page.add_object(tmp_path / "high.ply")
    page.until(lambda: page.verdicts().get("high.ply") == "not placed")
    place(page, "high.ply", 2)
    page.until(lambda: page.verdicts()["high.ply"] == "not searched")
    page.open_step(5)
    page.page.get_by_label("Format", exact=True).first.click()
    page.page.get_by_role("option", name="bop", exact=True).click()
    page.page.get_by_role("button", name="Export as").click()
    page.wait_for_text("Numbers in BOP")
    with page.page.expect_download() as download:
        page.page.get_by_role("button", name="Export", exact=True).click()
    ZipFile(download.value.path()).extractall(tmp_path / "out")
    page.page.keyboard.press("s")
    page.until(lambda: list(tmp_path.glob("*.scene.json")))
    (saved,) = tmp_path.glob("*.scene.json")
    page.until(lambda: json.loads(saved.read_text()))
    scene = load_scene(saved)
    folder = next((tmp_path / "out").rglob("scene_gt.json")).parent
    images, views = load_bop_images(folder), load_views(folder).views
    assert [image.number for image in images] == list(range(COUNT))
    for index, (image, view) in enumerate(zip(images, views, strict=True)):
        for number, item in enumerate(image.objects):
            ours = scene.pose(number, index).camera_from_model
            np.testing.assert_allclose(item.camera_from_model.rotation, ours.rotation, atol=1e-9)
            moved = item.camera_from_model.translation
            np.testing.assert_allclose(moved, 1000.0 * ours.translation, atol=1e-6)
            assert (folder / f"mask_visib/{index:06d}_{number:06d}.png").is_file()
        assert len(image.objects) == 2
        # The set's cameras show the world as the scene's do.
        points = np.random.default_rng(0).uniform(-0.2, 0.2, (9, 3)) + np.array([0.0, 0.0, 0.9])
        known = scene.views[index].pose(Similarity(scene.views[0].camera_from_world.inverse()))
        world = Similarity(views[0].camera_from_world.inverse(), 1000.0)
        shown = view.pose(world).project(points)
        np.testing.assert_allclose(shown, known.project(points), atol=1e-6)
    infos = json.loads((folder / "scene_gt_info.json").read_text())
    assert all(0.0 < item["visib_fract"] <= 1.0 for item in infos["0"])
