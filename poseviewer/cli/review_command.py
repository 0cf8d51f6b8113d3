"""Open the app on the results of a batch, to accept, correct or reject each row."""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say

OPTIONS = {
    "": (
        table.option("folder FOLDER", "folder that batch wrote its results to"),
        table.APP_RENDERER,
        *table.SERVER,
    )
}
EXAMPLES = ("poseviewer review results", "poseviewer review results --port 9000 --no-browser")


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    from poseviewer.app.reviewing import Reviewer
    from poseviewer.app.serving import serve_app
    from poseviewer.render.renderers import require_renderer

    review = Reviewer(options.folder, options.renderer)
    require_renderer(review.settings.renderer)
    server = table.values(options, table.SERVER)
    serve_app(lambda: (review.open_first(), review), tell=say, **server)
    return 0
