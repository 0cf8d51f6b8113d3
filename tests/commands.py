"""Commands as tests run them, and the tables that they write."""

import csv
from pathlib import Path

import pytest

from poseviewer.cli import main as cli


def run(line: object, *words: object) -> int:
    """Run ``poseviewer`` with the words of a line, and more; returns its exit code."""
    try:
        return cli.main([*str(line).split(), *map(str, words)])
    except SystemExit as stop:  # argparse's
        return int(stop.code or 0)


def refusal(capsys: pytest.CaptureFixture[str], line: object, *words: object) -> str:
    """Return the one line, harmless to a terminal, by which a command refuses."""
    assert run(line, *words) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (said,) = printed.err.splitlines()
    assert said.isprintable()
    assert len(said) < 1200
    return said


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
