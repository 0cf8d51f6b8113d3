"""Fit the bundled demo, without the app."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.terminal import say, tell_of_compiling
from poseviewer.errors import EXIT_INTERRUPTED
from poseviewer.files.writing import make_folder

LOOKS = ("outline", "relit", "residual")


def add_options(parser: ArgumentParser) -> None:
    """``poseviewer demo`` has none."""
    parser.set_defaults(out=Path("poseviewer-demo"))


def run(options: Namespace) -> int:
    """Fit it, and say where the results are."""
    folder: Path = options.out
    make_folder(folder, parents=False)
    say("Fitting the bundled demo: a car of our own making on a path-traced photo.")
    tell_of_compiling()
    from poseviewer.api import load
    from poseviewer.cli.case import search
    from poseviewer.files.demo import demo_case

    files = demo_case()
    case = load(files.photo, files.model, files.start)
    found = search(case, quiet=False)
    found.save(folder / "pose.json")
    for look in LOOKS:
        found.draw(folder / f"{look}.png", look)
    case.start.draw(folder / "start.png")
    names = ", ".join(f"{look}.png" for look in ("start", *LOOKS))
    say(f"The pose and pictures of it are in {folder}/: pose.json, {names}.")
    return EXIT_INTERRUPTED if found.stopped else 0
