"""The paper's search in the page: real Chromium on the demo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser

from poseviewer.api import load
from poseviewer.files.demo import demo_case
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture

pytestmark = pytest.mark.slow

MAPS = 15
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


def chosen(page: AppPage, label: str) -> str:
    """What a dropdown shows."""
    return page.page.get_by_label(label, exact=True).input_value()


def test_the_papers_search_runs_in_the_page_and_its_simplex_is_on_the_maps(
    page: AppPage, demo: AppProcess
):
    assert chosen(page, "Method") == "Paper (2010)"
    page.until(lambda: chosen(page, "Pixels") == "inside the model")
    page.wait_for_text("Paper (2010), pixels inside the model")  # over the maps
    page.page.keyboard.press("Space")
    # A corner more than there are parameters, on every map: the first simplex is small.
    page.page.wait_for_function(f"{DOTS} === {MAPS}")
    assert page.page.evaluate(CORNERS) == MAPS * [7]
    keep_picture(page, "paper")
    page.page.keyboard.press("Space")
    page.wait_for_text("Stopped: the best pose so far is shown")
    page.page.wait_for_function(f"{DOTS} === 0")
    found = page.saved(demo.folder / "demo_photo.pose.json")
    settings = found["settings"]
    assert (settings["method"], settings["pixels"], settings["grey"]) == ("paper", "clip", True)
    case = demo_case()
    fitted = load(case.photo, case.model, case.start, method="paper")
    pose = fitted.problem.chart.to_pose(np.array(found["chart"]["numbers"]))
    assert fitted.at(pose).loss == pytest.approx(found["loss"], abs=1e-6)
