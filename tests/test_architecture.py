"""The rooms stay apart, and what is installed is whole."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import poseviewer

PACKAGE = Path(poseviewer.__file__).parent
REPOSITORY = PACKAGE.parent


def test_import_contracts_hold():
    code = "from importlinter.cli import lint_imports_command as main; main()"
    result = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "0 broken" in result.stdout


def test_only_the_command_line_prints():
    printers = {
        path.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Name) and node.id == "print"
    }
    assert printers == {"cli.py", "commands.py", "many_commands.py"}


def test_no_thread_outside_the_worker():
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        # A process of the study's pool has one that ends it with the study, and does nothing else.
        allowed = ("worker.py", "pool.py")
        assert path.name in allowed or "threading" not in text, path


def test_files_stay_readable():
    lengths = {path: len(path.read_text().splitlines()) for path in PACKAGE.rglob("*.py")}
    assert max(lengths.values()) <= 400, max(lengths, key=lengths.__getitem__)


def test_shaders_and_schema_are_in_the_package():
    package = files("poseviewer")
    assert package.joinpath("files", "pose.schema.json").is_file()
    assert package.joinpath("files", "formats", "blender_scene.txt").is_file()
    shaders = package.joinpath("render", "shaders", "face_ids")
    assert any(entry.name.endswith(".frag") for entry in shaders.iterdir())
