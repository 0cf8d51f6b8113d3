"""Panels, plot and first words of the page in real Chromium."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from poseviewer import __version__
from poseviewer.app.app import App
from poseviewer.app.below_viser.guard import serve
from poseviewer.app.page.controls import plain
from poseviewer.geometry.charts import short_name
from tests.app.browser import READY, TWO_FRAMES, AppPage
from tests.app.running_app import RunningApp, running_app
from tests.scene import Scene

pytestmark = pytest.mark.slow
WINDOW = (1280, 1200)
"""High enough for every field of a step."""
FIRST_WORDS = "getComputedStyle(document.body, '::before').content"
LAST_LABEL = """() => {
    const [{ chart }] = Object.values(window.__viserTestpoints.uplots);
    const [axis] = chart.axes;
    if (!axis._splits?.length) return 1;  // it is not drawn yet
    const at = chart.valToPos(axis._splits.at(-1), "x", true);
    chart.ctx.font = axis.font[0];
    return at + chart.ctx.measureText(axis._values.at(-1)).width / 2 - chart.ctx.canvas.width;
}"""
"""Width, px, by which the plot's last number lies outside of it."""
BAR = """() => {
    const name = ".mantine-ScrollArea-scrollbar[data-orientation=vertical]";
    const bars = document.querySelectorAll(name);
    const lefts = [...bars].map((bar) => bar.getBoundingClientRect()).filter((box) => box.width);
    return lefts.length ? lefts[0].left : null;
}"""
"""Left border of the scroll bar, CSS px; null while it is not shown."""
RIGHT_END = """Math.max(...[...document.querySelectorAll("button, input, .uplot")]
    .filter((node) => node.checkVisibility()).map((node) => node.getBoundingClientRect().right)
    .filter((right) => right < 300))"""
"""Right border of what lies farthest right in the left panel."""
LABELS_OF = """(values) => {
    const [{ chart }] = Object.values(window.__viserTestpoints.uplots);
    return chart.axes[1].values(chart, values);
}"""
"""Labels of values on the plot's axis."""
SQUEEZED = """() => [...document.querySelectorAll("label, input, button")]
    .filter((node) => !["normal", "0px"].includes(getComputedStyle(node).letterSpacing))
    .map((node) => node.textContent || node.value)"""


ADDRESSES = "www.a.example a.b_c@d.example Https://e.example/f HTTP://g.example www.w.www.x y@z@q.w"


def test_addresses_in_names_are_no_links(browser: Browser) -> None:
    guarded = serve(port=0)
    guarded.server.gui.add_markdown(f"**{plain(ADDRESSES)}** and")
    tab = browser.new_page()
    try:
        tab.goto(guarded.url)
        tab.wait_for_function("document.querySelector('strong')")
        assert tab.text_content("strong") == ADDRESSES
        assert tab.locator("p:has(strong) a").count() == 0
    finally:
        tab.close()
        guarded.stop()


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


@pytest.fixture(scope="module")
def page(browser: Browser, running: RunningApp) -> Iterator[AppPage]:
    with AppPage(browser, running.url, WINDOW) as tab:
        tab.wait_for_text("at this pose")
        yield tab


@pytest.mark.long
def test_first_the_page_says_what_it_is_and_then_what_to_do(
    browser: Browser, running: RunningApp
) -> None:
    page = browser.new_page()
    page.goto(running.url, wait_until="commit")
    page.wait_for_function(f"document.body && {FIRST_WORDS}.includes('poseviewer finds')")
    page.wait_for_function(READY)
    assert page.evaluate(FIRST_WORDS) == "none"
    page.get_by_text("Finds a known 3D model in a photo").wait_for()
    page.close()


def is_mapped(app: App) -> bool:
    """Whether the finest maps about the pose are there."""
    maps, pose = app.session.results.landscapes, app.session.document.pose
    return bool(maps) and maps[0].document.pose is pose and not app._mapper.busy


@pytest.mark.long
def test_maps_that_are_folded_away_are_not_computed_and_stay_so_in_a_page_that_is_loaded_again(
    browser: Browser, running: RunningApp
) -> None:
    app = running.app
    folded = "[data-dock-region=right] [data-dock-column-rail]"

    def is_read() -> bool:
        losses = app.session.results.losses
        return losses is not None and losses.at_pose == app.session.at_pose

    with AppPage(browser, running.url) as tab:
        tab.until(lambda: is_mapped(app))
        tab.page.get_by_role("button", name="Collapse panel area").last.click()
        tab.page.locator(folded).wait_for()
        tab.until(lambda: not app.session.display.sees_maps)
        tab.page.keyboard.press("Shift+ArrowRight")
        tab.until(lambda: not is_mapped(app))
        tab.page.keyboard.press("Shift+ArrowLeft")  # to where the last maps are not about
        tab.until(is_read)
        assert not app._mapper.busy
        assert not is_mapped(app)
        tab.reload()
        tab.page.locator(folded).wait_for()
        assert not is_mapped(app)
        tab.page.locator(folded).get_by_role("button", name="Expand").click()
        tab.until(lambda: is_mapped(app))


@pytest.mark.long
def test_a_calibration_file_is_chosen_in_the_cameras_panel(page: AppPage, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    matrix = [[300.0, 0.0, 82.125], [0.0, 300.0, 57.5], [0.0, 0.0, 1.0]]
    path.write_text(json.dumps({"camera_matrix": matrix, "image_size": [160, 120]}))
    page.open_step(2)
    button = page.page.get_by_role("button", name="Calibration file ...")
    if not button.is_visible():
        page.page.get_by_text("Camera", exact=True).click()
    with page.page.expect_file_chooser() as chooser:
        button.click()
    chooser.value.set_files(str(path))
    page.wait_for_text("the photo's camera was read from camera_matrix, image_size")
    page.until(lambda: page.page.get_by_label("cx (px)").input_value() == "82.125")
    page.open_step(1)  # the notice goes, the note stays
    page.wait_for_text("search again")


def test_the_scroll_bar_covers_nothing(page: AppPage) -> None:
    page.page.set_viewport_size({"width": WINDOW[0], "height": 600})
    page.open_step(3)
    page.page.get_by_text("Settings", exact=True).click()
    page.page.mouse.move(150.0, 400.0)  # there the bar is shown
    page.page.wait_for_function(f"({BAR})() !== null")
    assert page.page.evaluate(f"({BAR})()") >= page.page.evaluate(RIGHT_END)
    page.page.set_viewport_size({"width": WINDOW[0], "height": WINDOW[1]})


def test_no_label_is_squeezed_and_the_plots_last_number_is_whole(page: AppPage) -> None:
    page.open_step(2)
    page.page.get_by_role("button", name="Search (space)").click()
    page.page.get_by_label("Loss", exact=True).wait_for()  # its step opens
    page.page.wait_for_function("Object.keys(window.__viserTestpoints?.uplots ?? {}).length")
    page.page.wait_for_function(f"({LAST_LABEL})() < 0")
    labels = page.page.evaluate(LABELS_OF, [0.239, 0.2395, 0.24, 0.2405])
    assert labels == ["0.2390", "0.2395", "0.2400", "0.2405"]
    assert page.page.evaluate(LABELS_OF, [0.2, 0.4, 0.6000000001]) == ["0.2", "0.4", "0.6"]
    page.page.keyboard.press("Space")
    for step in range(1, 6):
        page.open_step(step)
        assert page.page.evaluate(SQUEEZED) == []


def test_the_icon_opens_help_with_colours_and_not_the_developers_panel(page: AppPage) -> None:
    page.page.get_by_role("button", name="Help", exact=True).click()
    dialog = page.page.get_by_role("dialog")
    dialog.get_by_role("columnheader", name="what it does").wait_for()
    dialog.get_by_text(f"poseviewer {__version__}").wait_for()
    parts = dialog.get_by_role("button", name="Close"), dialog.get_by_role("table")
    close, table = (part.evaluate("node => node.getBoundingClientRect().top") for part in parts)
    assert close < table  # in sight, however long the table is
    assert page.page.get_by_text("Scene tree").filter(visible=True).count() == 0
    for colours in ("Dark", "Light"):
        dialog.get_by_role("button", name=colours).click()
        page.page.locator(f"html[data-mantine-color-scheme={colours.lower()}]").wait_for()
    dialog.get_by_role("button", name="Dark").click()
    page.page.keyboard.press("Escape")
    dialog.wait_for(state="hidden")
    page.page.locator("html[data-mantine-color-scheme=dark]").wait_for()


def test_folders_open_by_keys_and_buttons_of_maps_have_names(page: AppPage) -> None:
    page.open_step(2)
    page.page.get_by_role("button", name="Set here").focus()
    page.page.keyboard.press("Tab")
    folder = page.page.get_by_role("button", name="Numbers", exact=True)
    assert folder.evaluate("node => node === document.activeElement")
    field = page.page.get_by_label("X (unit)")
    for key in ("Enter", "Space"):
        assert folder.get_attribute("aria-expanded") == str(field.is_visible()).lower()
        page.page.keyboard.press(key)
        field.wait_for(state="visible" if key == "Enter" else "hidden")
        opened = str(key == "Enter").lower()
        page.page.wait_for_function(f"document.activeElement.ariaExpanded === '{opened}'")
    assert page.page.get_by_role("button", name="large, and back").count() == 15


def test_a_map_says_the_numbers_under_the_pointer(page: AppPage, running: RunningApp) -> None:
    page.until(lambda: is_mapped(running.app))
    page.page.evaluate(TWO_FRAMES)
    cell = page.page.locator(".pv-cell svg").first
    box = cell.bounding_box()
    assert box is not None
    cell.hover(position={"x": 0.7 * box["width"], "y": 0.9 * box["height"]})
    said = page.page.locator(".pv-tip").inner_text()
    (latest,) = running.app.session.results.landscapes
    first, second = 0, 1  # the upper left map
    piece = next(p for p in latest.slices if (p.first, p.second) == (first, second))
    names = [short_name(latest.problem.chart.names[index]) for index in (first, second)]
    words = dict(part.rsplit(" ", 1) for part in said.split(" · "))
    assert list(words) == [*names, "unexplained"]
    values = [float(number) for number in words.values()]
    shares = 0.7, 0.1
    for share, value, along in zip(
        shares, values, (piece.first_values, piece.second_values), strict=False
    ):
        low, high = along[0], along[-1]
        assert value == pytest.approx(low + share * (high - low), abs=0.02 * (high - low))
    losses = piece.as_shown(latest.problem.scale).losses
    column, row = (round(share * (len(losses) - 1)) for share in shares)
    reach = float(np.ptp(losses))
    assert values[2] == pytest.approx(losses[row, column], abs=max(reach / 64.0, 0.0006))


def test_a_second_tab_says_that_it_is_one(
    browser: Browser, running: RunningApp, page: AppPage
) -> None:
    said = page.page.get_by_text("open in 2 tabs")
    assert said.count() == 0
    with AppPage(browser, running.url) as other:
        other.wait_for_text("open in 2 tabs")
        said.wait_for()
    said.wait_for(state="hidden")


def test_in_a_small_window_the_photo_gets_two_fifths_and_the_maps_are_in_sight(
    page: AppPage, running: RunningApp
) -> None:
    page.until(lambda: is_mapped(running.app))
    width, height = 1280, 720
    page.page.set_viewport_size({"width": width, "height": height})
    page.until(lambda: 160 * 120 * page.view()["scale"] ** 2 > 0.4 * width * height)
    cells = page.page.locator(".pv-cell, .pv-key")
    rights = [box["x"] + box["width"] for one in cells.all() if (box := one.bounding_box())]
    assert len(rights) == 16
    assert max(rights) < width
    page.page.set_viewport_size({"width": WINDOW[0], "height": WINDOW[1]})


def test_a_narrow_window_leaves_its_room_to_the_photo(page: AppPage) -> None:
    maps = page.page.locator(".pv-land")
    maps.wait_for()
    page.page.set_viewport_size({"width": 800, "height": 600})
    page.until(lambda: page.view()["box"][2] > 400)
    assert page.page.locator("html[data-mantine-color-scheme=dark]").count() == 1  # as was chosen
    page.page.set_viewport_size({"width": WINDOW[0], "height": WINDOW[1]})
    maps.wait_for()


@pytest.mark.long
def test_the_tab_survives_a_reload(browser: Browser, running: RunningApp) -> None:
    with AppPage(browser, running.url) as tab:
        tab.open_step(4)
        tab.page.reload()
        tab.page.locator("[role=tab][aria-selected=true]", has_text="Judge").wait_for()
        # One of another app that had this address: the first opens.
        tab.page.evaluate("sessionStorage.setItem('step', 'Elsewhere')")
        tab.reload()
        tab.page.locator("[role=tab][aria-selected=true]", has_text="Place").wait_for()


def test_on_a_phone_the_page_says_that_it_needs_a_mouse_beside_the_panels(
    browser: Browser, running: RunningApp
) -> None:
    with AppPage(browser, running.url, (390, 844), has_touch=True, is_mobile=True) as tab:
        said = "getComputedStyle(document.querySelector('.pv-hint'), '::before').content"
        assert "need a mouse" in tab.page.evaluate(said)
        search = tab.page.get_by_role("button", name="Search (space)")

        def is_above() -> bool:
            box, sheet = tab.page.locator(".pv-hint").bounding_box(), search.bounding_box()
            bottom = 0.0 if box is None else box["y"] + box["height"]
            return sheet is not None and 0.0 < bottom < sheet["y"] and sheet["width"] > 350.0

        tab.until(is_above)
