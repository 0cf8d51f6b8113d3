"""Open the app on a batch's folder of results: a list of rows, to accept, correct or reject."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import add_server, option
from poseviewer.cli.terminal import say


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer review``."""
    option(parser, "folder FOLDER", kind=Path)
    add_server(parser)


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    from poseviewer.app.reviewing import Reviewer
    from poseviewer.app.serving import serve_app

    review = Reviewer(options.folder)
    serve_app(
        lambda: (review.open_first(), review),
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=say,
    )
    return 0
