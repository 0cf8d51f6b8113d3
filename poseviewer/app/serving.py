"""Start the app: load, serve, open the browser, run until Ctrl-C."""

from __future__ import annotations

import signal
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from poseviewer.app.app import App
from poseviewer.app.below_viser.guard import serve
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.workers.opening import Opened, open_files
from poseviewer.files.camera.calibration import Calibration
from poseviewer.files.state.folder import state_folder


def serve_app(
    photo: Path,
    model: Path,
    pose: Path | None,
    calibration: Calibration | None = None,
    others: Sequence[Path] = (),
    *,
    host: str,
    port: int | None,
    browser: bool,
    tell: Callable[[str], None],
) -> None:
    """Open the files and serve the app until it is interrupted; ``others``: models that the photo
    may show; ``tell`` prints a line.

    Raises:
        PoseViewerError: a file cannot be used, or the address is taken.
    """
    opened = open_files(photo, model, pose, calibration, others)
    _serve(opened, None, host=host, port=port, browser=browser, tell=tell)


def serve_review(
    folder: Path, *, host: str, port: int | None, browser: bool, tell: Callable[[str], None]
) -> None:
    """Serve the app on the rows of a batch's folder of results until it is interrupted.

    Raises:
        PoseViewerError: the folder holds no batch, no row can be opened, or the address is taken.
    """
    review = Reviewer(folder)
    opened = next(review.open_row(0, 1))
    review.opened(opened)
    _serve(opened, review, host=host, port=port, browser=browser, tell=tell)


def _serve(
    opened: Opened,
    review: Reviewer | None,
    *,
    host: str,
    port: int | None,
    browser: bool,
    tell: Callable[[str], None],
) -> None:
    state = state_folder()
    guarded = serve(host, port, "poseviewer", state)
    app = App(guarded.server, opened, state, review)

    def end(*_: Any) -> None:
        app.stop()

    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, end)
    tell(f"poseviewer is at {guarded.url}\nCtrl-C ends it.")
    if browser:
        webbrowser.open(guarded.url)
    try:
        app.run()
    except BaseException:
        guarded.stop()  # the pages may come back
        raise
    guarded.end()
