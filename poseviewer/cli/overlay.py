"""Draw the model over the photo at a pose, or over several, or all objects of a scene."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import add_files, add_settings, add_views, option
from poseviewer.cli.terminal import require_writable, say
from poseviewer.errors import PhotoFileError
from poseviewer.render.overlay import LOOKS


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer overlay``."""
    add_files(parser, "where to draw it")
    option(parser, "--out OVERLAY.png", kind=Path, required=True)
    add_look(parser)
    add_views(parser)
    add_settings(parser)


def add_look(parser: ArgumentParser, text: str | None = None) -> None:
    """How the model is drawn; ``text`` helps."""
    option(parser, "--look", text, choices=LOOKS, default=LOOKS[0])


def run(options: Namespace) -> int:
    """Write the picture, or one for each photo."""
    require_writable(options.out, PhotoFileError)
    from poseviewer.api import SceneCase
    from poseviewer.cli.case import open_any

    found = open_any(options)
    drawn = found if isinstance(found, SceneCase) else found.start
    for path in drawn.draw(options.out, options.look):
        say(f"overlay: {path}")
    return 0
