"""Measure how long evaluations take on each path, searches and maps."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import option
from poseviewer.cli.terminal import ignore, require_writable, say, tell, tell_of_compiling
from poseviewer.errors import SettingsError


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer bench``."""
    option(parser, "--quick", "50,000 triangles at 640x480 alone: under a minute")
    option(parser, "--json FILE", "write all rows", Path)
    option(parser, "--plot FILE.png", "draw them", Path)
    option(parser, "--markdown", "print tables for a README")
    option(parser, "--quiet", "no progress")


def run(options: Namespace) -> int:
    """Print the tables."""
    from poseviewer.bench import report as reports
    from poseviewer.bench.run import QUICK, BenchOptions, run_bench
    from poseviewer.figures.bench_sheet import make_bench_sheet
    from poseviewer.figures.save import check_kind, save_figure
    from poseviewer.files.writing import write_whole

    for path in (options.json, options.plot):
        if path:
            require_writable(path, SettingsError)
    if options.plot:
        check_kind(options.plot)
    tell_of_compiling()
    wanted = QUICK if options.quick else BenchOptions()
    report = run_bench(wanted, ignore if options.quiet else tell)
    say(reports.as_text(report, options.markdown))
    if options.json:
        write_whole(options.json, reports.as_json_bytes(report), SettingsError)
        say(f"\nrows: {options.json}")
    if options.plot:
        save_figure(options.plot, make_bench_sheet(reports.make_sheet(report)))
        say(f"\nplot: {options.plot}")
    return 0
