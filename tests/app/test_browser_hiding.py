"""Painting over what is in front, and leaving parts out, in real Chromium on the real app."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from poseviewer.api import load
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import load_pose
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import Scene, make_scene
from tests.several import save_halves

pytestmark = pytest.mark.slow

PHOTO = (160, 120)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The scene with a model of two parts: by the sign of x."""
    whole = make_scene(tmp_path_factory.mktemp("files"))
    scene = replace(whole, model=whole.model.with_name("halves.obj"))
    save_halves(scene.model, load_mesh(whole.model))
    return scene


@pytest.fixture(scope="module")
def shared(browser: Browser, scene: Scene) -> Iterator[AppPage]:
    files = scene.photo, scene.model, "--pose", scene.start
    with (
        AppProcess(scene.photo.parent, *files) as app,
        AppPage(browser, app.url, pixel_ratio=1.0) as opened,
    ):
        opened.wait_for_text("at this pose")
        opened.open_step(3)
        yield opened


@pytest.fixture
def tab(shared: AppPage) -> Iterator[AppPage]:
    """One tab for several tests; each begins at the start, with nothing hidden or left out."""
    yield shared
    shared.page.keyboard.press("Escape")
    shared.until(lambda: is_whole(shared) or shared.page.keyboard.press("z"))
    shared.page.keyboard.press("r")


def is_whole(tab: AppPage) -> bool:
    """Whether nothing of the photo is hidden, and no part of the model left out."""
    return not hidden_share(tab) and not tab.page.get_by_text("Left out of the model").is_visible()


def hidden_share(tab: AppPage) -> str:
    """Text of the page on what is hidden; "" where nothing is."""
    said = tab.page.get_by_text("of the photo is hidden").filter(visible=True)
    return "".join(said.all_inner_texts()[:1])  # at once: it may be gone the next moment


def hidden_in(path: Path) -> np.ndarray:
    """(height, width): what a saved mask hides."""
    pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    assert set(np.unique(pixels)) == {0, 255}
    return pixels == 0


@pytest.mark.long
def test_what_is_painted_over_is_kept_and_compared_alike(tab: AppPage, scene: Scene) -> None:
    folder = scene.photo.parent
    tab.page.keyboard.press("h")
    tab.wait_for_text("Brush:")
    tab.drag((25.0, 56.0), (135.0, 56.0), PHOTO)
    tab.wait_for_text("of the photo is hidden")
    first = hidden_share(tab)
    tab.drag((80.0, 80.0), (81.0, 80.0), PHOTO)
    tab.until(lambda: hidden_share(tab) not in ("", first))
    tab.page.keyboard.press("z")
    tab.until(lambda: hidden_share(tab) == first)
    tab.drag((130.0, 56.0), (140.0, 56.0), PHOTO, keys=["Alt"])
    tab.until(lambda: hidden_share(tab) not in ("", first))
    # The tint lies over the photo.
    x, y = tab.on_screen((60.0, 56.0), PHOTO)
    red, green, _ = tab.settled_picture((x, y), 12.0)[int(y), int(x)]
    assert red > green
    tab.page.keyboard.press("Escape")
    path, mask = folder / "p.halves.pose.json", folder / "p.halves.mask.png"
    record = tab.saved(path)
    assert record["mask"] == mask.name
    hidden = hidden_in(mask)
    assert hidden[53:59, 30:110].all()
    assert not hidden[56, 136:].any()
    assert not hidden[:30].any()

    settings = FitSettings(limits=Limits(10))
    by_pose = load(scene.photo, scene.model, path, settings)
    by_option = load(scene.photo, scene.model, scene.start, settings, mask=mask)
    for case in (by_pose, by_option):
        kept = case.scene.mask(0)
        assert kept is not None
        assert np.array_equal(kept.weights == 0.0, hidden)
    again = load(scene.photo, scene.model, path, settings, mask=mask)
    assert np.array_equal(again.problem.photo.weights, by_pose.problem.photo.weights)


def test_a_polygon_is_clicked_or_dragged(tab: AppPage) -> None:
    tab.open_step(2)
    tab.page.keyboard.press("h")  # the tools come into sight
    tab.page.get_by_role("button", name="● Brush").wait_for()
    for name in ("● Brush", "Polygon", "Scribble", "Part"):
        expect(tab.page.get_by_role("button", name=name, exact=True)).to_be_in_viewport(ratio=1.0)
    tab.page.get_by_role("button", name="Polygon").click()
    tab.wait_for_text("Polygon:")
    tab.page.get_by_role("button", name="● Polygon").wait_for()
    assert tab.page.get_by_role("button", name="● ").count() == 1
    for corner in ((20.0, 20.0), (80.0, 20.0), (80.0, 50.0), (20.0, 50.0)):
        tab.page.mouse.click(*tab.on_screen(corner, PHOTO))
    tab.page.keyboard.press("Enter")
    tab.wait_for_text("of the photo is hidden")
    share = float(hidden_share(tab).split("%")[0])
    assert share == pytest.approx(100.0 * 60 * 30 / (160 * 120), abs=0.8)


def test_a_part_is_left_out_and_comes_back(tab: AppPage, scene: Scene) -> None:
    mesh, path = load_mesh(scene.model), scene.photo.with_name("p.halves.pose.json")
    pose = load_pose(scene.start, *PHOTO).pose
    tab.page.keyboard.press("h")
    tab.page.get_by_role("button", name="Part").click()
    tab.wait_for_text("press a part of the model")
    middle = mesh.vertices[mesh.vertices[:, 0] > 0.5].mean(axis=0)
    tab.page.mouse.click(*tab.on_screen(pose.project(middle).tolist(), PHOTO))
    tab.wait_for_text("Left out of the model")
    (name,) = tab.saved(path)["without"]
    assert tab.page.locator(".pv-parts li").inner_text().startswith(name)
    tab.page.get_by_role("button", name="Bring back").click()
    tab.page.get_by_text("Left out of the model").wait_for(state="hidden")
    case = load(scene.photo, scene.model, path)
    assert case.mesh.left_out == (name,)
    seen = case.renderer.render_mask(pose)
    whole = load(scene.photo, scene.model, scene.start).renderer.render_mask(pose)
    assert 0.2 < np.count_nonzero(seen) / np.count_nonzero(whole) < 0.8
