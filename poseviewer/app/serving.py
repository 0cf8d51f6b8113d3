"""Start the app: serve, open the browser, run until Ctrl-C."""

from __future__ import annotations

import signal
import webbrowser
from collections.abc import Callable

from poseviewer.app.app import App
from poseviewer.app.below_viser.guard import serve
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.workers.opening import Opened
from poseviewer.files.state.folder import state_folder


def serve_app(
    opened: Opened,
    review: Reviewer | None = None,
    *,
    host: str,
    port: int | None,
    browser: bool,
    tell: Callable[[str], None],
) -> None:
    """Serve the app on what was opened (in a review: its first row) until it is interrupted;
    ``tell`` prints a line.

    Raises:
        PoseViewerError: the address is taken.
    """
    state = state_folder()
    guarded = serve(host, port, "poseviewer", state)
    app = App(guarded.server, opened, state, review)

    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: app.stop())
    tell(f"poseviewer is at {guarded.url}\nCtrl-C ends it.")
    if browser:
        webbrowser.open(guarded.url)
    try:
        app.run()
    except BaseException:
        guarded.stop()  # the pages may come back
        raise
    guarded.end()
