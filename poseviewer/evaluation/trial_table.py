"""Trials on the way: a line of CSV for each as soon as it is known, a summary at the end."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields, is_dataclass
from typing import TypeVar

from poseviewer.errors import EXIT_MENDABLE, PoseViewerError

Row = TypeVar("Row")


def print_trials(trials: Iterable[Row], summary: Callable[[Sequence[Row]], str]) -> int:
    """Print dataclasses as CSV on standard output, then their summary on standard error.

    Returns the exit code. A trial that cannot be run ends it with a sentence; what was printed
    before stays.
    """
    found: list[Row] = []
    try:
        for one in trials:
            assert is_dataclass(one) and not isinstance(one, type)  # noqa: PT018
            table = csv.DictWriter(sys.stdout, [field.name for field in fields(one)])
            if not found:
                table.writeheader()
            table.writerow(asdict(one))
            sys.stdout.flush()
            found.append(one)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    sys.stderr.write(summary(found) + "\n")
    return 0
