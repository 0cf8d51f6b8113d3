"""Every step in windows of several sizes: main buttons are in sight, no label is cut, and nothing
lies over anything else.
"""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from poseviewer.files.demo import demo_case
from tests.app.app_process import AppProcess
from tests.app.browser import LOOK_AGAIN_MS, AppPage
from tests.several import make_three
from tests.view_sets import write_views

pytestmark = pytest.mark.slow
TROUBLES = """() => {
    const box = (node) => node.getBoundingClientRect();
    const name = (node) =>
        (node.ariaLabel || node.textContent || node.value || node.outerHTML).trim().slice(0, 60);
    const shown = (node) => node.checkVisibility({ opacityProperty: true }) && box(node).width > 0;
    const nodes = [...document.querySelectorAll(`button:not(.pv-cell button), input, .pv-hint,
        .pv-cell, .pv-col, .pv-row, .pv-key, .pv-marks span, .pv-result :is(td, th), .pv-loss span,
        .pv-objects td, .pv-strip, .pv-said :is(b, span), [role=tab] span`)].filter(shown);
    const cut = nodes.filter((node) => box(node).right > innerWidth + 1
        || node.scrollWidth > node.clientWidth + 1 && !node.matches(".pv-strip")
        && getComputedStyle(node).display !== "inline");
    const over = [];
    const boxes = nodes.map(box);
    boxes.forEach((a, i) => boxes.slice(i + 1).forEach((b, k) => {
        const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
        const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
        const [one, other] = [nodes[i], nodes[i + 1 + k]];
        if (width <= 2 || height <= 2 || one.contains(other) || other.contains(one)) return;
        over.push(`${name(one)} | ${name(other)}`);
    }));
    const title = (node) =>
        node.querySelector(":scope > .mantine-Paper-root > .tabler-icon-chevron-down")?.parentNode;
    const empty = [...document.querySelectorAll(".mantine-Paper-root")].filter((node) =>
        title(node) && shown(node) && box(title(node)).top < box(node).top - 1);
    return [...cut.map((node) => `cut: ${name(node)}`), ...over,
        ...empty.map((node) => `empty: ${name(node)}`)];
}"""
"""Labels that are cut, pairs of which one lies over the other, folders beside their names."""
Size = tuple[int, int]
LARGER_TEXT = """document.documentElement.style.fontSize = "138.75%";"""
"""Half as large again as viser's."""
WINDOWS: dict[str, list[Size]] = {
    "usual": [(1280, 720), (2560, 1440)],
    "larger text": [(1500, 900)],
}
"""Sizes of the window that the page gets in turn."""
SETTLING_LOOKS = 20
"""Looks at a page, each ``LOOK_AGAIN_MS`` after the one before, until a trouble counts."""
MAIN = {
    1: ["Photo ..."],
    2: ["Fit to box", "Search (space)", "Camera"],
    3: ["Search (space)", "Hide what", "Compare the losses", "Settings"],
    4: [],
    5: ["Save "],
}
"""Names of main buttons and folders by their steps."""
LONG_NAME = "porsche-2010-05-17-a.png"


def write_not_placed(_folder: Path) -> list[str | Path]:
    return [demo_case().photo, write_views(_folder)[1]]  # the demo's own is found by its wheels


def write_seven_numbers(_folder: Path) -> list[str | Path]:
    case = demo_case()
    return [case.photo, case.model, "--pose", case.start]


def write_three_objects(folder: Path) -> list[str | Path]:
    return [make_three(folder)]


def write_three_photos(folder: Path) -> list[str | Path]:
    views, model, start = write_views(folder)
    for path in (views, start):
        path.write_text(path.read_text().replace('"a.png"', f'"{LONG_NAME}"'))
    (folder / "a.png").rename(folder / LONG_NAME)
    return ["--views", views, model, "--pose", start]


def search_for_seven_numbers(tab: AppPage) -> None:
    tab.open_step(3)
    tab.page.get_by_text("Settings", exact=True).click()
    tab.page.get_by_label("Find the focal length").check()
    tab.page.get_by_role("button", name="Search (space)").filter(visible=True).click()
    tab.wait_for_text("Verdict:")
    tab.page.get_by_text("Settings", exact=True).click()


CASES = {
    "not placed": (write_not_placed, MAIN),
    "seven numbers": (write_seven_numbers, {**MAIN, 3: ["Keep it", *MAIN[3]]}),
    "three objects": (write_three_objects, MAIN),
    "three photos": (write_three_photos, MAIN),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_main_buttons_are_in_sight_and_nothing_is_cut_or_covered(
    name: str, browser: Browser, tmp_path: Path
) -> None:
    (write, steps), troubles = CASES[name], []
    with (
        AppProcess(tmp_path, *write(tmp_path)) as app,
        AppPage(browser, app.url, WINDOWS["usual"][0]) as tab,
    ):
        tab.wait_for_text("unexplained" if name != "not placed" else "is not placed yet")
        state = "hidden" if name == "not placed" else "visible"
        tab.page.locator(".pv-land").wait_for(state=state)
        if name == "seven numbers":
            search_for_seven_numbers(tab)
        for window, sizes in WINDOWS.items():
            if window == "larger text":
                enlarge_text(tab)
            for size in sizes:
                tab.page.set_viewport_size({"width": size[0], "height": size[1]})
                for step, buttons in steps.items():
                    tab.open_step(step)
                    of_step = _troubles(tab, buttons, size[1])
                    troubles += [f"{window} {size}, step {step}: {words}" for words in of_step]
    assert not troubles, "\n".join(troubles)


def enlarge_text(tab: AppPage) -> None:
    """The app hears of the size of text with the colours that the browser prefers."""
    tab.page.evaluate(LARGER_TEXT)
    tab.page.emulate_media(color_scheme="dark")
    tab.page.locator("html[data-mantine-color-scheme=dark]").wait_for()


def _troubles(tab: AppPage, buttons: list[str], height: int) -> list[str]:
    """Troubles that are still there once the page has laid itself out."""
    for _ in range(SETTLING_LOOKS):
        troubles = tab.page.evaluate(TROUBLES)
        for button in buttons:
            folder = tab.page.get_by_text(button, exact=True)
            place = tab.page.get_by_role("button", name=button).or_(folder)
            place = place.filter(visible=True).first
            place.wait_for()
            box = place.bounding_box()
            assert box is not None
            if box["y"] + box["height"] > height:
                troubles.append(f"{button} is below")
        if not troubles:
            break
        tab.page.wait_for_timeout(LOOK_AGAIN_MS)
    return troubles
