"""What several tests need: real data where it is there, and broken files."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real photos, models and poses; skips where it is absent."""
    given = os.environ.get("POSEVIEWER_DATA")
    folder = Path(given) if given else REPOSITORY.parent / "shared" / "data"
    if not (folder / "cases.json").is_file():
        pytest.skip(f"no real data in {folder}; set POSEVIEWER_DATA to the folder that has it")
    return folder


@pytest.fixture(scope="session")
def broken_inputs(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Files that no command may accept: see ``files/broken_inputs.py`` (``name, kind, path``)."""
    return _load_broken_inputs().make_broken_inputs(tmp_path_factory.mktemp("broken"))


def _load_broken_inputs() -> Any:
    # The tests are no package (pytest's importlib mode): fetch the module by its path.
    name = "poseviewer_broken_inputs"
    if name not in sys.modules:
        path = Path(__file__).parent / "files" / "broken_inputs.py"
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]
