"""Symmetric models on the command line: what is said of them, and one pose for all equal ones."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from poseviewer.cli import main as cli
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.symmetry import read_symmetry
from poseviewer.geometry.pose_error import pose_error
from tests.meshes import make_mesh
from tests.scene import Scene, make_scene_of


def test_info_says_what_a_file_says(tmp_path: Path, capsys) -> None:
    model = tmp_path / "can.ply"
    trimesh.creation.cylinder(1.0, 3.0, sections=64).export(model)
    assert cli.main(["info", str(model)]) == 0
    assert "symmetry" not in capsys.readouterr().out
    turns = [{"axis": [0, 0, 1], "fold": 3}]
    symmetry = {"centre": [0, 0, 0], "turns": turns}
    (tmp_path / "can.symmetry.json").write_text(json.dumps(symmetry))
    assert cli.main(["info", str(model)]) == 0
    assert "1/3 of a turn about (0, 0, 1) (from a file)" in capsys.readouterr().out


@pytest.fixture(scope="module")
def of_box(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A photo of a box in one colour, which looks the same from two sides."""
    solid = trimesh.creation.box(extents=(2.0, 1.2, 0.7))
    solid.apply_translation([0.3, 0.0, 0.0])
    grey = np.full((len(solid.vertices), 3), 0.6)
    mesh = make_mesh(solid.vertices, solid.faces, colours=grey)
    return make_scene_of(mesh, tmp_path_factory.mktemp("box"))


@pytest.mark.slow
def test_fits_from_equal_starts_are_written_as_one_pose(of_box: Scene, tmp_path: Path) -> None:
    mesh, start = load_mesh(of_box.model), load_pose(of_box.start, 160, 120)
    centre, turns = [0.3, 0, 0], [{"axis": axis, "fold": 2} for axis in ([1, 0, 0], [0, 0, 1])]
    beside = tmp_path / "given.json"
    beside.write_text(json.dumps({"centre": centre, "turns": turns}))
    symmetry = read_symmetry(beside, mesh)
    found = []
    for number, motion in enumerate(symmetry.transforms()[::3]):
        equal, out = tmp_path / f"start{number}.json", tmp_path / f"pose{number}.json"
        turned = replace(start.pose, camera_from_model=start.pose.camera_from_model @ motion)
        save_pose(equal, PoseRecord(turned))
        arguments = ["fit", str(of_box.photo), str(of_box.model), "--pose", str(equal)]
        more = ["--out", str(out), "--quiet", "--evaluations", "700", "--symmetry", str(beside)]
        assert cli.main([*arguments, *more]) == 0
        found.append(load_pose(out, 160, 120))
        assert len(found[-1].symmetry.transforms()) == 4
    truth = load_pose(of_box.truth, 160, 120).pose
    for record in found:
        assert pose_error(mesh, record.pose, found[0].pose).percent < 0.5  # in the same way round
        assert pose_error(mesh, record.pose, truth, symmetry).percent < 1.0


def test_without_its_symmetry_a_pose_is_written_as_it_was_searched(
    of_box: Scene, tmp_path: Path
) -> None:
    out = tmp_path / "pose.json"
    arguments = ["fit", str(of_box.photo), str(of_box.model), "--pose", str(of_box.start)]
    more = ["--out", str(out), "--quiet", "--evaluations", "50", "--symmetry", "none"]
    assert cli.main([*arguments, *more]) == 0
    start = load_pose(of_box.start, 160, 120).pose
    record = load_pose(out, 160, 120)
    assert record.symmetry.is_none
    assert pose_error(load_mesh(of_box.model), record.pose, start).rotation_deg < 20.0


def test_a_file_that_is_not_there_is_said(of_box: Scene, tmp_path: Path, capsys) -> None:
    arguments = ["fit", str(of_box.photo), str(of_box.model), "--pose", str(of_box.start)]
    out = ["--out", str(tmp_path / "p.json"), "--symmetry", str(tmp_path / "no.json")]
    assert cli.main([*arguments, *out]) == 2
    assert "no.json: no such file" in capsys.readouterr().err


def test_one_that_the_model_has_not_is_refused_and_can_be_done_without(
    of_box: Scene, tmp_path: Path, capsys
) -> None:
    model = tmp_path / "box.ply"
    model.write_bytes(Path(of_box.model).read_bytes())
    turns = [{"axis": [0, 0, 1], "fold": "any"}]
    beside = {"format": "poseviewer-symmetry", "version": 1, "centre": [0, 0, 0], "turns": turns}
    (tmp_path / "box.symmetry.json").write_text(json.dumps(beside))
    arguments = ["overlay", str(of_box.photo), str(model), "--pose", str(of_box.start)]
    out = tmp_path / "o.png"
    assert cli.main([*arguments, "--out", str(out)]) == 2
    assert "the model has no such symmetry, every turn about (0, 0, 1)" in capsys.readouterr().err
    assert not out.exists()
    fit = ["fit", *arguments[1:], "--out", str(tmp_path / "p.json"), "--quiet"]
    assert cli.main([*fit, "--evaluations", "20", "--symmetry", "none"]) == 0
