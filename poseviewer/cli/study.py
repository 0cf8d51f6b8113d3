"""Fit from many starts, on synthetic photos and others with known poses; write DIR/trials.csv,
study.md and study.png. Rows that are there are not run again.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import add_fields, listed, names, option, positive, size, whole
from poseviewer.cli.terminal import ignore, progress_bar, tell
from poseviewer.errors import EXIT_INTERRUPTED
from poseviewer.fit.settings import FitSettings, Limits


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer study``."""
    option(parser, "--out DIR", kind=Path, required=True)
    fit = {"method": ("--method",), "pixels": ("--pixels", "as of fit")}
    add_fields(parser, FitSettings, fit)
    parser.set_defaults(method="default")
    limit = Limits().evaluations
    option(parser, "--evaluations N", f"limit of a fit ({limit})", whole, default=limit)
    option(parser, "--jobs N", "processes (one per processor)", whole)
    option(parser, "--quiet", "no progress")
    drawn = parser.add_argument_group("deviations of a vehicle's parameters")
    option(drawn, "--starts N", "for each point (10)", whole)
    option(drawn, "--deviations PERCENT,...", kind=listed(positive))
    option(drawn, "--readings NAME,...", "relative,absolute", names)
    kinds = "plain,background,photo-parallel,photo-perspective (these), grey"
    option(drawn, "--kinds NAME,...", kinds, names)
    cycles = "cycles: path-traced by Blender (poseviewer[photo])"
    option(drawn, "--photographer", cycles, choices=("opengl", "cycles"))
    option(drawn, "--photos N", "synthetic ones of a kind (5)", whole)
    option(drawn, "--size WIDTHxHEIGHT", "of these (640x480)", size)
    option(drawn, "--projection", "of these", choices=("parallel", "perspective"))
    option(drawn, "--model MODEL", "a vehicle (the bundled one)", Path)
    option(drawn, "--backgrounds FOLDER", "of photos", Path)
    option(drawn, "--cars FOLDER", "of cases.json, for photo-...", Path)
    option(drawn, "--seed SEED", kind=int)
    real = parser.add_argument_group("real photos with fixed starts")
    option(real, "--real FOLDER", "of cases.json and starts.json", Path)
    option(real, "--degrees N,...", "(5,15)", listed(whole))
    option(real, "--cases PATTERN", "a part of the id, or with * and ?")
    option(real, "--draws N", "starts of each case (5)", whole)


def run(options: Namespace) -> int:
    """Print the table."""
    from poseviewer.render.pool import processors
    from poseviewer.study.plan import read_plan
    from poseviewer.study.run import open_study, write_report

    plan = read_plan(options)
    try:
        run = open_study(plan, ignore if options.quiet else tell)
        with progress_bar(len(run.left), options.quiet) as bar:
            for _ in run.trials(options.jobs or processors()):
                bar.update()
    except KeyboardInterrupt:
        tell("poseviewer: stopped; what is done is kept: run the same again to go on.")
        return EXIT_INTERRUPTED
    print(write_report(run).as_text())
    print(f"\nrows, summary: {run.out}")
    return 0
