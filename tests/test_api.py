"""poseviewer as a library: the lines of the README, and what a script may get wrong."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import poseviewer
from poseviewer.api import make_registration
from poseviewer.files.demo import demo_case
from poseviewer.files.keypoints import keypoints_path
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.settings import Limits
from tests.commands import run
from tests.several import make_three
from tests.view_sets import DISTANCE, MESH, START, TRUTH, make_views

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.mark.slow
@pytest.mark.long
def test_the_lines_of_the_readme_find_the_pose_of_the_demo(tmp_path, monkeypatch, capsys):
    case = demo_case()
    # At half its size: the same pose, and a test of seconds.
    photo = load_photo(case.photo)
    save_image(tmp_path / "photo.jpg", photo.as_rgb8(photo.width // 2, photo.height // 2))
    start = load_pose(case.start, photo.width, photo.height)
    save_pose(tmp_path / "start.json", PoseRecord.of(start.pose.rescale(0.5)))
    shutil.copy(case.model, tmp_path / "car.glb")
    shutil.copy(keypoints_path(case.model), keypoints_path(tmp_path / "car.glb"))
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(lines[0], "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("found ")
    found = load_pose(tmp_path / "pose.json", photo.width // 2, photo.height // 2).pose.rescale(2.0)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    assert pose_error(load_model(case.model).mesh, found, truth).percent < 1.0
    assert (tmp_path / "maps.png").stat().st_size > 10_000
    assert (tmp_path / "residual.png").stat().st_size > 10_000


def test_importing_costs_nothing_until_a_name_is_asked_for():
    code = (
        "import sys, poseviewer; heavy = {'numpy', 'cv2', 'numba', 'scipy', 'matplotlib'};"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules);"
        "poseviewer.load; assert 'numpy' in sys.modules;"
        "assert 'matplotlib' not in sys.modules and 'viser' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_fit_improves_on_its_start_and_is_the_command_lines_own(scene, tmp_path):
    found = poseviewer.load(scene.photo, scene.model, scene.start).fit(evaluations=200)
    assert found.loss < found.start.loss
    moved = found.at(found.start.pose)
    assert (moved.record.verdict, moved.loss > found.loss) == (None, True)
    assert found.settings == found.start.settings  # the limit was that of the one search
    found.save(tmp_path / "library.json")
    line = ("fit", scene.photo, scene.model, "--pose", scene.start, "--evaluations", 200)
    assert run(*line, "--out", tmp_path / "cli.json", "--quiet") == 0
    ours, theirs = (load_pose(tmp_path / f"{n}.json", 160, 120) for n in ("library", "cli"))
    np.testing.assert_array_equal(
        ours.pose.camera_from_model.rotation, theirs.pose.camera_from_model.rotation
    )
    assert ours.loss == theirs.loss


def test_a_search_is_the_fit_as_it_goes(scene):
    case = poseviewer.load(scene.photo, scene.model, scene.start, limits=Limits(200))
    steps = [now.progress for now in case.search()]
    assert all(step.status is Status.RUNNING for step in steps[:-1])
    assert steps[0].evaluations == 1
    found = case.fit()
    assert steps[-1].loss == found.loss
    assert steps[-1].verdict == found.verdict
    assert steps[-1].evaluations == found.evaluations
    assert np.array_equal(steps[-1].parameters, found.parameters)


def test_a_result_of_several_objects_has_a_part_for_each(tmp_path):
    result = poseviewer.load(make_three(tmp_path)).fit(evaluations=5)
    ids = [item.id for item in result.scene.objects]
    assert result.evaluations == sum(result[name].evaluations for name in ids) > 0
    assert result[ids[1]].start.object is result.start.scene.objects[1]
    with pytest.raises(poseviewer.PoseViewerError, match="say which"):
        _ = result.pose


def test_what_is_not_placed_is_not_searched_for(tmp_path):
    scene = poseviewer.load(make_three(tmp_path)).scene
    scene = scene.with_object(0, is_placed=False)
    registration = make_registration(scene)
    name = scene.objects[0].label
    assert f"{name} is not placed: no search moves it." in registration.notes
    result = registration.fit(evaluations=5)
    assert [index for index, item in enumerate(result.scene.objects) if item.result] == [1, 2]
    with pytest.raises(poseviewer.PoseViewerError, match="not placed, so there is no start"):
        registration[scene.objects[0].id].fit(evaluations=5)


def test_an_interrupted_search_keeps_the_best_pose_or_ends(scene):
    """Ctrl-C once the second population has been asked for."""
    losses: list[float] = []

    def watch(progress: FitProgress) -> None:
        losses.append(progress.loss)
        if len(losses) == 80:
            raise KeyboardInterrupt

    case = poseviewer.load(scene.photo, scene.model, scene.start)
    found = case.fit(watch=watch, interruptible=True)
    assert found.stopped
    assert found.loss == losses[-1] < case.start.loss
    assert found.verdict is not None
    losses.clear()
    with pytest.raises(KeyboardInterrupt):
        case.fit(watch=watch)
    assert len(losses) == 80


def test_the_lines_of_the_docs_start_from_point_pairs(tmp_path, monkeypatch):
    case = demo_case()
    shutil.copy(case.photo, tmp_path / "photo.jpg")
    shutil.copy(case.model, tmp_path / "car.glb")
    photo = load_photo(case.photo)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    points = load_model(case.model).mesh.vertices[::20_000]
    pixels = truth.project(points) - 0.5  # the file's pixel centres are at integers
    np.savetxt(tmp_path / "pairs.csv", np.hstack([points, pixels]), delimiter=",")
    text = (REPOSITORY / "assets" / "docs" / "library.md").read_text(encoding="utf-8")
    (lines,) = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL)
                if "start_from_pairs" in block]  # fmt: skip
    assert isinstance(truth.camera, Perspective)
    lines = lines.replace("1380.0", str(truth.camera.fx))
    monkeypatch.chdir(tmp_path)
    names = {"poseviewer": poseviewer}
    exec(compile(lines, "library.md", "exec"), names)
    start = names["placed"].pose
    assert pose_error(load_model(case.model).mesh, start, truth).percent < 0.5


def test_settings_are_given_by_name_and_kept_in_the_record(scene):
    case = poseviewer.load(scene.photo, scene.model, scene.start, grey=True, pixels="clip")
    settings = case.record.settings
    assert settings is not None
    assert (settings["grey"], settings["pixels"]) == (True, "clip")
    given = replace(case.settings, seed=3)
    assert poseviewer.load(scene.photo, scene.model, scene.start, given).settings.seed == 3


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"gray": True}, "no setting 'gray'"),
        ({"photo": "no.jpg"}, "no such file"),
        ({"pixels": "some"}, "take one of near, whole, clip"),
        ({"model": None}, "with a model and a start"),
        ({"model": None, "start": None, "mask": "m.png"}, "mask= with a scene file"),
        ({"photo": "set.json", "calibration": "cam.yml"}, "calibration= with a set of photos"),
        ({"photo": "set.json", "start": "auto"}, "searched for with a set of photos"),
        ({"calibration": "cam.yml"}, "cam.yml: no such file"),
        ({"start": "small"}, "80x60 px, and p.png has 160x120"),
    ],
)
def test_mistakes_are_one_sentence(scene, changes, said):
    given = {"photo": scene.photo, "model": scene.model, "start": scene.start} | changes
    if given["start"] == "small":
        given["start"] = load_pose(scene.start, 160, 120).pose.rescale(0.5)
    with pytest.raises(poseviewer.PoseViewerError, match=said):
        poseviewer.load(**given)


@pytest.mark.slow
@pytest.mark.long
def test_a_camera_that_contradicts_the_others_is_named_and_does_no_harm():
    good = make_views()
    turn = RigidTransform.from_rotation_vector([0.0, np.radians(3.0), 0.0], np.zeros(3))
    wrong = replace(good.views[2], camera_from_world=turn @ good.views[2].camera_from_world)
    views, model = (
        replace(good, views=(*good.views[:2], wrong)),
        ModelFile.of(MESH, None, "", name="m"),
    )
    choice = poseviewer.SetChoice(view="a.png")
    found = poseviewer.load(views, model, START, choice=choice, limits=Limits(1500)).fit()
    assert found.verdict is not None
    assert found.verdict.label != "found"
    assert found.record.notes[0].startswith("c.png goes least with the others")
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (found.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.003 * DISTANCE


def test_the_citation_names_this_version():
    citation = (REPOSITORY / "poseviewer" / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {poseviewer.__version__}\n" in citation
    assert "Illumination-Invariant Loss" in citation
