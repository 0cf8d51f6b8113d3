"""The options of the commands for many photos: BOP scenes, and the review of what came of them."""

from __future__ import annotations

import argparse
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from poseviewer.errors import SettingsError

if TYPE_CHECKING:
    from poseviewer.batch.scene import SceneOptions


def add_scene(batch: argparse.ArgumentParser, numbers: Callable[[str], Any]) -> None:
    """The options of ``batch`` on a BOP scene; ``numbers`` reads whole numbers above 0."""
    scene = batch.add_argument_group("of a BOP scene")
    scene.add_argument(
        "--models", type=Path, metavar="FOLDER", help="of obj_000001.ply and so on, in mm"
    )
    scene.add_argument(
        "--start",
        metavar="gt|last|POSE.json",
        help="the scene's own poses (gt, as it is), the pose that the image before ended in, or a "
        "pose file for all images",
    )
    scene.add_argument("--objects", type=numbers, metavar="NUMBER,...", help="(all with a pose)")


def scene_rule_of(options: Namespace) -> SceneOptions | None:
    """What the options say of a BOP scene; None for a table.

    Raises:
        SettingsError: they say it of a table.
    """
    from poseviewer.batch.scene import FROM_SCENE, SceneOptions

    given = [name for name in ("models", "start", "objects") if getattr(options, name)]
    if options.jobs.is_dir():
        return SceneOptions(options.models, options.start or FROM_SCENE, options.objects or ())
    if given:
        raise SettingsError(
            f"--{given[0]} goes with a BOP scene's folder, and {options.jobs.name} is no folder; "
            "the table's columns say it."
        )
    return None


def add_review(commands: argparse._SubParsersAction, port: Callable[[str], int]) -> None:
    """The command ``review``."""
    review = commands.add_parser(
        "review",
        help="look through what a batch found, the worst first",
        description="Open the app on a batch's folder of results: next, previous, accept, mend.",
    )
    review.add_argument("folder", type=Path, metavar="FOLDER")
    review.add_argument("--port", type=port, help="(the first free one from 8080 on)")
    review.add_argument(
        "--host",
        default="127.0.0.1",
        help="serve others than this machine as well; the address then bears a token",
    )
    review.add_argument("--no-browser", action="store_true", help="do not open the browser")
    review.set_defaults(command="review")
