"""The app as a program: how it ends, and whom it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.app.app_process import AppProcess
from tests.app.below_viser.socket_page import PROTOCOL
from tests.scene import Scene, make_scene

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """One of its own: poses are saved beside the photo."""
    return make_scene(tmp_path_factory.mktemp("files"))


def assert_refuses_pages_of_others(app: AppProcess) -> None:
    address = app.url.replace("http://", "ws://")
    for origin in ("http://example.org", "null", app.url.rstrip("/").replace("http", "ftp")):
        with pytest.raises(InvalidStatus) as refused:
            connect(address, subprotocols=[PROTOCOL], origin=Origin(origin))
        assert refused.value.response.status_code == 403
    own = Origin(app.url.rstrip("/"))
    with connect(address, subprotocols=[PROTOCOL], origin=own, max_size=None) as welcome:
        assert welcome.recv(timeout=60)


def test_sigterm_ends_cleanly_and_others_are_refused(scene: Scene, tmp_path: Path) -> None:
    with AppProcess(tmp_path, scene.photo, scene.model, "--pose", scene.start) as app:
        assert_refuses_pages_of_others(app)
        assert app.terminate() == 0
    assert app.leaves_nothing()
    assert not [line for line in app.lines if "Traceback" in line or "Error" in line]
