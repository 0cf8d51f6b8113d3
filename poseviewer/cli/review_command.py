"""Open the app on a batch's folder of results: a list of rows, to accept, correct or reject."""

from __future__ import annotations

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say

OPTIONS = {"": (table.option("folder FOLDER"), *table.SERVER)}


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
