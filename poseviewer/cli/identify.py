"""Fit every model from one start, and rank them by their losses over the same pixels. The models
share a frame: the start is meant for each of them.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.options import add_search, add_settings, option, settings_of
from poseviewer.cli.terminal import progress_bar, say, tell

if TYPE_CHECKING:
    from poseviewer.fit.progress import FitProgress


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer identify``."""
    option(parser, "photo PHOTO", kind=Path)
    option(parser, "models MODEL", kind=Path, nargs="+")
    option(parser, "--start POSE.json", kind=Path, required=True)
    option(parser, "--quiet", "no progress, no notes")
    add_settings(parser)
    add_search(parser)


def run(options: Namespace) -> int:
    """Print which model explains the photo best."""
    from poseviewer.confidence.identify import identify
    from poseviewer.starts.registration import load_registration

    settings = settings_of(options)
    opened = [
        load_registration(
            options.photo, model, options.start, None, options.mask, settings.without or ()
        )
        for model in options.models
    ]
    if not options.quiet:
        for warning in dict.fromkeys(text for one in opened for text in one.warnings):
            tell(f"note: {warning}")
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
