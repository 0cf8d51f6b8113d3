"""The app as a person sees it: real Chromium on the real app."""

import json
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import Scene

pytestmark = pytest.mark.slow

DEMO_PHOTO = (960, 720)
LARGE = (1400, 900)
"""The window in which maps are large enough to be pressed, px."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppProcess]:
    with AppProcess(tmp_path_factory.mktemp("demo")) as app:
        yield app
        assert app.terminate() == 0
    assert app.leaves_nothing()
    assert not [line for line in app.lines if "Traceback" in line or "Error" in line]


@pytest.fixture(scope="module")
def tab(browser: Browser, demo: AppProcess) -> Iterator[AppPage]:
    with AppPage(browser, demo.url, LARGE) as opened:
        yield opened


@pytest.fixture
def page(tab: AppPage) -> AppPage:
    """One tab for all tests, each with the whole photo in view."""
    tab.page.evaluate("window.poseviewer.showAll()")
    return tab


@pytest.mark.long
def test_five_steps_lead_through_the_demo(page: AppPage):
    page.wait_for_text("at this pose")
    page.page.get_by_role("button", name="Undo (Z)").wait_for()  # the step Place is open
    page.drag((450.0, 400.0), (480.0, 410.0), DEMO_PHOTO)
    assert not page.page.get_by_label("Loss", exact=True).is_visible()
    page.page.keyboard.press("Space")
    page.wait_for_text("evaluations, restart")
    page.page.get_by_label("Loss", exact=True).wait_for()  # that of the search is open
    page.page.keyboard.press("Space")
    page.wait_for_text("Stopped: the best pose so far is shown")
    page.page.get_by_role("button", name="Go back").click()
    for following in ("Judge", "Save"):
        page.page.get_by_role("tab", name=following).click()
    page.page.get_by_role("button", name="Save pose (S)").wait_for()
    page.page.get_by_role("button", name="Undo (Z)").wait_for(state="hidden")


@pytest.mark.long
def test_loss_and_search_are_two_choices(page: AppPage, demo: AppProcess):
    def choose(label: str, option: str) -> None:
        page.page.get_by_label(label, exact=True).click()
        chosen = page.page.get_by_role("option", name=option, exact=True)
        chosen.click()
        chosen.wait_for(state="hidden")  # until the list has closed, it has the keys

    def wait_for_search(text: str) -> None:
        field = page.page.get_by_label("Search", exact=True).and_(page.page.locator("input"))
        page.until(lambda: field.input_value() == text)

    def search_and_stop(loss: str) -> list[str]:
        page.page.keyboard.press("Space")
        page.wait_for_text(loss)
        page.page.keyboard.press("Space")
        page.wait_for_text("Stopped: the best pose so far is shown")
        saved = page.saved(demo.folder / "demo_photo.demo_car.pose.json")
        return [saved["settings"][name] for name in ("loss", "search")]

    page.open_step(3)
    wait_for_search("CMA-ES, quadratic models")
    choose("Loss", "Paper (2010)")
    wait_for_search("Restarted simplex")  # the paper's own, until one is chosen
    choose("Search", "CMA-ES, quadratic models")
    searched = search_and_stop("Loss: Paper (2010), pixels inside the model")
    assert searched == ["paper", "models"]
    choose("Loss", "Default: light, colour, edges")
    choose("Search", "Restarted simplex")
    assert search_and_stop("Loss: Default: light, colour, edges") == ["default", "simplex"]
    choose("Search", "CMA-ES, quadratic models")


def test_wheel_zooms_at_the_cursor_and_a_key_returns(page: AppPage):
    page.wait_for_text("at this pose")
    page.until(lambda: is_registered(page))  # the panels have come to rest
    place = tuple(round(v) for v in page.on_screen((700.0, 300.0), DEMO_PHOTO))
    left, top = page.view()["box"][:2]
    under = page.page.evaluate(
        f"window.poseviewer.photoFromCanvas({place[0] - left}, {place[1] - top})"
    )
    page.page.mouse.move(*place)
    page.page.mouse.wheel(0, -700)
    page.page.wait_for_function(
        "JSON.parse(document.documentElement.dataset.poseviewerView).zoom > 2"
    )
    np.testing.assert_allclose(page.on_screen(under, DEMO_PHOTO), place, atol=0.01)
    page.page.mouse.down(button="right")
    page.page.mouse.move(place[0] + 40, place[1] - 25, steps=4)
    page.page.mouse.up(button="right")
    moved = page.on_screen(under, DEMO_PHOTO)
    np.testing.assert_allclose(moved, (place[0] + 40, place[1] - 25), atol=0.01)
    page.page.keyboard.press("f")
    page.page.wait_for_function(
        "JSON.parse(document.documentElement.dataset.poseviewerView).zoom === 1"
    )


MAPS_ARE_NEW = """document.querySelectorAll('.pv-cell image').length === 15
    && document.querySelector('.pv-dim') === null"""
FIRST_CELL = """() => {
    const cell = document.querySelector(".pv-cell");  // maps that are drawn anew replace it
    const box = cell === null ? { width: 0 } : cell.getBoundingClientRect();
    return box.width > 0 ? [box.x, box.y, box.width, box.height] : null;
}"""


def test_a_press_on_a_map_moves_the_pose_and_undo_brings_it_back(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.demo_car.pose.json"
    before = page.saved(path)["chart"]["numbers"]
    page.page.wait_for_function(MAPS_ARE_NEW)  # those about an older pose would lead to that
    width, height = page.page.wait_for_function(FIRST_CELL).json_value()[2:]
    cell = page.page.locator(".pv-cell").first  # it waits until the page has come to rest
    cell.click(position={"x": 0.75 * width, "y": 0.4 * height})
    after = page.saved(path)["chart"]["numbers"]
    changed = np.flatnonzero(np.abs(np.array(after) - before) > 1e-9)
    assert list(changed) == [0, 1]
    assert after[0] > before[0]
    assert after[1] > before[1]  # upwards on the map is more
    page.page.keyboard.press("z")
    assert page.saved(path)["chart"]["numbers"] == before


def test_the_pose_is_copied_as_it_is_saved(page: AppPage, demo: AppProcess):
    saved = page.saved(demo.folder / "demo_photo.demo_car.pose.json")
    page.page.context.grant_permissions(["clipboard-read"])

    def is_copied() -> bool:  # the page comes to the pose after the file
        page.page.get_by_role("button", name="JSON", exact=True).click()
        copied = json.loads(page.page.evaluate("navigator.clipboard.readText()"))
        return copied["camera_from_model"] == saved["camera_from_model"]

    page.until(is_copied)


def test_a_file_of_others_is_replaced_only_when_that_is_said(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.demo_car.pose.json"
    path.write_text("another program's")
    page.page.keyboard.press("s")
    page.page.get_by_role("button", name="Close").wait_for()
    page.page.keyboard.press("Escape")
    page.page.get_by_role("dialog").wait_for(state="hidden")
    page.page.keyboard.press("s")
    page.page.get_by_role("button", name="Use another name").click()
    other = path.with_name("demo_photo.demo_car.2.pose.json")
    page.until(other.exists)
    page.page.get_by_role("dialog").wait_for(state="hidden")
    assert path.read_text() == "another program's"
    other.write_text("another program's, too")
    page.page.keyboard.press("s")
    page.page.get_by_role("button", name="Replace it").click()
    page.until(other.with_name(f"{other.name}.bak").exists)
    assert other.with_name(f"{other.name}.bak").read_text() == "another program's, too"
    page.page.get_by_role("dialog").wait_for(state="hidden")


def test_of_refusals_the_last_is_seen(page: AppPage):
    assert not page.page.locator("#webgl-software-rendering").is_visible()
    middle = page.on_screen((480.0, 360.0), DEMO_PHOTO)
    page.page.keyboard.press("1")
    for _ in range(3):
        page.page.mouse.dblclick(*middle)
        page.wait_for_text("has its pins already")
    page.open_step(2)
    page.page.get_by_role("button", name="Point pairs").click()
    page.page.mouse.click(*page.on_screen((940.0, 600.0), DEMO_PHOTO))
    page.wait_for_text("There is no model there")
    alerts = page.page.get_by_role("alert").filter(has_text="no model there")
    page.until(lambda: alerts.count() == 1)
    assert alerts.inner_text().startswith("There is no model there")  # without a title
    page.page.keyboard.press("Escape")


@pytest.mark.long
def test_a_second_tab_and_a_reload_need_no_token(page: AppPage, demo: AppProcess):
    with page.page.expect_popup() as popup:
        page.page.evaluate(f"open({demo.url.partition('?')[0]!r})")
    for load in (popup.value.wait_for_load_state, popup.value.reload):
        load()
        popup.value.get_by_role("button", name="Undo (Z)").wait_for()
    popup.value.close()


def is_registered(page: AppPage) -> bool:
    """Whether the photo's middle is that of its box, for the page as well; not while that moves."""
    width, height = page.view()["box"][2:]
    at = page.page.evaluate(f"poseviewer.photoFromCanvas({width / 2}, {height / 2})")
    return np.allclose(at, np.array(DEMO_PHOTO) / 2, atol=0.5)


@pytest.mark.long
def test_a_photo_that_is_opened_alone_asks_for_its_model(page: AppPage, scene: Scene):
    page.page.keyboard.press("Escape")
    page.drop_files([scene.photo])
    page.wait_for_text("now open the model of this photo")
    assert not page.page.get_by_text("Looking for the object").filter(visible=True).count()
    page.drop_files([scene.model])
    page.wait_for_text("Looking for the object")
    for _ in range(2):
        page.page.keyboard.press("z")
    page.wait_for_text("at this pose")
