"""A whole job by clicks and keys alone, counted: a car whose wheels have no names."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from poseviewer.evaluation.cases import Case
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import WINDOW, AppPage
from tests.measure.jobs import (
    Hand,
    by_marked_wheels,
    save_demo_without_wheels,
)

pytestmark = pytest.mark.slow
MAX_CLICKS_BY_WHEELS = 12
PHOTO = (960, 720)


@pytest.mark.long
def test_a_car_without_named_wheels_takes_few_clicks(browser: Browser, tmp_path: Path):
    demo = demo_case()
    model, truth = load_model(demo.model), load_pose(demo.truth, *PHOTO).pose
    assert model.keypoints is not None
    path = save_demo_without_wheels(tmp_path / "car.glb")
    case = Case("car", "", demo.photo, path, truth)
    with AppProcess(tmp_path, demo.photo, path) as app, AppPage(browser, app.url) as tab:
        tab.wait_for_text("mark the wheels of the model once")
        hand = Hand(tab, [case], tmp_path)
        by_marked_wheels(hand, model.keypoints)
        tab.wait_for_text(".keypoints.json")  # what is written is said
        tab.wait_for_text("at this pose")
        values = re.findall(r"unexplained (\d\.\d+)", tab.page.inner_text("body"))
        assert len(set(values)) == 1  # a pose has one value
        tab.page.keyboard.press("z")
        tab.page.keyboard.press("y")
        tab.wait_for_text(f"unexplained {values[0]} at this pose")
        tab.open_step(2)
        camera = tab.page.get_by_text("Camera", exact=True).bounding_box()
        assert camera is not None
        assert camera["y"] + camera["height"] < WINDOW[1]  # below the proposals, and in sight
    (saved,) = tmp_path.glob("*.pose.json")
    assert pose_error(model.mesh, load_pose(saved, *PHOTO).pose, truth).percent < 2.0
    assert hand.clicks <= MAX_CLICKS_BY_WHEELS
    assert len(list(tmp_path.glob("*.keypoints.json"))) == 1
