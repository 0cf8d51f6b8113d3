"""Files as people have them, dropped on the page in real Chromium: several, a folder; and what the
page says of them.
"""

import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.app.running_app import running_app
from tests.scene import Scene, make_scene
from tests.textured import write_gltf, write_obj
from tests.writing import write

pytestmark = pytest.mark.slow
TARGET = "getComputedStyle(document.body, '::after').content"
"""What the page shows over itself while files are dragged over it."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return make_scene(tmp_path_factory.mktemp("files"))


@pytest.fixture(scope="module")
def tab(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory, scene: Scene
) -> Iterator[AppPage]:
    files = scene.photo, scene.model, "--pose", scene.start
    with (
        AppProcess(tmp_path_factory.mktemp("app"), *files) as app,
        AppPage(browser, app.url) as opened,
    ):
        yield opened


@pytest.fixture
def page(tab: AppPage) -> AppPage:
    """One tab for all tests; each leaves the scene open."""
    tab.open_step(1)
    tab.wait_for_text("m.ply")
    return tab


def assert_textured(tab: AppPage, name: str) -> None:
    """The model is open with its texture, under the photo that was there."""
    tab.wait_for_text(name)
    tab.wait_for_text("2 triangles, 1 part, 1 texture")
    tab.wait_for_text("160 x 120 px")


def back_to_the_scene(tab: AppPage) -> None:
    tab.page.keyboard.press("z")
    tab.wait_for_text("1,280 triangles")


@pytest.mark.long
def test_a_model_dropped_with_its_files_is_textured(page: AppPage, scene: Scene, tmp_path: Path):
    write_gltf(tmp_path, "wood.png")
    shutil.copy(scene.photo, tmp_path / "wood.png")
    page.drop_files(sorted(tmp_path.iterdir()))
    assert_textured(page, "quad.gltf")
    back_to_the_scene(page)


def test_a_folder_is_its_files(page: AppPage, scene: Scene, tmp_path: Path):
    folder = tmp_path / "Wooden thing"
    for inside in ("source", "textures"):
        (folder / inside).mkdir(parents=True)
    write_obj(folder / "source", "wood.png")
    shutil.copy(scene.photo, folder / "textures" / "wood.png")
    page.drop_files([folder])
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)
    page.page.locator("input[type=file][accept=folder]").evaluate("e => (e.webkitdirectory = true)")
    page.page.locator("input[type=file][accept=folder]").set_input_files(folder)
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)


def test_a_missing_texture_is_asked_for_and_taken_when_it_comes(
    page: AppPage, scene: Scene, tmp_path: Path
):
    write_obj(tmp_path, "oak.png")
    page.drop_files(sorted(tmp_path.iterdir()))
    page.wait_for_text("Texture left out: oak.png is not there; add it to the model's files.")
    picture = tmp_path / "oak.png"
    shutil.copy(scene.photo, picture)
    page.page.evaluate(f"addEventListener('dragover', () => (window.target = {TARGET}), true)")
    page.hold_files([picture], "dragEnter", "dragOver")
    page.page.wait_for_function("window.target?.includes('Drop a photo, a model')")
    page.page.wait_for_function(f"{TARGET} === 'none'")  # the drag has gone
    page.drop_files([picture])
    assert_textured(page, "quad.obj")
    assert page.page.evaluate(TARGET) == "none"
    page.page.keyboard.press("z")
    back_to_the_scene(page)


def test_the_hint_takes_a_missing_texture_under_any_name(
    browser: Browser, scene: Scene, tmp_path: Path
):
    files = replace(scene, model=write_obj(tmp_path, "oak.png"))
    with (
        running_app(files, tmp_path / "state", has_start=False) as app,
        AppPage(browser, app.url) as tab,
    ):
        card = tab.page.locator(".pv-card").filter(visible=True)
        card.locator("img").wait_for()
        assert card.inner_text() == "quad.obj"
        with tab.page.expect_file_chooser() as chooser:
            tab.page.locator(".pv-hint").get_by_role("button", name="Add it ...").click()
        chooser.value.set_files(str(shutil.copy(scene.photo, tmp_path / "IMG 1.png")))
        tab.page.locator(".pv-hint button").wait_for(state="detached")
        tab.open_step(1)
        assert_textured(tab, "quad.obj")
        assert tab.page.get_by_role("button", name="Missing texture").count() == 0
        tab.page.keyboard.press("z")
        tab.page.get_by_role("button", name="Missing texture").wait_for()


def test_what_cannot_be_used_is_one_sentence_and_nothing_is_lost(page: AppPage, tmp_path: Path):
    bad = tmp_path / "bad.zip"
    bad.write_bytes(b"PK")
    huge = tmp_path / "holiday"
    huge.mkdir()
    for i in range(3):
        with (huge / f"{i}.jpg").open("wb") as file:
            file.truncate(90_000_000)
    (tmp_path / "new folder").mkdir()
    for path, words in (
        (bad, "bad.zip: not a readable zip"),
        (huge, "holiday (3 files): 270,000,000 bytes; up to 200,000,000 can be uploaded"),
        (tmp_path / "new folder", "new folder: an empty folder; drop one that holds a photo"),
    ):
        page.drop_files([path])
        page.wait_for_text(words)
    page.wait_for_text("1,280 triangles")


@pytest.mark.long
def test_an_upload_says_its_share_and_the_time_that_is_left(
    browser: Browser, scene: Scene, tmp_path: Path
):
    fast = "{ const now = performance.now.bind(performance); performance.now = () => 50 * now(); }"
    said = """window.said = []; new MutationObserver((changes) => changes.forEach((change) =>
        window.said.push(change.target.dataset.said))).observe(document.body,
        { subtree: true, attributes: true, attributeFilter: ["data-said"] })"""
    path = tmp_path / "large.jpg"
    with path.open("wb") as file:
        file.truncate(30_000_000)
    with (
        running_app(scene, tmp_path / "state") as app,
        AppPage(browser, app.url, before=fast) as tab,
    ):
        tab.page.evaluate(said)
        tab.drop_files([path])
        tab.wait_for_text("large.jpg: ")
        texts = tab.page.evaluate("window.said")
    assert all(re.match(r"\d+ %", text) for text in texts)
    assert any(re.search(r"\d %, \d+ (s|min) left$", text) for text in texts)


@pytest.mark.long
def test_many_notes_leave_the_photo_free_and_no_sentence_names_a_flag(
    page: AppPage, tmp_path: Path
):
    path = write_obj(tmp_path, "0.png")
    with path.open("a") as shape, path.with_suffix(".mtl").open("a") as paints:
        for number in range(1, 40):
            shape.write(f"usemtl {number}\nf 1/1 2/2 3/3\n")
            paints.write(f"newmtl {number}\nmap_Kd {number}.png\n")
    page.drop_files(sorted(tmp_path.iterdir()))
    words = "Texture left out: 39.png is not there"
    notice = page.page.get_by_role("alert").filter(has_text=words)
    notice.wait_for()
    kept = page.page.get_by_role("listitem").filter(has_text=words).bounding_box()
    assert kept is not None
    assert kept["x"] + kept["width"] <= page.view()["box"][0]  # beside the photo
    # Meanwhile, sentences that name options where they are said on the command line.
    write(tmp_path / "T.json", {"rotation": [1, 2, 3]})
    said = page.page.get_by_role("alert")
    page.drop_files([tmp_path / "T.json"])
    said.filter(has_text="no pose of poseviewer's").wait_for()
    assert not [text for text in said.all_inner_texts() if "--" in text]
    page.open_step(5)
    page.page.get_by_label("Format", exact=True).first.click()
    page.page.get_by_role("option", name="bop", exact=True).click()
    page.page.get_by_role("button", name="Export as ...").click()
    page.page.get_by_role("button", name="Export", exact=True).click()
    said.filter(has_text='say it with "Model\'s unit"').wait_for()
    assert not [text for text in said.all_inner_texts() if "--" in text]
    notice.wait_for(state="hidden")  # it lay over the photo
    page.open_step(1)
    back_to_the_scene(page)


@pytest.mark.long
def test_what_would_replace_a_pose_that_is_not_saved_asks(
    page: AppPage, scene: Scene, tmp_path: Path
):
    write_obj(tmp_path, "wood.png")
    shutil.copy(scene.photo, tmp_path / "wood.png")
    files = sorted(tmp_path.iterdir())
    page.page.keyboard.press("ArrowRight")
    page.drop_files(files)
    page.wait_for_text("The pose is not saved")
    page.page.get_by_role("button", name="Close", exact=True).click()
    page.page.get_by_text("The pose is not saved").wait_for(state="detached")
    page.wait_for_text("1,280 triangles")
    page.drop_files(files)
    page.page.get_by_role("button", name="Open without saving").click()
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)
    page.drop_files(files)
    page.page.get_by_role("button", name="Save it, then open").click()
    assert_textured(page, "quad.obj")
    assert [*scene.photo.parent.glob("p*.pose.json")]
    back_to_the_scene(page)
