"""The paper's search in the page, and both methods side by side: real Chromium on the demo."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest
from playwright.sync_api import Browser
from playwright.sync_api import TimeoutError as NotInTime

from poseviewer.api import load
from poseviewer.files.demo import demo_case
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture

pytestmark = pytest.mark.slow

EVALUATIONS = 60
"""Of each method: a browser without a GPU leaves little time for them."""
MAPS = 15
PRESS_MS = 5000
DOTS = "document.querySelectorAll('.pv-cell .pv-dots').length"
CORNERS = """() => [...document.querySelectorAll('.pv-cell .pv-dots')].map(
    dots => dots.lastChild.getAttribute('d').split('M').length - 1)"""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppProcess]:
    with AppProcess(tmp_path_factory.mktemp("demo"), "--method", "paper") as app:
        yield app
        assert app.interrupt() == 0


@pytest.fixture(scope="module")
def tab(browser: Browser, demo: AppProcess) -> Iterator[AppPage]:
    opened = AppPage(browser, demo.url)
    opened.wait_for_text("at this pose")
    opened.open_step(3)
    yield opened
    opened.page.close()


@pytest.fixture
def page(tab: AppPage) -> Iterator[AppPage]:
    """One tab for all tests; each leaves the methods and the maps as they were."""
    yield tab
    assert tab.errors == []


def choose(page: AppPage, label: str, option: str) -> None:
    """One of a dropdown's options; on a busy machine its list may close at a second press."""
    wanted = page.page.get_by_role("option", name=option, exact=True)

    def is_chosen() -> bool:
        page.page.get_by_label(label, exact=True).click()
        with suppress(NotInTime):
            wanted.click(timeout=PRESS_MS)
        return chosen(page, label) == option

    page.until(is_chosen)
    page.page.evaluate("document.activeElement.blur()")


def chosen(page: AppPage, label: str) -> str:
    """What a dropdown shows."""
    return page.page.get_by_label(label, exact=True).input_value()


def limit(page: AppPage, evaluations: int) -> None:
    """Of the searches to come."""
    settings = page.page.get_by_text("Settings", exact=True)
    settings.click()
    field = page.page.get_by_label("Most evaluations")
    field.fill(str(evaluations))
    field.press("Enter")
    settings.click()
    page.page.evaluate("document.activeElement.blur()")


def test_the_papers_search_runs_in_the_page_and_its_simplex_is_on_the_maps(
    page: AppPage, demo: AppProcess
):
    assert chosen(page, "Method") == "Jayawardena 2010"
    page.until(lambda: chosen(page, "Pixels") == "what the model covers")
    page.wait_for_text("Jayawardena 2010, clipped")  # over the maps
    page.page.keyboard.press("Space")
    # A corner more than there are parameters, on every map: the first simplex is small.
    page.page.wait_for_function(f"{DOTS} === {MAPS}")
    assert page.page.evaluate(CORNERS) == MAPS * [7]
    keep_picture(page, "paper")
    page.page.keyboard.press("Space")
    page.wait_for_text("Stopped: the best pose so far is shown")
    page.page.wait_for_function(f"{DOTS} === 0")
    found = page.saved_pose(demo.folder / "demo_photo.pose.json")
    settings = found["settings"]
    assert (settings["method"], settings["pixels"], settings["grey"]) == ("paper", "clip", True)
    case = demo_case()
    fitted = load(case.photo, case.model, case.start, method="paper")
    pose = fitted.problem.chart.to_pose(np.array(found["chart"]["numbers"]))
    assert fitted.at(pose).loss == pytest.approx(found["loss"], abs=1e-6)
    page.page.get_by_role("button", name="Go back").click()
    choose(page, "Method", "classes and edges")


def test_both_methods_are_compared_and_either_end_can_be_taken(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.pose.json"
    limit(page, EVALUATIONS)
    page.page.keyboard.press("ArrowRight")
    before = page.saved_pose(path)
    page.page.get_by_role("button", name="Compare both methods").click()
    page.wait_for_text("px apart")
    keep_picture(page, "ends")
    table = page.page.locator(".pv-ends-table tbody tr")
    rows = {row[0]: row[1:] for row in table.evaluate_all(CELLS)}
    assert rows["evaluations"] == [str(EVALUATIONS)] * 2
    taken = {}
    for name, method in (("classes and edges", "default"), ("Jayawardena 2010", "paper")):
        page.page.get_by_role("button", name=name, exact=True).click()
        page.until(lambda name=name: chosen(page, "Method") == name)
        taken[method] = page.saved_pose(path)
        assert taken[method]["settings"]["method"] == method
    assert f"{taken['paper']['loss']:.3f}" == rows["Jayawardena 2010: loss (of 1)"][1]
    assert json.dumps(taken["paper"]["camera_from_model"]) != json.dumps(
        taken["default"]["camera_from_model"]
    )
    for _ in range(3):
        page.page.keyboard.press("z")
    page.until(lambda: page.saved_pose(path)["chart"] == before["chart"])


CELLS = "rows => rows.map(row => [...row.cells].map(cell => cell.textContent))"
