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
from poseviewer.files.symmetry import read_symmetry, symmetry_path
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
    model = tmp_path / "box.ply"
    model.write_bytes(Path(of_box.model).read_bytes())
    beside = symmetry_path(model)
    beside.write_text(json.dumps({"centre": centre, "turns": turns}))
    symmetry = read_symmetry(beside, mesh)
    found = []
    for number, motion in enumerate(symmetry.transforms()[::3]):
        equal, out = tmp_path / f"start{number}.json", tmp_path / f"pose{number}.json"
        turned = replace(start.pose, camera_from_model=start.pose.camera_from_model @ motion)
        save_pose(equal, PoseRecord(turned))
        arguments = ["fit", str(of_box.photo), str(model), "--pose", str(equal)]
        more = ["--out", str(out), "--quiet", "--evaluations", "700"]
        assert cli.main([*arguments, *more]) == 0
        found.append(load_pose(out, 160, 120))
        assert len(found[-1].symmetry.transforms()) == 4
    truth = load_pose(of_box.truth, 160, 120).pose
    for record in found:
        assert pose_error(mesh, record.pose, found[0].pose).percent < 0.5  # in the same way round
        assert pose_error(mesh, record.pose, truth, symmetry).percent < 1.0
