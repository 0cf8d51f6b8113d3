"""Commands as tests run them, and the tables that they write."""

import csv
from pathlib import Path

from poseviewer.cli import main as cli


def run(*arguments: object) -> int:
    """Run ``poseviewer`` in this process; returns its exit code, argparse's as well."""
    try:
        return cli.main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
