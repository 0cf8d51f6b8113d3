"""Measure how long evaluations take on each path, searches and maps."""

from argparse import Namespace
from dataclasses import asdict

from poseviewer.cli import options as table
from poseviewer.cli.terminal import ignore, require_writable, say, tell, tell_of_compiling
from poseviewer.errors import SettingsError

OPTIONS = {
    "": (
        table.option("--quick", "fewer runs, fits of 15 s at most: about a minute"),
        table.option("--json FILE", "write all rows", is_output=True),
        table.QUIET,
    )
}


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
