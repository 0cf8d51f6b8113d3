"""Start the app: serve, open the browser, read the files, run until Ctrl-C."""

from __future__ import annotations

import atexit
import ctypes
import shutil
import signal
import sys
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.app.below_viser.guard import serve
from poseviewer.errors import SettingsError
from poseviewer.files.state.folder import state_folder

if TYPE_CHECKING:  # the server stands before the rest is imported
    from poseviewer.app.reviewing import Reviewer
    from poseviewer.app.state.document import Document

M_MMAP_THRESHOLD = -3
"""Parameter of ``mallopt(3)``: size from which a block is mapped on its own."""
LARGE_BYTES = 262_144
"""Value of that parameter."""


def serve_app(
    open_first: Callable[[], tuple[Document, Reviewer | None]],
    *,
    host: str,
    port: int | None,
    browser: bool,
    tell: Callable[[str], None],
    features: Path | None = None,
) -> None:
    """Serve the app until it is interrupted; the address is told before files are read.

    Args:
        open_first: opens the first document, with the review if there is one.
        host: address to listen at.
        port: to listen at; None: the first free one from 8080 on.
        browser: whether to open the browser.
        tell: prints a line.
        features: weights of a DINOv2 backbone, which proposes rectangles.

    Raises:
        PoseViewerError: the address is taken, or the document cannot be opened.
    """
    try:
        state = state_folder()
    except SettingsError as error:  # go on without autosave
        state = Path(tempfile.mkdtemp(prefix="poseviewer-"))
        atexit.register(shutil.rmtree, state, ignore_errors=True)
        tell(f"poseviewer: {error} Until then a crash would lose unsaved work.")
    return_freed_memory()
    signals = list[int]()  # received while files are read
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda number, _: signals.append(number))
    guarded = serve(host, port, "poseviewer")
    tell(f"poseviewer is at {guarded.url}\nCtrl-C ends it.")
    if browser:
        webbrowser.open(guarded.url_to_hand_on())
    try:
        gui = guarded.server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        document, review = open_first()
        from poseviewer.app.app import App

        app = App(guarded.server, document, state, review, features)
        for name in (signal.SIGINT, signal.SIGTERM):
            signal.signal(name, lambda *_: app.stop())
        if signals:
            app.stop()
        app.run()
    finally:
        guarded.stop()


def return_freed_memory() -> None:
    """Make glibc return large blocks to the system as soon as they are freed."""
    if sys.platform.startswith("linux"):
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            mallopt(M_MMAP_THRESHOLD, LARGE_BYTES)
