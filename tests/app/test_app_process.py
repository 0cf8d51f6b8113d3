"""The app as a program: how it ends, what a crash leaves, and whom it refuses."""

from __future__ import annotations

import re
import resource
import shutil
import sys
import time
import urllib.error
import urllib.request
from http.cookiejar import CookieJar
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from poseviewer.files.pose import load_pose
from poseviewer.files.state.autosave import AutosavedSession, load_autosave
from tests.app.app_process import AppProcess
from tests.app.running_app import settle
from tests.app.socket_page import PROTOCOL, SocketPage
from tests.scene import Scene, make_scene

OFFER = "An earlier session ended without saving"
SEED = 7

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """One of its own: poses are saved beside the photo."""
    return make_scene(tmp_path_factory.mktemp("files"))


@pytest.fixture(scope="module")
def crashed(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an app that was killed in a search."""
    folder = tmp_path_factory.mktemp("crashed")
    crash_in_search(scene, folder)
    return folder


@pytest.fixture
def left(crashed: Path, tmp_path: Path) -> AutosavedSession:
    """What the crash left, on disk in ``tmp_path`` as well."""
    shutil.copytree(crashed / "state", tmp_path / "state")
    session = kept(tmp_path)
    assert session is not None
    return session


def start(scene: Scene, tmp_path: Path) -> AppProcess:
    return AppProcess(tmp_path, scene.photo, scene.model, "--pose", scene.start)


def wait_for_offer(page: SocketPage) -> None:
    """The offer may come before the panels are whole."""
    page.wait_until(lambda: OFFER in page.shown.modals.values() and "Seed" in page.labels())


def kept(tmp_path: Path) -> AutosavedSession | None:
    """The session on disk."""
    found = list((tmp_path / "state" / "sessions").glob("*.json"))
    return load_autosave(found[0]) if found else None


def crash_in_search(scene: Scene, tmp_path: Path) -> None:
    """Change pose and settings, search, and kill the app."""
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        page.set("Seed", SEED)
        page.set("Pixels", "whole photo")
        page.press(86.0, 60.0)
        page.drag(80.3, 63.7)
        page.release()
        page.wait_until(lambda: kept(tmp_path))
        page.key("Space")
        page.wait_until(lambda: "Stop (space)" in page.labels() and page.text_with("evaluations"))
        app.kill()
        page.wait_until(lambda: page.closed)


def test_crash_loses_nothing(scene: Scene, tmp_path: Path, left: AutosavedSession) -> None:
    assert left.settings["seed"] == SEED
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        wait_for_offer(page)
        assert page.value("Seed") == 0
        page.click("Open it again")
        page.wait_until(lambda: page.value("Seed") == SEED)
        page.wait_until(lambda: page.value("Pixels") == "whole photo")
        page.wait_until(lambda: not page.shown.modals)
        page.wait_until(lambda: page.text_with("● unsaved"))
        page.key("KeyS")
        page.wait_until(lambda: page.text_with("no unsaved changes"))
        found = load_pose(scene.photo.with_name("p.pose.json"), 160, 120)
        assert found.pose.is_same(left.pose.pose)
        page.key("KeyR")  # back to the start, which is not the pose that was kept
        page.wait_until(lambda: page.text_with("● unsaved"))
        page.key("KeyS")
        page.wait_until(lambda: page.text_with("no unsaved changes"))
        found = load_pose(scene.photo.with_name("p.pose.json"), 160, 120)
        assert found.pose.is_same(left.start.pose)
        assert app.terminate() == 0
    assert kept(tmp_path) is None
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        assert not page.shown.modals


def test_a_drag_right_before_a_search_is_kept_within_a_second(scene: Scene, tmp_path: Path) -> None:
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        page.press(86.0, 60.0)
        page.drag(80.3, 63.7)
        page.release()
        page.key("Space")
        time.sleep(1.0)
        app.kill()
    left = kept(tmp_path)
    assert left is not None
    before = load_pose(scene.start, 160, 120)
    assert not left.pose.pose.is_same(before.pose)


def test_a_folder_that_cannot_be_written_to_is_said_and_work_goes_on(
    scene: Scene, tmp_path: Path
) -> None:
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        sessions = tmp_path / "state" / "sessions"
        sessions.write_text("in the way")  # a folder that is read only is none to root
        page.key("ArrowLeft")
        page.wait_until(lambda: any("a crash would lose" in text for _, text in page.shown.notices))
        page.key("ArrowLeft")
        page.wait_until(lambda: page.text_with("● unsaved"))
        sessions.unlink()
        page.wait_until(lambda: kept(tmp_path))
        assert sum("a crash would lose" in text for _, text in page.shown.notices) == 1
        assert app.terminate() == 0
    assert not [line for line in app.lines if "Traceback" in line]


def test_without_a_state_folder_it_says_so_and_works(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "state").write_text("in the way")
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        assert "a crash would lose unsaved work" in "".join(app.lines)
        page.upload("Photo ...", "q.png", scene.photo.read_bytes())
        page.wait_until(lambda: page.text_with("q.png"))
        page.key("ArrowLeft")
        page.wait_until(lambda: page.text_with("● unsaved"))
        assert app.terminate() == 0
    assert (tmp_path / "state").read_text() == "in the way"
    assert not [line for line in app.lines if "Traceback" in line]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits another process")
def test_on_a_full_disk_work_goes_on_and_is_kept_when_there_is_room(
    scene: Scene, tmp_path: Path
) -> None:
    """A limit on the size of files, which the system refuses as it does on a full disk."""
    saved = scene.photo.with_name("p.pose.json")
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        page.key("ArrowLeft")
        page.wait_until(lambda: kept(tmp_path))
        page.key("KeyS")
        page.wait_until(saved.exists)
        before = saved.read_bytes()
        everything = resource.prlimit(app.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(app.pid, resource.RLIMIT_FSIZE, (100, everything[1]))
        page.key("ArrowLeft")
        page.wait_until(lambda: any("a crash would lose" in text for _, text in page.shown.notices))
        page.key("KeyS")
        page.upload("Photo ...", "q.png", scene.photo.read_bytes())
        for words in ("p.pose.json: cannot be written", "q.png: cannot be kept"):
            page.wait_until(lambda w=words: any(w in text for _, text in page.shown.notices))
        assert saved.read_bytes() == before
        page.key("ArrowLeft")
        page.wait_until(lambda: page.text_with("● unsaved"))
        resource.prlimit(app.pid, resource.RLIMIT_FSIZE, everything)
        page.key("KeyS")
        page.wait_until(lambda: page.text_with("no unsaved changes"))
        assert saved.read_bytes() != before
        assert app.terminate() == 0
    assert not [line for line in app.lines if "Traceback" in line]
    assert not list(scene.photo.parent.glob(".*.part"))


def test_a_state_folder_that_vanishes_is_made_again(scene: Scene, tmp_path: Path) -> None:
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        settle(page)
        page.key("ArrowLeft")
        page.wait_until(lambda: kept(tmp_path))
        shutil.rmtree(tmp_path / "state")
        page.key("ArrowLeft")
        page.wait_until(lambda: kept(tmp_path))
        page.upload("Photo ...", "q.png", scene.photo.read_bytes())
        page.wait_until(lambda: page.text_with("**q.png**"))
        shutil.rmtree(tmp_path / "state")
        page.key("KeyS")
        page.wait_until(lambda: page.text_with("no unsaved changes"))
        assert app.terminate() == 0
    assert not [line for line in app.lines if "Traceback" in line]


def test_restored_session_outlives_another_crash(
    scene: Scene, tmp_path: Path, left: AutosavedSession
) -> None:
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        wait_for_offer(page)
        page.click("Open it again")
        page.wait_until(lambda: page.value("Seed") == SEED)
        page.wait_until(lambda: kept(tmp_path))
        app.kill()
    again = kept(tmp_path)
    assert again is not None
    assert again.pose.pose.is_same(left.pose.pose)
    assert again.settings == left.settings


@pytest.mark.usefixtures("left")
def test_forgotten_session_is_not_offered_again(scene: Scene, tmp_path: Path) -> None:
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        wait_for_offer(page)
        page.click("Forget it")
        page.wait_until(lambda: not page.shown.modals)
        page.wait_until(lambda: kept(tmp_path) is None)
        assert page.value("Seed") == 0
        assert app.terminate() == 0


def assert_refuses_pages_of_others(app: AppProcess) -> None:
    address = app.url.replace("http://", "ws://")
    for origin in ("http://example.org", "null", app.url.rstrip("/").replace("http", "ftp")):
        with pytest.raises(InvalidStatus) as refused:
            connect(address, subprotocols=[PROTOCOL], origin=Origin(origin))
        assert refused.value.response.status_code == 403
    own = Origin(app.url.rstrip("/"))
    with connect(address, subprotocols=[PROTOCOL], origin=own, max_size=None) as welcome:
        assert welcome.recv(timeout=60)


def test_sigterm_in_a_search_ends_cleanly_and_others_are_refused(
    scene: Scene, tmp_path: Path
) -> None:
    with start(scene, tmp_path) as app, SocketPage(app.url) as page:
        assert_refuses_pages_of_others(app)
        settle(page)
        page.key("Space")
        page.wait_until(lambda: page.text_with("evaluations"))
        assert app.terminate() == 0
        page.wait_until(lambda: page.closed)
    assert app.leaves_nothing()
    assert not [line for line in app.lines if "Traceback" in line or "Error" in line]
    assert kept(tmp_path) is not None  # found, and not saved: offered the next time


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
