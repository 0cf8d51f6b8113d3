"""The app as a program: how it ends."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.app.app_process import AppProcess
from tests.scene import Scene, make_scene

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """One of its own: poses are saved beside the photo."""
    return make_scene(tmp_path_factory.mktemp("files"))


def test_sigterm_ends_cleanly(scene: Scene, tmp_path: Path) -> None:
    with AppProcess(tmp_path, scene.photo, scene.model, "--pose", scene.start) as app:
        assert app.terminate() == 0
    assert app.leaves_nothing()
    assert not [line for line in app.lines if "Traceback" in line or "Error" in line]
