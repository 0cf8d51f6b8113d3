"""The page as viser is told of it: notices and lines."""

from collections.abc import Iterator

import pytest

from poseviewer.app.page.controls import plain
from poseviewer.app.page.texts import notes_text
from poseviewer.app.workers.tasks import upload
from poseviewer.opening.uploads import pack
from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import RunningApp, running_app
from tests.scene import Scene

NOTED = b"mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\nf 1 1 2\n"


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


def test_lines_are_as_wide_at_every_zoom(running: RunningApp) -> None:
    wanted = {"/model/edges": "screen", "/model/outline": "screen"}
    with SocketPage(running.url) as page:

        def units() -> dict[str, str]:
            lines = [told for told in page.told if told.get("name") in wanted and "props" in told]
            return {line["name"]: line["props"].get("thickness_units", "") for line in lines}

        assert page.wait_until(lambda: units().keys() == wanted.keys() and units()) == wanted


def test_all_notes_on_a_model_are_one_notice(running: RunningApp) -> None:
    with SocketPage(running.url) as page:
        running.app._mailbox.post(upload("model", "m.obj", pack([("m.obj", NOTED)])))
        (notice,) = page.wait_until(lambda: [text for text in page.notices() if "gone" in text])
        assert len(notice.splitlines()) == 3
        shown = page.all_of("NotificationShowMessage")
        (told,) = (one["props"] for one in shown if one["props"]["body"] == notice)
        # It lies over the photo, and is to be read.
        assert 6.0 <= told["auto_close_seconds"] <= max(6.0, 0.05 * len(notice))
        assert all(plain(line) in notes_text(running.app.session) for line in notice.splitlines())
