"""Fit the bundled demo without the app, and write pose and pictures to ``poseviewer-demo``."""

from argparse import Namespace
from pathlib import Path

from poseviewer.cli.terminal import say, tell_of_compiling
from poseviewer.errors import EXIT_INTERRUPTED
from poseviewer.files.writing import make_folder

DRAWN = ("outline", "relit", "residual")
OPTIONS = {"": ()}
EXAMPLES = ("poseviewer demo", "poseviewer info poseviewer-demo/pose.json")
FOLDER = Path("poseviewer-demo")


def run(_: Namespace) -> int:
    """Fit the demo, and print where the results are."""
    make_folder(FOLDER, parents=False)
    say("Fitting the bundled demo: a car of our own making on a path-traced photo.")
    tell_of_compiling()
    from poseviewer.api import load
    from poseviewer.cli.fit_command import search
    from poseviewer.files.demo import demo_case

    files = demo_case()
    result = search(load(files.photo, files.model, files.start), quiet=False)
    result.save(FOLDER / "pose.json")
    for look in DRAWN:
        result.draw(FOLDER / f"{look}.png", look)
    result.start.draw(FOLDER / "start.png")
    names = ", ".join(f"{look}.png" for look in ("start", *DRAWN))
    say(f"The pose and pictures of it are in {FOLDER}/: pose.json, {names}.")
    return EXIT_INTERRUPTED if result.stopped else 0
