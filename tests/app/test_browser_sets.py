"""Files as people have them, dropped on the page in real Chromium: several, a zip, a folder."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser
from scipy.spatial.transform import Rotation

from poseviewer.files.pose import PoseRecord, load_pose
from poseviewer.geometry.camera import Perspective
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture
from tests.scene import Scene, make_scene
from tests.textured import CORNERS, write_gltf, write_obj, write_ply

pytestmark = pytest.mark.slow

RED, BLUE = (230, 30, 20), (20, 40, 230)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return make_scene(tmp_path_factory.mktemp("files"))


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory, scene: Scene) -> Iterator[AppProcess]:
    folder = tmp_path_factory.mktemp("app")
    with AppProcess(folder, scene.photo, scene.model, "--pose", scene.start) as process:
        yield process


@pytest.fixture(scope="module")
def tab(browser: Browser, app: AppProcess) -> Iterator[AppPage]:
    opened = AppPage(browser, app.url)
    yield opened
    opened.page.close()


@pytest.fixture
def page(tab: AppPage) -> Iterator[AppPage]:
    """One tab for all tests; each leaves the scene open."""
    tab.open_step(1)
    tab.wait_for_text("m.ply")
    yield tab
    assert tab.errors == []


def halves(path: Path) -> Path:
    """A picture, red at the left and blue at the right."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.full((32, 32, 3), BLUE, np.uint8)
    pixels[:, :16] = RED
    Image.fromarray(pixels).save(path)
    return path


def drop_model(tab: AppPage, paths: Sequence[Path]) -> None:
    """Files of a model, which is opened in place of the one that is in its place."""
    tab.drop_files(paths)
    open_instead(tab)


def open_instead(tab: AppPage) -> None:
    tab.page.get_by_role("button", name="in place of m.ply").click()
    tab.page.get_by_role("dialog").wait_for(state="detached")


def shown_colours(tab: AppPage) -> tuple[bool, bool]:
    """Whether red and blue are seen in the photo's part of the window, the model drawn solid."""
    picture = tab.settled_picture().astype(int)
    reddish = (picture[..., 0] > 90) & (picture[..., 2] < 0.5 * picture[..., 0])
    blueish = (picture[..., 2] > 90) & (picture[..., 0] < 0.5 * picture[..., 2])
    return bool(reddish.sum() > 300), bool(blueish.sum() > 300)


def assert_textured(tab: AppPage, name: str) -> None:
    """The model is open with its texture, under the photo that was there."""
    tab.wait_for_text(name)
    tab.wait_for_text("2 triangles, 1 part, 1 texture")
    tab.wait_for_text("160 x 120 px")
    tab.page.keyboard.press("2")
    tab.until(lambda: shown_colours(tab) == (True, True))


def back_to_the_scene(tab: AppPage) -> None:
    tab.page.keyboard.press("z")
    tab.wait_for_text("1,280 triangles")


def written(folder: Path, write: Callable[[Path, str], Path]) -> list[Path]:
    folder.mkdir()
    write(folder, "wood.png")
    halves(folder / "wood.png")
    return sorted(folder.iterdir())


@pytest.mark.parametrize("write", [write_obj, write_ply, write_gltf])
def test_a_model_dropped_with_its_files_is_textured(page: AppPage, tmp_path: Path, write):
    files = written(tmp_path / "quad", write)
    for number, order in enumerate((files, files[::-1])):
        drop_model(page, order)
        assert_textured(page, write(tmp_path, "x").name)
        if number == 0:
            keep_picture(page, f"dropped_{write.__name__}")
        back_to_the_scene(page)


def test_a_folder_and_a_zip_are_their_files(page: AppPage, tmp_path: Path):
    folder = tmp_path / "Wooden thing"
    (folder / "source").mkdir(parents=True)
    write_obj(folder / "source", "wood.png")
    halves(folder / "textures" / "wood.png")
    drop_model(page, [folder])
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)
    page.page.locator("input[type=file][accept=folder]").evaluate("e => (e.webkitdirectory = true)")
    page.page.locator("input[type=file][accept=folder]").set_input_files(folder)
    open_instead(page)
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)
    packed = tmp_path / "thing.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for path in sorted(folder.rglob("*.*")):
            archive.write(path, path.relative_to(tmp_path))
    drop_model(page, [packed])
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)


def test_files_chosen_together_are_a_set(page: AppPage, tmp_path: Path):
    files = written(tmp_path / "quad", write_obj)
    with page.page.expect_file_chooser() as chooser:
        page.page.get_by_role("button", name="Model ...", exact=True).click()
    assert chooser.value.is_multiple()
    chooser.value.set_files([str(path) for path in files])
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)


def test_what_is_missed_may_be_dropped_later_and_the_pose_stays(page: AppPage, tmp_path: Path):
    files = written(tmp_path / "quad", write_obj)
    mtl, obj, wood = files
    drop_model(page, [obj])
    page.wait_for_text("Material file left out: quad.mtl is not there")
    page.wait_for_text("2 triangles, 1 part, no colours")
    page.page.keyboard.press("2")
    before = page.settled_picture()
    page.drop_files([wood, mtl])
    assert_textured(page, "quad.obj")
    moved = np.any(before != page.settled_picture(), axis=2)
    page.drop_files([tmp_path / "quad"])  # again, and now as a whole
    page.page.wait_for_timeout(500)
    assert_textured(page, "quad.obj")
    assert moved.any()
    page.page.keyboard.press("z")
    page.page.keyboard.press("z")
    back_to_the_scene(page)


def test_what_nothing_names_is_asked_about(page: AppPage, tmp_path: Path):
    files = written(tmp_path / "quad", write_obj)
    Image.new("RGB", (90, 60), (90, 90, 90)).save(tmp_path / "quad" / "street.png")
    page.drop_files([tmp_path / "quad"])
    page.wait_for_text("No file names the picture street.png. Is it the photo?")
    keep_picture(page, "asked_about")
    page.page.get_by_role("button", name="None: the photo stays").click()
    open_instead(page)
    assert_textured(page, "quad.obj")
    page.page.get_by_role("dialog").wait_for(state="detached")
    back_to_the_scene(page)
    page.drop_files([*files, tmp_path / "quad" / "street.png"])
    page.page.get_by_role("button", name="street.png").click()
    page.wait_for_text("90 x 60 px")
    page.wait_for_text("2 triangles, 1 part, 1 texture")
    back_to_the_scene(page)
    page.drop_files([tmp_path / "quad"])
    page.page.get_by_role("button", name="Close").click()
    page.page.get_by_role("dialog").wait_for(state="detached")
    page.wait_for_text("1,280 triangles")


def write_bop_scene(folder: Path, scene: Scene, truth: PoseRecord) -> str:
    """The scene as the third image of a BOP scene, with its model; gives the photo's name."""
    camera, place = truth.pose.camera, truth.pose.camera_from_model
    assert isinstance(camera, Perspective)
    matrix = [camera.fx, 0, camera.cx - 0.5, 0, camera.fy, camera.cy - 0.5, 0, 0, 1]
    there = {"obj_id": 5, "cam_R_m2c": place.rotation.ravel().tolist()}
    there["cam_t_m2c"] = place.translation.tolist()
    inside = folder / "test/000002"
    (inside / "rgb").mkdir(parents=True)
    for name, content in (
        ("scene_camera.json", {str(i): {"cam_K": matrix, "depth_scale": 1.0} for i in (3, 7)}),
        ("scene_gt.json", {"3": [there], "7": [there | {"obj_id": 6}]}),
    ):
        (inside / name).write_text(json.dumps(content))
    shutil.copy(scene.photo, inside / "rgb/000003.png")
    Image.new("RGB", (90, 60), (90, 90, 90)).save(inside / "rgb/000007.png")
    (folder / "models").mkdir()
    for number in (5, 6):
        shutil.copy(scene.model, folder / f"models/obj_{number:06d}.ply")
    return "test/000002/rgb/000003.png"


def write_colmap_model(folder: Path, scene: Scene, truth: PoseRecord) -> str:
    """The scene as the second image of a COLMAP model, with a mesh; gives the photo's name."""
    camera, place = truth.pose.camera, truth.pose.camera_from_model
    assert isinstance(camera, Perspective)
    x, y, z, w = Rotation.from_matrix(place.rotation).as_quat()
    inside = folder / "sparse/0"
    inside.mkdir(parents=True)
    pinhole = f"1 PINHOLE 160 120 {camera.fx} {camera.fy} {camera.cx} {camera.cy}\n"
    (inside / "cameras.txt").write_text(pinhole)
    shift = " ".join(map(str, place.translation))
    lines = ("1 1 0 0 0 0 0 4 1 a/one.png", f"2 {w} {x} {y} {z} {shift} 1 b/one.png")
    (inside / "images.txt").write_text("\n\n".join(lines) + "\n\n")
    (inside / "points3D.txt").write_text("")
    for name in "ab":
        (folder / "images" / name).mkdir(parents=True)
        shutil.copy(scene.photo, folder / "images" / name / "one.png")
    shutil.copy(scene.model, folder / "meshed.ply")
    return "images/b/one.png"


@pytest.mark.parametrize(
    ("write", "model"), [(write_bop_scene, "obj_000005.ply"), (write_colmap_model, "meshed.ply")]
)
def test_a_scene_of_a_benchmark_or_a_reconstruction_begins_the_work(
    page: AppPage, app: AppProcess, scene: Scene, tmp_path: Path, write, model: str
):
    truth = load_pose(scene.truth, 160, 120)
    photo = write(tmp_path / "scene", scene, truth)
    page.drop_files([tmp_path / "scene"])
    page.wait_for_text("2 photos. Which one is to be opened?")
    page.page.get_by_role("button", name=photo).click()
    page.wait_for_text(model)
    digest = hashlib.sha256(scene.photo.read_bytes()).hexdigest()
    path = app.folder / f"photo-{digest[:8]}.pose.json"
    page.saved_pose(path)
    found, expected = load_pose(path, 160, 120).pose, truth.pose
    was, now = expected.camera_from_model, found.camera_from_model
    np.testing.assert_allclose(now.rotation, was.rotation, atol=1e-6)
    np.testing.assert_allclose(now.translation, was.translation, atol=1e-6)
    corners = np.array(CORNERS)
    np.testing.assert_allclose(found.project(corners), expected.project(corners), atol=1e-3)
    page.page.keyboard.press("z")
    page.wait_for_text("m.ply")


def test_of_many_photos_one_is_picked_from_a_list(page: AppPage, tmp_path: Path):
    for i in range(40):
        Image.new("RGB", (60 + i, 50), (i, 90, 90)).save(tmp_path / f"photo {i:02d}.jpg")
    page.drop_files([tmp_path])
    page.wait_for_text("40 photos. Which one is to be opened?")
    keep_picture(page, "asked_about_many")
    page.page.get_by_label("Of these").fill("photo 23")
    page.page.get_by_role("option", name="photo 23.jpg").click()
    page.page.get_by_role("button", name="Open it").click()
    page.wait_for_text("83 x 50 px")
    page.page.keyboard.press("z")
    page.wait_for_text("160 x 120 px")


def test_what_cannot_be_used_is_one_sentence_and_nothing_is_lost(page: AppPage, tmp_path: Path):
    bad = tmp_path / "bad.zip"
    with zipfile.ZipFile(bad, "w") as archive:
        archive.writestr("../../x.obj", "v 0 0 0\n")
    huge = tmp_path / "holiday"
    huge.mkdir()
    for i in range(3):
        with (huge / f"{i}.jpg").open("wb") as file:
            file.truncate(90_000_000)
    (tmp_path / "new folder").mkdir()
    for path, words in (
        (bad, "bad.zip: the path '../../x.obj' leads out of the zip; nothing was unpacked"),
        (huge, "holiday (3 files): 270,000,000 bytes; up to 200,000,000 can be uploaded"),
        (tmp_path / "new folder", "new folder: an empty folder; drop one that holds a photo"),
    ):
        page.drop_files([path])
        page.wait_for_text(words)
    page.wait_for_text("1,280 triangles")
