"""Jobs are done in the browser, and their clicks, errors and verdicts counted."""

import shutil
from pathlib import Path

import pytest

from poseviewer.evaluation.cases import Case
from poseviewer.evaluation.photos import demo_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, open_browser
from tests.measure import jobs
from tests.several import CAMERA, IDS, TRUTH, make_three

MAX_CLICKS_FOR_THREE = 18


def test_the_error_is_that_of_the_pose_that_was_saved(scene, tmp_path):
    truth, start = (load_pose(path, 160, 120).pose for path in (scene.truth, scene.start))
    shutil.copy(scene.start, tmp_path)
    case = Case("ball", "scene", scene.photo, scene.model, truth)
    error, verdicts = jobs.ends_in(tmp_path, [case])
    assert error == pytest.approx(pose_error(load_model(scene.model).mesh, start, truth).percent)
    assert verdicts == "-"


@pytest.mark.slow
def test_a_job_of_more_clicks_than_it_may_take_is_found(monkeypatch, capsys):
    monkeypatch.setattr(jobs, "case_of", lambda _: demo_photo("photo-perspective"))
    least = "demo", jobs.photo_and_model, jobs.by_box, 3
    monkeypatch.setattr(jobs, "JOBS", {"box": least})
    with open_browser() as browser:
        assert not jobs.do("box", browser)
    assert capsys.readouterr().out.startswith("box: 4 of 3 clicks, ")


@pytest.mark.slow
def test_three_objects_with_an_unknown_focal_length_take_few_clicks(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
):
    make_three(tmp_path)
    models = [tmp_path / f"{name}.ply" for name in IDS]
    photo = Path(shutil.copy(tmp_path / "three.png", tmp_path_factory.mktemp("photo")))
    cases = [
        Case(path.stem, "", photo, path, one.pose) for path, one in zip(models, TRUTH, strict=True)
    ]
    with (
        open_browser() as browser,
        AppProcess(tmp_path, photo, models[0]) as app,
        AppPage(browser, app.url) as tab,
    ):
        tab.wait_for_text("focal length is assumed")
        hand = jobs.Hand(tab, cases, photo.parent)
        jobs.three_objects(hand)
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
