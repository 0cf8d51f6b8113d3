"""Several instances of one model in one photo: each found, fitted, and in one scene."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from poseviewer import api
from poseviewer.cli.fit_command import without_lost
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import SettingsError
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.automatic import StartQuery
from poseviewer.starts.instances import propose_beside
from poseviewer.starts.start import StartInputs
from tests.commands import read_rows, run
from tests.several import make_three
from tests.two_boxes import CAMERA, MESH, TRUTH, make_two, off


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a photo of two printed boxes, and of their model."""
    return make_two(tmp_path_factory.mktemp("two")).photo.parent


@pytest.mark.slow
@pytest.mark.long
def test_two_of_three_boxes_are_found_in_one_scene(two: Path, capsys):
    out = two / "carton.scene.json"
    files = two / "two.png", two / "carton.ply", "--start", "auto"
    assert run("fit", *files, "--instances", 3, "--out", out, "--evaluations", 300) == 0
    printed = capsys.readouterr()
    assert re.search(r"note: start found: proposal [12] of 2, probability 99 %, loss", printed.err)
    assert "note: 2 of 3 instances: nothing else looks like one." in printed.err
    scene = load_scene(out)
    assert [item.name for item in scene.objects] == ["carton", "carton 2"]
    poses = [scene.pose(index, 0) for index in range(2)]
    assert max(map(off, poses)) < 1.0
    assert pose_error(MESH, poses[0], poses[1]).percent > 50.0


@pytest.mark.slow
def test_where_one_is_placed_no_other_is_proposed(two: Path):
    query = StartQuery(StartInputs(load_photo(two / "two.png"), MESH, None), CAMERA)
    starts = propose_beside(query, TRUTH[:1], SoftwareRenderer(MESH))
    assert starts
    ends = [pose_error(MESH, start.pose, TRUTH[1].pose).percent for start in starts]
    assert max(ends) < 10.0


@pytest.mark.slow
@pytest.mark.long
def test_a_row_of_a_batch_needs_no_box(two: Path):
    (two / "jobs.csv").write_text("photo,model,start\ntwo.png,carton.ply,auto\n")
    assert run("batch", two / "jobs.csv", "--out", two / "results", "--evaluations", 60) == 0
    (row,) = read_rows(two / "results" / "results.csv")
    pose = load_pose(two / "results" / row["pose"], 640, 480).pose
    assert off(pose) < 2.0


@pytest.mark.slow
@pytest.mark.long
def test_lost_instances_are_hidden_beside_others(tmp_path: Path, capsys):
    end = api.load(make_three(tmp_path)).fit(evaluations=20)
    words = [Verdict(word, 0.5) for word in ("found", "lost", "doubtful")]
    ends = {i: replace(own, verdict=words[i]) for i, own in end.progress_by_object.items()}
    kept = without_lost(replace(end, progress_by_object=ends), 3)
    assert [item.hidden for item in kept.objects] == [False, True, False]
    assert "2 of 3 instances are found or doubtful" in capsys.readouterr().out
    lost = {i: replace(own, verdict=words[1]) for i, own in ends.items()}
    all_lost = replace(end, progress_by_object=lost)
    assert not any(item.hidden for item in without_lost(all_lost, 3).objects)


def test_instances_are_for_an_automatic_start_alone(scene, capsys):
    with pytest.raises(SettingsError, match="instances=0: wanted a whole number of 1 or more"):
        api.AutoStart(instances=0)
    with pytest.raises(SettingsError, match="instances=2 with a free focal length"):
        api.load(scene.photo, scene.model, api.AutoStart(instances=2), free_focal=True)
    line = "fit", scene.photo, scene.model, "--pose", scene.start, "--out", "x.json"
    assert run(*line, "--instances", 2) == 2
    assert "--instances without --start auto" in capsys.readouterr().err
