"""Fits from estimates of a BOP data set: the scores, and the study as a command."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from poseviewer.evaluation.report import THRESHOLDS, average_recall
from poseviewer.evaluation.trials import symmetric_distances
from poseviewer.files.formats.bop import BopObject
from poseviewer.files.formats.bop_models import RESULTS, load_bop_models
from poseviewer.files.pose import load_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.symmetry_group import NO_SYMMETRY
from poseviewer.geometry.transform import RigidTransform
from tests.commands import read_rows, run
from tests.scene import Scene
from tests.several import write_bop_scene
from tests.writing import write

HALF_TURN = [-1, 0, 0, 2, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
"""About the axis through (1, 0, 0) along z."""
CAMERA = Perspective(600.0, 600.0, 320.0, 240.0, 640, 480)
CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 3.0, 1.0], [1.0, -3.0, 1.0]])


def write_models(path: Path, **of_object_1) -> Path:
    return write(path, {"1": {"diameter": 4.0, **of_object_1}, "2": {"diameter": 4.0}})


def test_a_symmetry_is_no_error(tmp_path: Path) -> None:
    info = write_models(tmp_path / "i.json", symmetries_discrete=[HALF_TURN])
    model = load_bop_models(info)[1]
    truth = Pose(CAMERA, RigidTransform.from_rotation_vector([0.1, 0.2, 0.3], [0.0, 0.0, 50.0]))
    turned = Pose(CAMERA, truth.camera_from_model @ model.symmetry.transforms()[1])
    assert symmetric_distances(CORNERS, turned, truth, NO_SYMMETRY)[0] > 5.0
    off = symmetric_distances(CORNERS, turned, truth, model.symmetry)
    np.testing.assert_allclose(off, (0.0, 0.0), atol=1e-9)
    aside = RigidTransform(np.eye(3), np.array([0.5, 0.0, 0.0]))
    moved = Pose(CAMERA, aside @ turned.camera_from_model)
    in_space, in_picture = symmetric_distances(CORNERS, moved, truth, model.symmetry)
    assert in_space == pytest.approx(0.5)
    assert 5.0 < in_picture < 7.0  # 600 * 0.5 / 50, and nearer corners more


def test_recall_is_a_mean_over_thresholds_and_targets() -> None:
    # Within all ten, within nine of ten, within none; of one no estimate is there.
    expected = (1.0 + 0.9 + 0.0) / 4
    recall = average_recall(np.array([4.0, 6.0, 60.0]), THRESHOLDS["mspd"], 4)
    assert recall == pytest.approx(expected)


def write_data_set(folder: Path, scene: Scene, is_second_turned: bool = False) -> Path:
    """One photo of one object; of the second there is no estimate, or one that is far off."""
    numbers, truth = (1, 2), load_pose(scene.truth, 160, 120).pose
    write_models(folder / "models/models_info.json")
    for number in numbers:
        shutil.copy(scene.model, folder / f"models/obj_{number:06d}.ply")
    objects = [BopObject(number, truth.camera_from_model) for number in numbers]
    camera = Perspective(300.0, 300.0, 83.0, 58.0, 160, 120)
    write_bop_scene(folder / "test/000002", camera, {3: scene.photo}, {3: objects})
    own = load_pose(scene.start, 160, 120).pose.camera_from_model
    start = [" ".join(map(str, np.ravel(part))) for part in (own.rotation, own.translation)]
    rows = ["2,3,1,0.1,1 0 0 0 1 0 0 0 1,9 9 9,-1", f"2,3,1,0.9,{','.join(start)},-1"]
    if is_second_turned:
        turn = RigidTransform.from_rotation_vector([2.0, 1.0, 0.0], [0.0, 0.0, 0.0])
        start[0] = " ".join(map(str, (own @ turn).rotation.ravel()))
        start[1] = " ".join(map(str, np.add(own.translation, [2.5, 0.0, 0.0])))
        rows.append(f"2,3,2,0.9,{','.join(start)},-1")
    return write(folder / "estimates/some.csv", "\n".join([",".join(RESULTS), *rows, ""]))


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("|")[1:-1]]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("is_second_turned", [False, True])
def test_estimates_are_fitted_scored_and_kept_if_the_fit_is_not_sure(
    scene, tmp_path, is_second_turned
):
    table, out = write_data_set(tmp_path / "set", scene, is_second_turned), tmp_path / "out"
    assert run("study --jobs 1 --quiet --bop", table, "--out", out) == 0
    right, *turned = read_rows(out / "trials.csv")
    assert (right["case"], right["set"]) == ("2/3/1", "object 1")
    widened = 640.0 / 160.0  # scores are of photos 640 px wide
    assert float(right["mspd_end"]) < 1.0 * widened < float(right["mspd_start"])
    assert float(right["mssd_end"]) < 0.1 * float(right["mssd_start"])
    head, _, overall, own, *_ = map(cells, (out / "study.md").read_text().splitlines()[4:])
    values = dict(zip(head, overall, strict=True))
    assert (values["targets"], values["n"]) == ("all targets", "2")
    assert overall[4] == "0.500"  # MSSD after: of the other target none, or a wrong estimate
    assert own[4] == "1.000"
    assert values["estimate kept, %"].startswith("50 (" if is_second_turned else "0 (")
    for row in turned:
        assert row["status"] == "KEPT"
        assert float(row["mspd_start"]) > 10.0
        assert all(row[f"{name}_end"] == row[f"{name}_start"] for name in ("mspd", "mssd", "loss"))
    assert len(turned) == is_second_turned
