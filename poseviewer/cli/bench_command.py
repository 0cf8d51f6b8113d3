"""Measure how long an evaluation of the loss takes by each renderer, and a search and maps."""

from argparse import Namespace
from dataclasses import asdict

from poseviewer.cli import options as table
from poseviewer.cli.terminal import ignore, require_writable, say, tell, tell_of_compiling
from poseviewer.errors import SettingsError

OPTIONS = {
    "": (
        table.option(
            "--quick", "measure with fewer runs and fits of 15 s at most, in about a minute"
        ),
        table.option("--json FILE", "write all rows as JSON (default: no file)", is_output=True),
        table.QUIET,
    )
}
EXAMPLES = ("poseviewer bench --quick", "poseviewer bench --json speed.json")


def run(options: Namespace) -> int:
    """Print the tables."""
    from poseviewer.evaluation.speed import measure_speed
    from poseviewer.files.writing import write_json

    if options.json:
        require_writable(options.json, SettingsError)
    tell_of_compiling()
    report = measure_speed(options.quick, ignore if options.quiet else tell)
    say(report.as_markdown())
    if options.json:
        write_json(options.json, asdict(report), SettingsError, indent=1)
        say(f"\nrows: {options.json}")
    return 0
