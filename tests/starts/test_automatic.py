"""Starts that nobody gives: proposed within a rectangle, and taken up by all who fit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer import api
from poseviewer.cli import main as cli
from poseviewer.confidence.verdict import SURE_FROM
from poseviewer.errors import QuickStartError
from poseviewer.evaluation.cases import Case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.automatic import (
    MIN_OVERLAP,
    StartQuery,
    outermost_points,
    outline_box,
    propose,
    propose_about,
)
from poseviewer.starts.start import StartInputs
from tests.measure.real import careless_box, is_right
from tests.scene import Scene

SIZE = (160, 120)


def wanted(scene: Scene, box, **more) -> StartQuery:
    camera = load_pose(scene.truth, *SIZE).pose.camera
    inputs = StartInputs(load_photo(scene.photo), load_mesh(scene.model), None)
    return StartQuery(inputs, camera, box, **more)


def inputs_of(case: Case) -> StartInputs:
    model = load_model(case.mesh)
    return StartInputs(load_photo(case.photo), model.mesh, model.keypoints)


def box_about(scene: Scene) -> Rectangle:
    return careless_box("scene", load_mesh(scene.model), load_pose(scene.truth, *SIZE).pose)


@pytest.mark.slow
@pytest.mark.long
def test_the_right_pose_is_among_five_that_differ(scene: Scene):
    asked = wanted(scene, box_about(scene))
    found = propose(asked)
    truth = load_pose(scene.truth, *SIZE).pose
    assert any(is_right(pose_error(asked.inputs.mesh, one.pose, truth)) for one in found)
    assert 1 <= len(found) <= 5
    assert [one.loss for one in found] == sorted(one.loss for one in found)
    first, *others = (one.probability for one in found)
    assert sum(others) < first <= 1.0 - sum(others)
    corners = outermost_points(asked.inputs.mesh)
    box = outline_box(truth, corners)
    for index, one in enumerate(found):
        for other in found[:index]:
            away = pose_error(asked.inputs.mesh, one.pose, other.pose)
            assert away.reprojection_px > 0.05 * (box.width + box.height) / 2


@pytest.mark.slow
@pytest.mark.long
def test_fit_and_library_go_on_from_the_best(scene: Scene, tmp_path: Path, capsys):
    box, out = box_about(scene), tmp_path / "out.json"
    code = cli.main(
        ["fit", str(scene.photo), str(scene.model), "--start", "auto", "--focal", "300",
         "--box", ",".join(map(str, box)), "--out", str(out), "--evaluations", "60"]
    )  # fmt: skip
    assert code == 0
    printed = capsys.readouterr().err
    assert "note: start found: proposal " in printed
    mesh, truth = load_mesh(scene.model), load_pose(scene.truth, *SIZE).pose
    # The camera's middle is taken for the photo's, which is 3 px off here.
    assert pose_error(mesh, load_pose(out, *SIZE).pose, truth).percent < 6.0


@pytest.mark.slow
@pytest.mark.long
def test_a_fit_from_a_start_that_is_far_off_ends_right(scene: Scene, monkeypatch):
    """From 100 degrees off it ends at a wrong pose, which is not sure; others are tried then."""
    truth, mesh = load_pose(scene.truth, *SIZE).pose, load_mesh(scene.model)
    turn = np.radians([0.0, 100.0, 0.0, 0.0, 0.0, 0.0])
    start = FreeBodyChart.near(mesh, truth).to_pose(turn)
    end = api.load(scene.photo, scene.model, start).fit()
    assert end.verdict.label == "found"
    assert pose_error(mesh, end.pose, truth).percent < 1.0
    monkeypatch.setattr(api, "propose_about", None)
    alone = api.load(scene.photo, scene.model, start).fit()
    assert alone.verdict.probability < SURE_FROM
    assert pose_error(mesh, alone.pose, truth).percent > 10.0


@pytest.mark.slow
@pytest.mark.long
def test_what_is_like_the_object_elsewhere_is_not_proposed(scene: Scene):
    loaded = api.load(scene.photo, scene.model, scene.start)
    corners, start = outermost_points(loaded.object.mesh), loaded.pose
    away = start.camera_from_model.translation - [0.9, 0.0, 0.0]
    moved = replace(start, camera_from_model=RigidTransform(start.camera_from_model.rotation, away))
    box = outline_box(moved, corners)
    for pose in propose_about(loaded.scene.with_pose(0, moved), 0, 0):
        assert outline_box(pose, corners).overlap(box) > MIN_OVERLAP


@pytest.mark.parametrize("box", [(0, 0, 4, 4), (150, 10, 40, 7), (400, 10, 50, 50)])
def test_a_box_beside_the_photo_is_one_sentence(scene: Scene, box):
    with pytest.raises(QuickStartError, match=r"box .* has no 8x8 px in the photo of 160x120 px"):
        api.load(scene.photo, scene.model, api.AutoStart(box))


def test_without_print_wheels_or_a_box_a_sentence_asks_for_one(scene: Scene):
    with pytest.raises(QuickStartError, match="give the box"):
        propose(wanted(scene, None))


@pytest.mark.parametrize(("is_boxed", "steps"), [(True, 20), (False, 0)])
def test_it_can_be_stopped_between_evaluations(scene: Scene, is_boxed: bool, steps: int):
    done = []

    def watch() -> None:
        done.append(1)
        if len(done) > steps:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        propose(wanted(scene, box_about(scene) if is_boxed else None), watch=watch)
    assert len(done) < 500
