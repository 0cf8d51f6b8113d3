"""Draw the model over the photo at a pose, or over several, or all objects of a scene."""

from __future__ import annotations

from argparse import Namespace

from poseviewer.cli.case import open_scene
from poseviewer.cli.options import FILES, LOOK, SCENE, option
from poseviewer.cli.terminal import require_writable, say
from poseviewer.errors import PhotoFileError

OPTIONS = {
    "": (
        *FILES,
        option("--pose POSE.json", "where to draw it"),
        option("--out OVERLAY.png", required=True),
        LOOK,
    ),
    **SCENE,
}


def run(options: Namespace) -> int:
    """Write the picture, or one for each photo."""
    require_writable(options.out, PhotoFileError)
    for path in open_scene(options).draw(options.out, options.look):
        say(f"overlay: {path}")
    return 0
