"""Packages stay apart: imports, printing, threads."""

import ast
import subprocess
import sys
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
        path.relative_to(PACKAGE).parts[0]
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Name) and node.id == "print"
    }
    assert printers == {"cli"}


def test_no_thread_outside_the_workers():
    for path in PACKAGE.rglob("*.py"):
        is_worker = path.parent == PACKAGE / "app" / "workers"
        assert is_worker or path == PACKAGE / "processes.py" or "Thread(" not in path.read_text(), (
            path
        )
