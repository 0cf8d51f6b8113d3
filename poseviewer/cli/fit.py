"""Search for the pose."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import (
    KEPT,
    RECTANGLE,
    SCENE,
    add_fields,
    add_files,
    add_search,
    add_settings,
    add_views,
    names,
    option,
    positive,
    rectangle,
    seed,
)
from poseviewer.cli.overlay import add_look
from poseviewer.cli.terminal import require_writable, say
from poseviewer.errors import EXIT_INTERRUPTED, PhotoFileError, PoseFileError
from poseviewer.fit.settings import FitSettings

SEARCHED = {
    "method": (
        "--method",
        "classes and edges, or exactly the paper's: grey, clip or whole, no coarser levels",
    ),
    "lock": ("--lock NAME,...", "parameters of the chart to hold", names),
    "seed": ("--seed SEED", None, seed),
    **KEPT,
}
"""Fields of ``FitSettings`` that this command alone has."""


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer fit``."""
    add_files(parser)
    _add_start(parser)
    option(parser, "--out POSE.json", "of a scene: SCENE.json", Path, required=True)
    option(parser, "--overlay OVERLAY.png", "draw the pose found", Path)
    add_look(parser, "of the overlay")
    add_settings(parser)
    add_views(parser)
    add_fields(add_search(parser), FitSettings, SEARCHED)


def _add_start(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("start, one of")
    start = group.add_mutually_exclusive_group(required=True)
    option(start, "--pose POSE.json", "a pose file", Path)
    option(start, "--pairs FILE", "CSV, rows x,y,z,u,v: model, photo point", Path)
    ellipses = "their ellipses, each cx,cy,a,b,angle (half axes in px, degrees)"
    option(start, "--wheels REAR;FRONT", ellipses)
    about = "look for both wheels in a rectangle about the car, in px"
    option(start, f"--find-wheels {RECTANGLE}", about, rectangle)
    found = "look for one in the --box, or the --region"
    option(start, "--start", found, choices=("auto",))
    option(start, "--scene SCENE.json", SCENE, Path)
    option(group, "--object ID", "the only one of the scene to search for")
    option(group, f"--box {RECTANGLE}", "about the object, px", rectangle)
    unknown = "where no pose file says it"
    kinds = ("perspective", "parallel")
    option(group, "--projection", unknown, choices=kinds, default="perspective")
    option(group, "--focal PX", f"{unknown} (EXIF's)", positive)


def run(options: Namespace) -> int:
    """Write the pose found, or the scene, and an overlay, or one for each photo, if wanted."""
    require_writable(options.out, PoseFileError)
    if options.overlay:
        require_writable(options.overlay, PhotoFileError)
    from poseviewer.cli.case import fit

    found = fit(options)
    found.save(options.out)
    say(f"{'pose' if options.scene is None else 'scene'}: {options.out}")
    for path in found.draw(options.overlay, options.look) if options.overlay else ():
        say(f"overlay: {path}")
    return EXIT_INTERRUPTED if found.stopped else 0
