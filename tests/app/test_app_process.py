"""The app as a program: how it ends, and whom it refuses."""

from __future__ import annotations

import re
import urllib.error
import urllib.request
from http.cookiejar import CookieJar
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


class OpenPage:
    """What a browser keeps of the page that it has open: where it came from, and its cookie."""

    def __init__(self, app: AppProcess) -> None:
        found = re.fullmatch(r"http://[^/]+:(\d+)/\?token=(\S+)", app.url)
        assert found is not None
        self.port = int(found[1])
        self.address = f"127.0.0.1:{self.port}"
        cookies = CookieJar()
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(cookies))
        with opener.open(f"http://{self.address}/?token={found[2]}", timeout=60) as answer:
            assert answer.status == 200
        (cookie,) = cookies
        self.cookie = f"{cookie.name}={cookie.value}"

    def comes_back(self) -> bool:
        """Whether it is let in again, as it connects by itself: page, then websocket."""
        origin, headers = f"http://{self.address}", {"Cookie": self.cookie}
        try:
            with urllib.request.urlopen(
                urllib.request.Request(f"{origin}/", headers=headers), timeout=60
            ) as page:
                assert page.status == 200
            with connect(
                f"ws://{self.address}/",
                subprotocols=[PROTOCOL],
                origin=Origin(origin),
                additional_headers=headers,
                max_size=None,
            ) as socket:
                assert socket.recv(timeout=60)
        except urllib.error.HTTPError as answer:
            with answer:
                return answer.code != 403
        return True


def start_for_others(scene: Scene, tmp_path: Path, port: int) -> AppProcess:
    files = (scene.photo, scene.model, "--pose", scene.start)
    return AppProcess(tmp_path, *files, "--host", "0.0.0.0", port=port)


def test_pages_of_other_machines_outlive_a_crash_but_not_an_end(
    scene: Scene, tmp_path: Path
) -> None:
    with start_for_others(scene, tmp_path, 0) as app:
        page = OpenPage(app)
        (file,) = (tmp_path / "state" / "tokens").iterdir()
        app.kill()
    with start_for_others(scene, tmp_path, page.port) as app:
        assert page.comes_back()
        assert app.terminate() == 0
        assert not file.exists()
    with start_for_others(scene, tmp_path, page.port) as app:
        assert not page.comes_back()
        assert app.interrupt() == 0
