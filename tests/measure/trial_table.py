"""Trials on the way: a line of CSV for each as soon as it is known, a summary at the end."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, TypeVar

from poseviewer.errors import EXIT_MENDABLE, PoseViewerError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Row = TypeVar("Row", bound="DataclassInstance")


def print_trials(trials: Iterable[Row], summary: Callable[[Sequence[Row]], str]) -> int:
    """Print dataclasses as CSV on standard output, then their summary on standard error.

    Returns the exit code. A trial that cannot be run ends it with a sentence; what was printed
    before stays.
    """
    found: list[Row] = []
    try:
        table = csv.writer(sys.stdout)
        for one in trials:
            if not found:
                table.writerow([field.name for field in fields(one)])
            table.writerow(asdict(one).values())
            sys.stdout.flush()
            found.append(one)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    sys.stderr.write(summary(found) + "\n")
    return 0
