"""The app in this process, on a thread, served on a port of its own."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from poseviewer.app.app import App
from poseviewer.app.below_viser.guard import serve
from poseviewer.app.state.document import Document
from poseviewer.app.workers import maps
from tests.app.app_process import MAP_SIZE
from tests.app.state.documents import open_files
from tests.scene import Scene


@dataclass
class RunningApp:
    """The app, where it is, and its files."""

    app: App
    url: str
    scene: Scene

    def uuid(self, label: str) -> str:
        """Name of the input with this label in viser's messages."""
        handles = self.app._page._server.gui._gui_input_handle_from_uuid
        return next(uuid for uuid, one in handles.items() if getattr(one, "label", "") == label)


@contextmanager
def running_app(
    scene: Scene, state: Path, has_start: bool = True, document: Document | None = None
) -> Iterator[RunningApp]:
    """The app on a document, by default the scene's photo, model and start, if any; its loop must
    live until the end.
    """
    interval = sys.getswitchinterval()
    patch = pytest.MonkeyPatch()
    patch.setattr(maps, "SIZE", MAP_SIZE)
    guarded = serve("127.0.0.1", 0)
    if document is None:
        document = open_files(scene.photo, scene.model, scene.start if has_start else None)
    app = App(guarded.server, document, state)
    loop = threading.Thread(target=app.run, name="app")
    loop.start()
    try:
        yield RunningApp(app, guarded.url, scene)
        assert loop.is_alive()
    finally:
        app.stop()
        loop.join(60.0)
        guarded.stop()
        sys.setswitchinterval(interval)
        patch.undo()
    assert not loop.is_alive()
