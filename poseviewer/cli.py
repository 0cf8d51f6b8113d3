"""The command line: parse, load, call, print. Heavy imports happen inside the commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE, PoseViewerError

COMMANDS = ("app", "fit", "overlay", "landscape", "info", "demo", "bench")
LOOKS = ("outline", "edges", "relit", "residual", "normals", "solid", "none")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``poseviewer``; returns the exit code (2: something the user can mend)."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        from poseviewer import commands

        return getattr(commands, options.command)(options)
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
    info.set_defaults(command="info")
    _add_bench(commands)
    return parser


def _add_app(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("photo", type=Path, nargs="?", metavar="PHOTO")
    parser.add_argument("model", type=Path, nargs="?", metavar="MODEL")
    parser.add_argument("--pose", type=Path, metavar="POSE.json", help="the start")
    parser.add_argument("--port", type=_port, help="(the first free one from 8080 on)")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="serve others than this machine as well; the address then bears a token",
    )
    parser.add_argument("--no-browser", action="store_true", help="do not open the browser")
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
        "--lock", default="", metavar="NAME,...", help="numbers of the chart to hold"
    )
    search.add_argument("--evaluations", type=_whole, default=20_000, help="limit (20000)")
    search.add_argument("--seconds", type=_positive, default=600.0, help="limit (600)")
    search.add_argument(
        "--tolerance",
        type=_positive,
        metavar="SHARE",
        help="size at which a simplex is done (1e-4)",
    )
    search.add_argument("--step", type=_positive, metavar="SHARE", help="edge of the first simplex")
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
    landscape.add_argument("--size", type=_map_size, default=41, help="points a side (41)")
    landscape.add_argument(
        "--range", type=_positive, default=0.2, metavar="SHARE", help="half width (0.2: 20 %%)"
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


def _add_start(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("start, one of")
    start = group.add_mutually_exclusive_group(required=True)
    start.add_argument("--pose", type=Path, metavar="POSE.json", help="a pose file")
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
        type=_rectangle,
        metavar="LEFT,TOP,WIDTH,HEIGHT",
        help="look for both wheels in a rectangle about the car, in px",
    )
    group.add_argument(
        "--projection",
        choices=("perspective", "parallel"),
        default="perspective",
        help="where no pose file says it",
    )
    group.add_argument(
        "--focal", type=_positive, metavar="PX", help="where no pose file says it (EXIF's)"
    )


def _add_files(parser: argparse.ArgumentParser, pose: str = "") -> None:
    parser.add_argument("photo", type=Path, metavar="PHOTO")
    parser.add_argument("model", type=Path, metavar="MODEL")
    if pose:
        parser.add_argument("--pose", type=Path, required=True, metavar="POSE.json", help=pose)
    parser.add_argument("--quiet", action="store_true", help="no progress, no notes")


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
        default="near",
        help="those in a box about the start, the whole photo, or what the model covers (the "
        "paper's clipped loss)",
    )
    group.add_argument("--region", type=_rectangle, metavar="LEFT,TOP,WIDTH,HEIGHT", help="in px")
    group.add_argument("--mask", type=Path, metavar="MASK.png", help="weights: white counts")
    group.add_argument("--renderer", choices=("software", "opengl"), default="software")


def _number(text: str, kind: type[int] | type[float], wanted: str) -> float:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not {wanted}") from None


def _positive(text: str) -> float:
    value = _number(text, float, "a number above 0")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0")
    return value


def _whole(text: str) -> int:
    value = int(_number(text, int, "a whole number above 0"))
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number above 0")
    return value


def _port(text: str) -> int:
    value = int(_number(text, int, "a port, from 0 to 65535"))
    if not 0 <= value <= 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port, from 0 to 65535")
    return value


def _map_size(text: str) -> int:
    value = int(_number(text, int, "an odd number from 3 to 401"))
    if not 3 <= value <= 401 or value % 2 == 0:
        raise argparse.ArgumentTypeError(f"{text} is not an odd number from 3 to 401")
    return value


def _rectangle(text: str) -> tuple[int, int, int, int]:
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not four whole numbers, left,top,width,height"
        ) from None
    return left, top, width, height


if __name__ == "__main__":
    sys.exit(main())
