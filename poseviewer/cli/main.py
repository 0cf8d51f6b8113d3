"""The command line: parse, load, call, print. Heavy imports happen inside the commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from poseviewer.cli.calibration_options import add_calibration
from poseviewer.cli.convert import add_convert
from poseviewer.cli.many_options import add_review, add_scene
from poseviewer.cli.option_values import listed, map_size, port, positive, rectangle, size, whole
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE, PoseViewerError

MANY = ("study", "batch", "review", "identify")
"""Commands that run many fits."""
COMMANDS = ("app", "fit", "overlay", "landscape", "info", "demo", "bench", "convert", "undistort")
COMMANDS += MANY
LOOKS = ("outline", "edges", "relit", "residual", "normals", "solid", "none")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``poseviewer``; returns the exit code (2: something the user can mend)."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        from poseviewer.cli import commands, many_commands

        run = getattr(many_commands if options.command in MANY else commands, options.command)
        return run(options)
    except PoseViewerError as error:
        print(f"poseviewer: {error}", file=sys.stderr)
        return EXIT_MENDABLE
    except KeyboardInterrupt:
        print("poseviewer: stopped; nothing was written.", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output is gone: nobody is left to tell
        return 0


class _Parser(argparse.ArgumentParser):
    """One line for a wrong argument, as for every other mistake."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_MENDABLE, f"{self.prog}: {message}; see {self.prog} --help\n")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The options: of a command, or, where none is named, of the app."""
    if arguments and (arguments[0] in COMMANDS or arguments[0] in ("-h", "--help")):
        return make_parser().parse_args(arguments)
    return make_app_parser().parse_args(arguments)


def make_app_parser() -> argparse.ArgumentParser:
    """``poseviewer [PHOTO MODEL]``: the app."""
    parser = _Parser(prog="poseviewer", description="Open the app.")
    _add_app(parser)
    return parser


def make_parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    parser = _Parser(
        prog="poseviewer",
        description="Register a known 3D model onto one photo of the object. Without a command: "
        "open the app in the browser, on PHOTO and MODEL, or on the bundled demo "
        "(poseviewer app --help).",
    )
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", parser_class=_Parser, required=True
    )
    app = commands.add_parser("app", help="the app, as without a command")
    _add_app(app)
    demo = commands.add_parser("demo", help="fit the bundled demo, without the app")
    demo.set_defaults(command="demo", out=Path("poseviewer-demo"), quiet=False)
    _add_fit(commands)
    _add_overlay(commands)
    _add_landscape(commands)
    info = commands.add_parser("info", help="say what poseviewer understood of a file")
    info.add_argument("path", type=Path, metavar="PHOTO|MODEL|POSE")
    add_calibration(info)
    info.set_defaults(command="info")
    _add_bench(commands)
    add_convert(commands)
    undistort = commands.add_parser("undistort", help="write the photo that the poses belong to")
    undistort.add_argument("photo", type=Path, metavar="PHOTO")
    undistort.add_argument("--out", type=Path, required=True, metavar="UNDISTORTED.png")
    add_calibration(undistort, required=True)
    undistort.set_defaults(command="undistort")
    _add_study(commands)
    _add_batch(commands)
    add_review(commands, port)
    _add_identify(commands)
    return parser


def _add_app(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("photo", type=Path, nargs="?", metavar="PHOTO")
    parser.add_argument("model", type=Path, nargs="?", metavar="MODEL")
    parser.add_argument(
        "others", type=Path, nargs="*", metavar="MODEL", help="more, to tell which one it is"
    )
    parser.add_argument("--pose", type=Path, metavar="POSE.json", help="the start")
    parser.add_argument("--last", action="store_true", help="start from the pose saved last")
    parser.add_argument("--port", type=port, help="(the first free one from 8080 on)")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="serve others than this machine as well; the address then bears a token",
    )
    parser.add_argument("--no-browser", action="store_true", help="do not open the browser")
    add_calibration(parser)
    parser.set_defaults(command="app")


def _add_fit(commands: argparse._SubParsersAction) -> None:
    fit = commands.add_parser(
        "fit", help="search for the pose, from a start pose", description="Search for the pose."
    )
    _add_files(fit)
    _add_start(fit)
    fit.add_argument("--out", type=Path, required=True, metavar="POSE.json")
    fit.add_argument("--overlay", type=Path, metavar="OVERLAY.png", help="draw the pose found")
    fit.add_argument("--look", choices=LOOKS, default="outline", help="of the overlay")
    _add_settings(fit)
    search = fit.add_argument_group("search")
    search.add_argument(
        "--method",
        choices=("default", "paper"),
        default="default",
        help="ours, or exactly the paper's: grey, clip or whole, no coarser levels",
    )
    search.add_argument(
        "--lock", default="", metavar="NAME,...", help="numbers of the chart to hold"
    )
    _add_limits(search)
    search.add_argument(
        "--tolerance",
        type=positive,
        metavar="SHARE",
        help="size at which a simplex is done (1e-4)",
    )
    search.add_argument("--step", type=positive, metavar="SHARE", help="edge of the first simplex")
    search.add_argument("--seed", type=int, default=0)
    fit.set_defaults(command="fit")


def _add_overlay(commands: argparse._SubParsersAction) -> None:
    overlay = commands.add_parser("overlay", help="draw the model over the photo")
    _add_files(overlay, "where to draw it")
    overlay.add_argument("--out", type=Path, required=True, metavar="OVERLAY.png")
    overlay.add_argument("--look", choices=LOOKS, default="outline")
    _add_settings(overlay)
    overlay.set_defaults(command="overlay")


def _add_landscape(commands: argparse._SubParsersAction) -> None:
    landscape = commands.add_parser(
        "landscape", help="map the loss around a pose, for all pairs of numbers"
    )
    _add_files(landscape, "the middle of the maps")
    landscape.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    landscape.add_argument("--size", type=map_size, default=41, help="points a side (41)")
    landscape.add_argument(
        "--range", type=positive, default=0.2, metavar="SHARE", help="half width (0.2: 20 %%)"
    )
    _add_settings(landscape)
    landscape.add_argument("--lock", default="", metavar="NAME,...", help="numbers to leave out")
    landscape.set_defaults(command="landscape_sheet")


def _add_bench(commands: argparse._SubParsersAction) -> None:
    bench = commands.add_parser(
        "bench",
        help="measure how fast this machine is",
        description="Measure how long evaluations take on each path, searches and maps.",
    )
    bench.add_argument(
        "--quick", action="store_true", help="50,000 triangles at 640x480 alone: half a minute"
    )
    bench.add_argument("--json", type=Path, metavar="FILE", help="write all rows")
    bench.add_argument("--plot", type=Path, metavar="FILE.png", help="draw them")
    bench.add_argument("--markdown", action="store_true", help="print tables for a README")
    bench.add_argument("--quiet", action="store_true", help="no progress")
    bench.set_defaults(command="bench")


def _add_study(commands: argparse._SubParsersAction) -> None:
    study = commands.add_parser(
        "study",
        help="measure from how far off fits find the pose",
        description="Fit from many starts, on synthetic photos and others with known poses; write "
        "DIR/trials.csv, study.md and study.png. Rows that are there are not run again.",
    )
    study.add_argument("--out", type=Path, required=True, metavar="DIR")
    study.add_argument("--method", choices=("default", "paper"), default="default")
    study.add_argument("--pixels", choices=("near", "whole", "clip"), help="as of fit")
    study.add_argument("--evaluations", type=whole, default=20_000, help="limit of a fit (20000)")
    study.add_argument("--jobs", type=whole, metavar="N", help="processes (one per processor)")
    study.add_argument("--quiet", action="store_true", help="no progress")
    drawn = study.add_argument_group("deviations of a vehicle's numbers")
    drawn.add_argument("--starts", type=whole, metavar="N", help="for each point (10)")
    drawn.add_argument("--deviations", type=listed(positive), metavar="PERCENT,...")
    drawn.add_argument("--readings", type=listed(str), metavar="NAME,...", help="relative,absolute")
    drawn.add_argument(
        "--kinds",
        type=listed(str),
        metavar="NAME,...",
        help="plain,background,photo-parallel,photo-perspective (these), grey",
    )
    drawn.add_argument(
        "--photographer",
        choices=("opengl", "cycles"),
        help="cycles: path-traced by Blender (poseviewer[photo])",
    )
    drawn.add_argument("--photos", type=whole, metavar="N", help="synthetic ones of a kind (5)")
    drawn.add_argument("--size", type=size, metavar="WIDTHxHEIGHT", help="of these (640x480)")
    drawn.add_argument("--projection", choices=("parallel", "perspective"), help="of these")
    drawn.add_argument("--model", type=Path, help="a vehicle (the bundled one)")
    drawn.add_argument("--backgrounds", type=Path, metavar="FOLDER", help="of photos")
    drawn.add_argument("--cars", type=Path, metavar="FOLDER", help="of cases.json, for photo-...")
    drawn.add_argument("--seed", type=int)
    real = study.add_argument_group("real photos with fixed starts")
    real.add_argument("--real", type=Path, metavar="FOLDER", help="of cases.json and starts.json")
    real.add_argument("--degrees", type=listed(whole), metavar="N,...", help="(5,15)")
    real.add_argument("--cases", metavar="PATTERN", help="a part of the id, or with * and ?")
    real.add_argument("--draws", type=whole, metavar="N", help="starts of each case (5)")
    study.set_defaults(command="study")


def _add_batch(commands: argparse._SubParsersAction) -> None:
    batch = commands.add_parser(
        "batch",
        help="fit many photos",
        description="Fit every row of a table with the columns photo, model and start (a pose "
        "file, or last); relative paths start from the table's folder. Or fit the images of a BOP "
        "scene. Run again, it goes on where it was.",
    )
    batch.add_argument("jobs", type=Path, metavar="JOBS.csv|BOP_SCENE")
    batch.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    batch.add_argument("--processes", type=whole, metavar="N", help="(one for each processor)")
    batch.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster to run on")
    batch.add_argument("--quiet", action="store_true", help="no progress")
    add_scene(batch, listed(whole))
    _add_settings(batch)
    _add_limits(batch.add_argument_group("search"))
    batch.set_defaults(command="batch")


def _add_identify(commands: argparse._SubParsersAction) -> None:
    identify = commands.add_parser(
        "identify",
        help="say which of several models the photo shows",
        description="Fit every model from one start, and rank them by their losses over the same "
        "pixels. The models share a frame: the start is meant for each of them.",
    )
    identify.add_argument("photo", type=Path, metavar="PHOTO")
    identify.add_argument("models", type=Path, nargs="+", metavar="MODEL")
    identify.add_argument("--start", type=Path, required=True, metavar="POSE.json")
    identify.add_argument("--json", type=Path, metavar="FILE", help="write ranks and poses")
    identify.add_argument("--quiet", action="store_true", help="no progress, no notes")
    _add_settings(identify)
    _add_limits(identify.add_argument_group("search"))
    identify.set_defaults(command="identify")


def _add_start(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("start, one of")
    start = group.add_mutually_exclusive_group(required=True)
    start.add_argument("--pose", type=Path, metavar="POSE.json", help="a pose file")
    start.add_argument("--last", action="store_true", help="the pose that was saved last")
    start.add_argument(
        "--pairs", type=Path, metavar="FILE", help="CSV or JSON rows x,y,z,u,v: model, photo point"
    )
    start.add_argument(
        "--wheels",
        metavar="REAR;FRONT",
        help="their ellipses, each cx,cy,a,b,angle (half axes in px, degrees), or a JSON file",
    )
    start.add_argument(
        "--find-wheels",
        type=rectangle,
        metavar="LEFT,TOP,WIDTH,HEIGHT",
        help="look for both wheels in a rectangle about the car, in px",
    )
    start.add_argument(
        "--start", choices=("auto",), help="look for one: in the --box, else in the whole photo"
    )
    group.add_argument(
        "--box", type=rectangle, metavar="LEFT,TOP,WIDTH,HEIGHT", help="about the object, px"
    )
    group.add_argument(
        "--projection",
        choices=("perspective", "parallel"),
        default="perspective",
        help="where no pose file says it",
    )
    group.add_argument(
        "--focal", type=positive, metavar="PX", help="where no pose file says it (EXIF's)"
    )


def _add_files(parser: argparse.ArgumentParser, pose: str = "") -> None:
    parser.add_argument("photo", type=Path, metavar="PHOTO")
    parser.add_argument("model", type=Path, metavar="MODEL")
    if pose:
        parser.add_argument("--pose", type=Path, required=True, metavar="POSE.json", help=pose)
    parser.add_argument("--quiet", action="store_true", help="no progress, no notes")
    add_calibration(parser)


def _add_limits(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--evaluations", type=whole, default=20_000, help="limit (20000)")
    group.add_argument("--seconds", type=positive, default=600.0, help="limit (600)")


def _add_settings(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("what is compared")
    group.add_argument("--chart", choices=("auto", "vehicle", "free-body"), default="auto")
    group.add_argument("--free-focal", action="store_true", help="find the focal length as well")
    group.add_argument("--grey", action="store_true", help="compare grey, not RGB")
    group.add_argument(
        "--colour-reflectance", action="store_true", help="RGB reflectance of the model (m = 12)"
    )
    group.add_argument(
        "--pixels",
        choices=("near", "whole", "clip"),
        help="those in a box about the start (near), the whole photo, or what the model covers "
        "(clip: the paper's clipped loss; its default)",
    )
    group.add_argument("--region", type=rectangle, metavar="LEFT,TOP,WIDTH,HEIGHT", help="in px")
    group.add_argument("--mask", type=Path, metavar="MASK.png", help="weights: white counts")
    group.add_argument("--renderer", choices=("software", "opengl"), default="software")


if __name__ == "__main__":
    sys.exit(main())
