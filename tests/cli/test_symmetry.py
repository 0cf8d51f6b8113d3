"""Symmetric models on the command line: what is said of them, and one pose for all equal ones."""

from __future__ import annotations

import json
from pathlib import Path

import trimesh

from poseviewer.cli import main as cli


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
