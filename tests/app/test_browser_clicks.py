"""Whole jobs by clicks and keys alone, counted: a car whose wheels have no names, three objects."""

import re
import shutil
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from poseviewer.evaluation.cases import Case
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import WINDOW, AppPage
from tests.measure.jobs import (
    Hand,
    by_marked_wheels,
    save_demo_without_wheels,
    three_objects,
)
from tests.several import CAMERA, IDS, TRUTH, make_three

pytestmark = pytest.mark.slow
MAX_CLICKS_BY_WHEELS = 12
MAX_CLICKS_FOR_THREE = 18
PHOTO = (960, 720)


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


def test_three_objects_with_an_unknown_focal_length_take_few_clicks(
    browser: Browser, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
):
    make_three(tmp_path)
    models = [tmp_path / f"{name}.ply" for name in IDS]
    photo = Path(shutil.copy(tmp_path / "three.png", tmp_path_factory.mktemp("photo")))
    cases = [
        Case(path.stem, "", photo, path, one.pose) for path, one in zip(models, TRUTH, strict=True)
    ]
    with AppProcess(tmp_path, photo, models[0]) as app, AppPage(browser, app.url) as tab:
        tab.wait_for_text("focal length is assumed")
        hand = Hand(tab, cases, photo.parent)
        three_objects(hand)
        tab.open_step(3)
        tab.page.get_by_text("Settings", exact=True).click()
        assert not tab.page.get_by_label("Find the focal length").is_checked()
    (saved,) = photo.parent.glob("*.json")
    scene = load_scene(saved)
    (camera,) = {scene.pose(index, 0).camera for index in range(3)}
    assert isinstance(camera, Perspective)
    assert camera.fx == pytest.approx(CAMERA.fx, rel=0.05)
    assert all(item.result is not None for item in scene.objects)
    assert hand.clicks <= MAX_CLICKS_FOR_THREE
