"""Output of commands on the terminal, and checks before their work."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.errors import PoseViewerError, printable
from poseviewer.files.writing import require_replaceable

if TYPE_CHECKING:
    from tqdm import tqdm

GOES_ON = "what is done is kept, and the same command goes on"
"""Clause on what Ctrl-C leaves of a command that fills its folder of results as it works."""


def say(text: str) -> None:
    """Print lines on standard output, without control characters."""
    print("\n".join(map(printable, text.split("\n"))), flush=True)


def tell(text: str) -> None:
    """Print a line on standard error, without control characters."""
    print(printable(text), file=sys.stderr, flush=True)


def ignore(text: str) -> None:
    """Print nothing: stands for ``tell`` with ``--quiet``."""


def tell_of_compiling() -> None:
    """Announce that the first run on a machine compiles the kernels."""
    from poseviewer.render.software.compiled import kernels_are_compiled

    if not kernels_are_compiled():
        tell("Compiling the kernels for this machine: about half a minute, this once.")


def progress_bar(
    total: int | None, quiet: bool, done: int = 0,
    shape: str = "{desc} [{elapsed}, {n_fmt} evaluations, {rate_fmt}]",
) -> tqdm:  # fmt: skip
    """Make a progress bar on standard error, shown after a second.

    Args:
        total: number of steps; None: not known.
        quiet: whether nothing is shown.
        done: steps that were done before.
        shape: tqdm's format of a bar without a total.
    """
    from tqdm import tqdm

    if total is not None:
        shape = "{percentage:3.0f}% |{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}]"
    # A log file needs a line now and then, not ten a second.
    interval = 0.1 if sys.stderr.isatty() else 5.0
    how = {"delay": 1.0, "mininterval": interval, "disable": quiet, "leave": False}
    return tqdm(total=total, initial=done, bar_format=shape, **how)


def require_writable(path: Path, error: type[PoseViewerError]) -> None:
    """Refuse a file that cannot be written, before the work begins."""
    if not path.parent.is_dir():
        raise error(f"{path}: there is no folder {path.parent}; make it, or write elsewhere")
    require_replaceable(path, error)
    if not os.access(path.parent, os.W_OK):
        raise error(f"{path}: {path.parent} is not yours to write to; write elsewhere")


def take_all(results: Generator[object, None, None], taken: Callable[[], object]) -> bool:
    """Take all results, call ``taken`` after each, and tell whether Ctrl-C has ended that."""
    with closing(results):
        try:
            for _ in results:
                taken()
        except KeyboardInterrupt:
            return True
    return False
