"""The list of several objects in one photo, in real Chromium."""

import json
import re
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.several import CAMERA, IDS, MESHES, STARTS, TRUTH, make_three

pytestmark = pytest.mark.slow

SIZE = (CAMERA.width, CAMERA.height)


def picked(tab: AppPage) -> str:
    return tab.page.locator(".pv-objects .pv-at td:nth-child(2)").inner_text()


def middle(index: int) -> np.ndarray:
    return TRUTH[index].pose.project(MESHES[index].centre)


def border(index: int, side: int) -> list[float]:
    """The place at the left (-1) or right (1) of an object's outline, in the photo."""
    drawn = STARTS[index].pose.project(MESHES[index].vertices)
    return drawn[np.argmax(side * drawn[:, 0])].tolist()


def colours_of(tab: AppPage) -> list[list[int]]:
    """RGB of the objects in the list."""
    styles = tab.page.locator(".pv-objects i").evaluate_all(
        "all => all.map(i => i.style.background)"
    )
    return [[int(value) for value in re.findall(r"\d+", style)] for style in styles]


def has_colour(tab: AppPage, colour: list[int], place: list[float]) -> bool:
    """Whether a colour is seen about a place in the photo."""
    x, y = tab.on_screen(place, SIZE)
    about = tab.settled_picture((x, y), 12.0).astype(int)
    is_near = np.abs(about - colour).max(axis=-1) < 140  # it is drawn paler
    return int(np.count_nonzero(is_near)) > 5


@pytest.mark.long
def test_objects_are_removed_added_placed_hidden_and_picked(browser: Browser, tmp_path: Path):
    scene = make_three(tmp_path)
    with AppProcess(tmp_path, scene) as app, AppPage(browser, app.url, pixel_ratio=1.0) as tab:
        tab.wait_for_text("at this pose")
        assert tab.verdicts() == dict.fromkeys(IDS, "not searched")
        tab.page.get_by_role("button", name="remove 3").click()
        tab.until(lambda: list(tab.verdicts()) == ["ball", "front"])
        tab.add_object(tmp_path / "apart.ply")
        tab.until(lambda: tab.verdicts().get("apart.ply") == "not placed")
        tab.page.mouse.click(*tab.on_screen(middle(2).tolist(), SIZE))
        tab.until(lambda: tab.verdicts()["apart.ply"] == "not searched")
        # It is far too large: what is hidden stands in front of nothing.
        tab.page.get_by_role("button", name="hide 3").click()
        # A press picks what is in front: the box, where it hides the ball.
        tab.page.mouse.click(*tab.on_screen(middle(1).tolist(), SIZE))
        tab.until(lambda: picked(tab) == "front")
        tab.page.mouse.click(*tab.on_screen((middle(0) - [20.0, 0.0]).tolist(), SIZE))
        tab.until(lambda: picked(tab) == "ball")
        # What is exported of one does not overwrite what is exported of another.
        tab.open_step(5)
        names = set[str]()
        for index, name in enumerate(("ball", "front"), 1):
            tab.page.locator(".pv-objects tr").nth(index - 1).click()
            tab.until(lambda name=name: picked(tab) == name)
            # Whichever is picked, each keeps its colour.
            ball, front, _ = colours_of(tab)
            for place, colour, other in (
                (border(0, -1), ball, front),
                (border(1, 1), front, ball),
            ):
                tab.until(lambda at=place, own=colour: has_colour(tab, own, at))
                tab.until(lambda at=place, not_own=other: not has_colour(tab, not_own, at))
            with tab.page.expect_download() as download:
                tab.page.get_by_role("button", name="Export as ...").click()
            names.add(download.value.suggested_filename)
        assert len(names) == 2
        assert all(name.startswith("three.") for name in names)
        # BOP's numbers are asked for; those that files do not say are guessed.
        tab.page.get_by_label("Format", exact=True).first.click()
        tab.page.get_by_role("option", name="bop", exact=True).click()
        tab.page.get_by_label("Model's unit").first.click()
        tab.page.get_by_role("option", name="cm", exact=True).click()
        tab.page.get_by_role("button", name="Export as ...").click()
        asked = tab.page.get_by_role("dialog").filter(has_text="Numbers in BOP")
        fields = asked.locator("input")
        tab.until(lambda: fields.count() >= 3)
        said = [fields.nth(i).input_value() for i in range(fields.count())]
        assert said == [str(number) for number in range(fields.count())]
        fields.nth(0).fill("12")
        fields.nth(2).fill("1")
        fields.nth(2).press("Tab")
        asked.get_by_role("button", name="Export").click()
        tab.wait_for_text("give each model a number of its own")
        fields.nth(2).fill("34")
        fields.nth(2).press("Tab")
        with tab.page.expect_download() as download:
            asked.get_by_role("button", name="Export").click()
        bop = ZipFile(download.value.path())
        (place,) = (name for name in bop.namelist() if name.endswith("/scene_gt.json"))
        poses = json.loads(bop.read(place))
        assert [pose["obj_id"] for pose in poses["12"]][:2] == [1, 34]
        assert any(name.endswith("/mask_visib/000012_000001.png") for name in bop.namelist())
