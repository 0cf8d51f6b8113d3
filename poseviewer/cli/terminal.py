"""Output of commands on the terminal, and checks before their work."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.errors import PoseViewerError, printable
from poseviewer.files.writing import require_replaceable

if TYPE_CHECKING:
    from tqdm import tqdm


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


def progress_bar(total: int | None, quiet: bool) -> tqdm:
    """Make a progress bar on standard error, shown after a second."""
    from tqdm import tqdm

    shape = "{desc} [{elapsed}, {n_fmt} evaluations, {rate_fmt}]"
    if total is not None:
        shape = "{percentage:3.0f}% |{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}]"
    # A log file needs a line now and then, not ten a second.
    interval = 0.1 if sys.stderr.isatty() else 5.0
    return tqdm(
        total=total, bar_format=shape, delay=1.0, mininterval=interval, disable=quiet, leave=False
    )


def require_writable(path: Path, error: type[PoseViewerError]) -> None:
    """Refuse a file that cannot be written, before the work begins."""
    if not path.parent.is_dir():
        raise error(f"{path}: there is no folder {path.parent}; make it, or write elsewhere")
    require_replaceable(path, error)
    if not os.access(path.parent, os.W_OK):
        raise error(f"{path}: {path.parent} is not yours to write to; write elsewhere")


def take_all(results: Generator[object, None, None], count: int, quiet: bool) -> bool:
    """Take all results, with a progress bar of ``count``; tell whether Ctrl-C has ended that."""
    with closing(results), progress_bar(count, quiet) as bar:
        try:
            for _ in results:
                bar.update()
        except KeyboardInterrupt:
            return True
    return False
