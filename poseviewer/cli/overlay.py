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
    from poseviewer.cli.case import open_case, open_scene, open_views

    if options.views is not None:
        for path in open_views(options).start.draw(options.out, options.look):
            say(f"overlay: {path}")
        return 0
    drawn = open_case(options).start if options.scene is None else open_scene(options)
    drawn.draw(options.out, options.look)
    say(f"overlay: {options.out}")
    return 0
