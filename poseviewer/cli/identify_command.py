"""Fit several models to a photo from one start, and rank them by their losses over the same pixels.
All models need the same coordinate frame, since each begins at the same start.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import make_settings, mask_of
from poseviewer.cli.terminal import progress_bar, say, tell

if TYPE_CHECKING:
    from poseviewer.fit.progress import FitProgress


OPTIONS = {
    "": (
        table.option("photo PHOTO", "photo of one of the models"),
        table.option("models MODEL", "3D models to compare", nargs="+"),
        table.option("--start POSE.json", "begin at this pose", required=True),
        table.QUIET,
    ),
    "comparison": table.COMPARED,
    "search": table.LIMITS,
}
EXAMPLES = (
    "poseviewer identify photo.jpg sedan.glb estate.glb --start start.json",
    "poseviewer identify photo.jpg can_*.ply --start start.json --grey",
)


def run(options: Namespace) -> int:
    """Print which model explains the photo best."""
    from poseviewer.fit.identification import identify
    from poseviewer.opening.scenes import open_scene
    from poseviewer.opening.sources import Sources

    settings = make_settings(options)
    files = Sources(options.photo, start=options.start, mask=mask_of(options), settings=settings)
    opened = [open_scene(replace(files, model=model)) for model in options.models]
    if not options.quiet:
        for warning in dict.fromkeys(note for scene in opened for note in scene.notes):
            tell(f"note: {table.in_options(warning, OPTIONS)}")
    with progress_bar(None, options.quiet) as bar:

        def watch(name: str, progress: FitProgress) -> None:
            bar.set_description_str(f"{name}, {progress.loss_text}", refresh=False)
            bar.update()

        ranked = identify(opened, settings, watch)
    width = max(len(name) for name, _ in ranked)
    say(f"{'':3}{'model':{width}}  {'unexplained':>11}  {'margin':>7}  {'start':>6}")
    shares_left = [fit.unexplained for _, fit in ranked]
    for rank, (name, fit) in enumerate(ranked, 1):
        margin = f"{shares_left[rank] - fit.unexplained:+.3f}" if rank < len(ranked) else ""
        shares = f"{fit.unexplained:11.3f}  {margin:>7}  {fit.start_unexplained:6.3f}"
        say(f"{rank:<3}{name:{width}}  {shares}")
    say("unexplained, of the same pixels: 0, all explained, to 1, nothing")
    say("margin: how much more the next model leaves unexplained")
    return 0
