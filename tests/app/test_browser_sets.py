"""Files as people have them, dropped on the page in real Chromium: several, a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import Scene, make_scene
from tests.textured import write_gltf, write_obj

pytestmark = pytest.mark.slow

RED, BLUE = (230, 30, 20), (20, 40, 230)


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


def halves(path: Path) -> Path:
    """A picture, red at the left and blue at the right."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.full((32, 32, 3), BLUE, np.uint8)
    pixels[:, :16] = RED
    Image.fromarray(pixels).save(path)
    return path


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


def test_a_model_dropped_with_its_files_is_textured(page: AppPage, tmp_path: Path):
    page.drop_files(written(tmp_path / "quad", write_gltf))
    assert_textured(page, "quad.gltf")
    back_to_the_scene(page)


def test_a_folder_is_its_files(page: AppPage, tmp_path: Path):
    folder = tmp_path / "Wooden thing"
    (folder / "source").mkdir(parents=True)
    write_obj(folder / "source", "wood.png")
    halves(folder / "textures" / "wood.png")
    page.drop_files([folder])
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)
    page.page.locator("input[type=file][accept=folder]").evaluate("e => (e.webkitdirectory = true)")
    page.page.locator("input[type=file][accept=folder]").set_input_files(folder)
    assert_textured(page, "quad.obj")
    back_to_the_scene(page)


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
        (bad, "bad.zip: not a zip that can be read"),
        (huge, "holiday (3 files): 270,000,000 bytes; up to 200,000,000 can be uploaded"),
        (tmp_path / "new folder", "new folder: an empty folder; drop one that holds a photo"),
    ):
        page.drop_files([path])
        page.wait_for_text(words)
    page.wait_for_text("1,280 triangles")
