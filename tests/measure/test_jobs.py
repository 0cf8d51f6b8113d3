"""Jobs are done in the browser, and their clicks, errors and verdicts counted."""

import shutil

import pytest

from poseviewer.evaluation.cases import Case
from poseviewer.evaluation.photos import demo_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.pose_error import pose_error
from tests.app.browser import open_browser
from tests.measure import jobs


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
