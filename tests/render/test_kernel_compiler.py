"""Kernels run where their machine code cannot be kept."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import poseviewer

SCRIPT = """
import numpy as np
from poseviewer.render import kernel_moments
first, second = np.array([1.0, 2.0]), np.array([[3.0, 0.0], [4.0, 8.0]])
mean, covariance = kernel_moments.as_moments(1, 2.0, first, second, np.zeros(2), np.eye(3))
print(*mean, *covariance.ravel())
from poseviewer.render.compiled import kernels_are_compiled
print(kernels_are_compiled())
"""


def test_kernels_run_from_a_read_only_install_without_a_home(tmp_path: Path):
    """Files stand where numba would make its folders: so it can write to neither of them."""
    package = tmp_path / "poseviewer"
    ignored = shutil.ignore_patterns("__pycache__", "demo_files")
    shutil.copytree(Path(poseviewer.__file__).parent, package, ignore=ignored)
    (package / "render" / "__pycache__").write_text("")
    home = tmp_path / "home"
    home.write_text("")
    settings = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "XDG"))}
    settings |= {"HOME": str(home), "PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(home)}
    found = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=settings, cwd=tmp_path, capture_output=True, text=True
    )
    assert found.returncode == 0, found.stderr
    assert found.stdout.splitlines() == ["0.5 1.0 1.25 1.5 1.5 3.0", "False"]
