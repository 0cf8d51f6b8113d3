"""The command line: find the command, parse its options, run it.

Each command is a module, ``NAME_command``, with ``OPTIONS``, ``EXAMPLES`` and ``run``; the module's
docstring is its description. ``run`` imports what is slow to import. ``STOPPED`` says what Ctrl-C
leaves of a command that writes before its end.
"""

import io
import logging
import os
import re
import signal
import sys
from argparse import ArgumentParser, HelpFormatter, Namespace
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from poseviewer import __version__
from poseviewer.cli.options import Options, add_all, in_options, inputs
from poseviewer.cli.terminal import tell
from poseviewer.errors import (
    EXIT_BUG,
    EXIT_INTERRUPTED,
    EXIT_MENDABLE,
    LOG_VARIABLE,
    MAX_MESSAGE,
    PoseViewerError,
    printable,
    sentence_of,
)
from poseviewer.files.writing import keeping

_log = logging.getLogger(__name__)

COMMANDS = {
    "app": "open the app, as without a command",
    "demo": "fit the bundled demo without the app",
    "fit": "search for the pose from a start pose",
    "overlay": "draw the model over the photo",
    "landscape": "map the loss about a pose for all pairs of parameters",
    "info": "print what poseviewer understood of a file",
    "bench": "measure how fast this machine is",
    "convert": "write a pose for another tool, or read one of its poses",
    "render": "write masks, depth, normals and object coordinates of a pose",
    "undistort": "write the undistorted photo, to which the poses belong",
    "study": "measure from how far off fits find the pose",
    "batch": "fit many photos",
    "track": "propagate poses through a video or a folder of frames",
    "cameras": "find the cameras of a clip or photos of a scene that stands still",
    "paint": "paint the model from photos at known poses, and write it",
    "audit": "refine and judge given poses, and list those that seem wrong",
    "review": "review the results of a batch or an audit, the worst first",
    "identify": "rank several models by how well they explain a photo",
}
"""Commands and their lines in ``poseviewer --help``."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``poseviewer``; returns the exit code (2: an error that the user can mend)."""
    known: Options = {}
    stopped = "nothing was written"
    try:
        _make_ready()
        options = parse(sys.argv[1:] if arguments is None else arguments)
        command = import_module(f"poseviewer.cli.{options.command}_command")
        known, stopped = command.OPTIONS, getattr(command, "STOPPED", stopped)
        with keeping(inputs(options, known)):
            return command.run(options)
    except KeyboardInterrupt:
        tell(f"poseviewer: stopped; {stopped}.")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader of the output is gone
        return 0
    except Exception as error:  # noqa: BLE001 - every error becomes a sentence
        _log.debug("stopped by", exc_info=error)
        tell(f"poseviewer: {in_options(sentence_of(error), known)}")
        mendable = isinstance(error, (PoseViewerError, OSError, MemoryError))
        return EXIT_MENDABLE if mendable else EXIT_BUG


def _make_ready() -> None:
    """Make output printable on any terminal, replace closed streams, log warnings, and let SIGTERM
    end a command as Ctrl-C does.
    """
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # else the next opened file takes its descriptor
            setattr(sys, name, Path(os.devnull).open("r+"))  # noqa: SIM115
    for name in ("NUMBA_DISABLE_JIT", "NUMBA_NUM_THREADS"):  # the kernels must be compiled
        os.environ.pop(name, None)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    logging.captureWarnings(True)
    if os.environ.get(LOG_VARIABLE):
        handler = logging.StreamHandler()
        handler.setFormatter(_WithoutTokens(logging.BASIC_FORMAT))
        logging.basicConfig(handlers=[handler])
        logging.getLogger("poseviewer").setLevel(logging.DEBUG)


class _WithoutTokens(logging.Formatter):
    """Formatter that leaves out the app's token: logs are sent to others."""

    def format(self, record: logging.LogRecord) -> str:
        return re.sub(r"token=[^\s&]*", "token=...", super().format(record))


class _Formatter(HelpFormatter):
    """Formatter that wraps texts, but not examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith("examples:") else super()._fill_text(text, width, indent)


class _Parser(ArgumentParser):
    """Parser that prints one line for a wrong argument, as for all other errors."""

    def error(self, message: str) -> NoReturn:
        shown = printable(message, MAX_MESSAGE)
        self.exit(EXIT_MENDABLE, f"{self.prog}: {shown}; see {self.prog} --help\n")


def parse(arguments: Sequence[str]) -> Namespace:
    """Parse the options of a command, or those of the app if no command is named."""
    first = arguments[0] if arguments else ""
    if first not in (*COMMANDS, "-h", "--help", "--version"):
        arguments = ["app", *arguments]
    options, unknown = make_parser(arguments[0]).parse_known_args(arguments)
    if unknown:
        options.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    return options


def make_parser(command: str) -> ArgumentParser:
    """Make the parser of all commands, with the options of ``command`` alone."""
    parser = _Parser(
        prog="poseviewer",
        description="Register a known 3D model onto one photo of the object. Without a command: "
        "open the app in the browser, on PHOTO and MODEL, or on the bundled demo "
        "(poseviewer app --help).",
    )
    parser.add_argument(
        "--version", action="version", version=f"poseviewer {__version__}", help="print the version"
    )
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", dest="command", required=True
    )
    for name, text in COMMANDS.items():
        own = commands.add_parser(name, help=text, formatter_class=_Formatter)
        if name == command:
            module = import_module(f"poseviewer.cli.{name}_command")
            own.description = module.__doc__
            own.epilog = "\n".join(("examples:", *(f"  {line}" for line in module.EXAMPLES)))
            own.set_defaults(parser=own)
            for title, options in module.OPTIONS.items():
                add_all(own.add_argument_group(title) if title else own, options)
    return parser


if __name__ == "__main__":
    sys.exit(main())
