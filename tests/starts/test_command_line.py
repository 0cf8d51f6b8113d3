"""``poseviewer fit`` from marks on the photo instead of a pose file."""

from pathlib import Path

import numpy as np
import pytest

from poseviewer.errors import QuickStartError
from poseviewer.files.demo import demo_case
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.marks import wheels_from_text
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.starts.start import StartCamera, StartInputs
from poseviewer.starts.wheels import find_wheel_pairs, likely_wheels, start_from_wheels
from tests.commands import refusal, run
from tests.measure.real import careless_box
from tests.scene import Scene

SIZE = (160, 120)
WHEELS = "740,432,50,34,99;401,477,61,50,106"
"""Wheels of the demo, laid by eye: to a pixel and a degree."""


def write_pairs(scene: Scene, folder: Path, count: int) -> Path:
    truth = load_pose(scene.truth, *SIZE).pose
    points = load_mesh(scene.model).vertices[:: 640 // count][:count]
    rows = np.hstack([points, truth.project(points) - 0.5])
    path = folder / "pairs.csv"
    np.savetxt(path, rows, delimiter=",", header="x,y,z,u,v", comments="")
    return path


@pytest.mark.parametrize("more", [(), ("--free-focal",)])
def test_pairs_lead_into_the_search(scene: Scene, tmp_path: Path, capsys, more):
    path, out = write_pairs(scene, tmp_path, 8), tmp_path / "out.json"
    line = "fit --evaluations 40 --focal 300 --pairs", path, scene.photo, scene.model, "--out", out
    assert run(*line, *more) == 0
    printed = capsys.readouterr().err
    assert "start from 8 point pairs, off by 0.0, 0.0" in printed
    assert ("focal length from the pairs: 30" in printed) == bool(more)
    found, truth = (load_pose(p, *SIZE).pose for p in (out, scene.truth))
    # The camera's middle is taken for the photo's, which is 3 px off here.
    assert pose_error(load_mesh(scene.model), found, truth).percent < 4.0


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            ("--pairs", "PAIRS"),
            "3 point pairs (of different model points); a pose needs at least 4",
        ),
        (("--pairs", "none.csv"), "none.csv: no such file"),
        (("--wheels", WHEELS), "The model has no wheels that poseviewer knows of"),
        (("--wheels", "1,2;3"), "the rear wheel has 2 values"),
        ((), "a start is wanted: give --pose"),
    ],
)
def test_marks_that_give_no_start_are_one_sentence(scene: Scene, tmp_path, capsys, more, words):
    path, out = write_pairs(scene, tmp_path, 3), tmp_path / "out.json"
    more = [path if word == "PAIRS" else word for word in more]
    assert words in refusal(capsys, "fit", scene.photo, scene.model, "--out", out, *more)
    assert not out.exists()


def opened(photo: Path, model: Path) -> StartInputs:
    mesh = load_mesh(model)
    return StartInputs(load_photo(photo), mesh, load_keypoints(model, mesh))


def test_wheels_laid_by_eye_place_the_demo():
    case = demo_case()
    inputs = opened(case.photo, case.model)
    start = start_from_wheels(inputs, wheels_from_text(WHEELS), StartCamera())
    truth = load_pose(case.truth, inputs.photo.width, inputs.photo.height).pose
    assert pose_error(inputs.mesh, start.pose, truth).percent < 4.0


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("projection", "is_guess"), [("perspective", True), ("parallel", False)])
def test_wheels_in_a_careless_rectangle_place_the_demo(projection: str, is_guess: bool):
    case = demo_case(projection)
    inputs = opened(case.photo, case.model)
    truth = load_pose(case.truth, inputs.photo.width, inputs.photo.height).pose
    require_placed(inputs, projection, truth, is_guess, 2.0)


def require_placed(inputs: StartInputs, name: str, truth: Pose, is_guess: bool, percent: float):
    """The wheels found in a careless rectangle give the pose, to some per cent."""
    camera = inputs.photo.default_camera() if is_guess else truth.camera
    found = likely_wheels(inputs, careless_box(name, inputs.mesh, truth), camera, is_guess)[0]
    assert pose_error(inputs.mesh, found.fit.pose, truth).percent < percent
    assert found.fit.from_above


@pytest.mark.parametrize(
    ("rectangle", "words"),
    [((0, 0, 300, 120), "No two wheels were found"), ((2000, 0, 50, 50), "has no 16x16 px")],
)
def test_where_no_wheels_are_that_is_said(rectangle, words: str):
    grey = np.tile(np.linspace(0.2, 0.9, 400, dtype=np.float32), (200, 1))
    with pytest.raises(QuickStartError, match=words):
        find_wheel_pairs(grey, rectangle)
