"""Run another tool's own reader, in a process of its own: these libraries do not mix."""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

READERS = Path(__file__).parent / "readers"
PYTHON = os.environ.get("POSEVIEWER_INTEROP_PYTHON", sys.executable)
"""A Python with the extra ``interop``; another than ours where these want an older NumPy."""


def read_with(module: str, *arguments: object, out: Path) -> Any:
    """Run and return what the script ``readers/read_with_MODULE.py`` writes to ``out``, as JSON.

    Skips where the module cannot be imported.
    """
    if reason := _why_not(module):
        pytest.skip(f"{module} is not there ({reason}); pip install 'poseviewer[interop]'")
    command = [PYTHON, str(READERS / f"read_with_{module}.py"), *map(str, arguments), str(out)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return json.loads(out.read_text())


@cache
def _why_not(module: str) -> str:
    result = subprocess.run(
        [PYTHON, "-c", f"import {module}"], capture_output=True, text=True, check=False
    )
    return result.stderr.strip().splitlines()[-1] if result.returncode else ""
