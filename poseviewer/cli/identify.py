"""Fit every model from one start, and rank them by their losses over the same pixels. The models
share a frame: the start is meant for each of them.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from poseviewer.cli.options import add_search, add_settings, option, settings_of
from poseviewer.cli.terminal import progress_bar, require_writable, say, tell
from poseviewer.errors import SettingsError

if TYPE_CHECKING:
    from poseviewer.confidence.identify import Ranked
    from poseviewer.fit.progress import FitProgress


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer identify``."""
    option(parser, "photo PHOTO", kind=Path)
    option(parser, "models MODEL", kind=Path, nargs="+")
    option(parser, "--start POSE.json", kind=Path, required=True)
    option(parser, "--json FILE", "write ranks and poses", Path)
    option(parser, "--quiet", "no progress, no notes")
    add_settings(parser)
    add_search(parser)


def run(options: Namespace) -> int:
    """Print which model explains the photo best."""
    if options.json:
        require_writable(options.json, SettingsError)
    from poseviewer.confidence.identify import identify
    from poseviewer.files.writing import write_json
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
    _print_ranking(ranked)
    if options.json:
        pairs = zip_longest(ranked, ranked[1:])
        write_json(options.json, [_as_json(*pair) for pair in pairs], SettingsError)
        say(f"json: {options.json}")
    return 0


def _print_ranking(ranked: Sequence[Ranked]) -> None:
    width = max(len(one.candidate.name) for one in ranked)
    say(f"{'':3}{'model':{width}}  {'unexplained':>11}  {'margin':>7}  {'start':>6}")
    for one in ranked:
        fit, margin = one.candidate.fit, "" if one.margin is None else f"{one.margin:+.3f}"
        shares = f"{fit.unexplained:11.3f}  {margin:>7}  {fit.start_unexplained:6.3f}"
        say(f"{one.rank:<3}{one.candidate.name:{width}}  {shares}")
    say("unexplained, of the same pixels: 0, all explained, to 1, nothing")
    say("margin: how much more the next model leaves unexplained")


def _as_json(one: Ranked, after: Ranked | None) -> dict[str, Any]:
    """Rank, name, losses, their margin to the next one, and pose (OpenCV axes) of a model."""
    from poseviewer.files.pose import PoseRecord, record_as_json

    found, fit = one.candidate, one.candidate.fit
    pose = record_as_json(PoseRecord(fit.pose))
    return {
        "rank": one.rank,
        "model": found.name,
        "loss": fit.loss,
        "start_loss": fit.start_loss,
        "margin": None if after is None else after.candidate.fit.loss - fit.loss,
        "unexplained": fit.unexplained,
        "start_unexplained": fit.start_unexplained,
        "status": fit.status.value,
        **{key: pose[key] for key in ("projection", "camera", "camera_from_model")},
    }
