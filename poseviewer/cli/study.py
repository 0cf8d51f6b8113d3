"""Fit from many starts, on synthetic photos and others with known poses; write DIR/trials.csv and
study.md. Rows that are there are not run again.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import (
    add_fields,
    listed,
    made,
    names,
    option,
    positive,
    refuse,
    refuse_with_paper,
    seed,
    size,
    whole,
)
from poseviewer.cli.terminal import ignore, progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, SettingsError
from poseviewer.fit.settings import FitSettings, Limits

GROUPS = {
    "": ("starts", "deviations", "readings", "kinds", "photos", "size", "model", "seed"),
    "real": ("degrees", "cases", "draws", "among_others"),
    "bop": ("dataset",),
}
"""Options of one study alone, by the option that chooses it."""


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer study``."""
    option(parser, "--out DIR", kind=Path, required=True)
    fit = {"method": ("--method",), "pixels": ("--pixels", "as of fit")}
    add_fields(parser, FitSettings, fit)
    limit = ("--evaluations N", "limit of a fit ({:g})", whole)
    add_fields(parser, Limits, {"evaluations": limit})
    option(parser, "--jobs N", "processes (one per processor)", whole)
    option(parser, "--quiet", "no progress")
    drawn = parser.add_argument_group("deviations of a vehicle's parameters")
    option(drawn, "--starts N", "for each point (10)", whole)
    option(drawn, "--deviations PERCENT,...", kind=listed(positive))
    option(drawn, "--readings NAME,...", "relative,absolute", names)
    option(drawn, "--kinds NAME,...", "plain,background,photo-parallel,photo-perspective", names)
    option(drawn, "--photos N", "synthetic ones of a kind (5)", whole)
    option(drawn, "--size WIDTHxHEIGHT", "of these (640x480)", size)
    option(drawn, "--model MODEL", "a vehicle, for these (the bundled one)", Path)
    option(drawn, "--seed SEED", kind=seed)
    real = parser.add_argument_group("real photos with fixed starts")
    option(real, "--real FOLDER", "of cases.json and starts.json", Path)
    option(real, "--degrees N,...", "(5,15)", listed(whole))
    option(real, "--cases PATTERN", "a part of the id, or with * and ?")
    option(real, "--draws N", "starts of each case (5)", whole)
    told = "give the true poses of the other cases of each photo, for what they hide"
    option(real, "--among-others", told, default=None)
    bop = parser.add_argument_group("published estimates of a BOP data set")
    option(bop, "--bop ESTIMATES", "a table of BOP results; fits start from it", Path)
    option(bop, "--dataset FOLDER", "of models and test (above the table)", Path)


def run(options: Namespace) -> int:
    """Print the table."""
    _refuse_of_others(options)
    from poseviewer.evaluation.study import Plan, open_study, write_report
    from poseviewer.render.pool import processors

    plan = made(Plan, options, limits=made(Limits, options))
    try:
        run = open_study(plan, ignore if options.quiet else tell)
        with progress_bar(len(run.left), options.quiet) as bar:
            for _ in run.trials(options.jobs or processors()):
                bar.update()
    except KeyboardInterrupt:
        tell("poseviewer: stopped; what is done is kept: run the same again to go on.")
        return EXIT_INTERRUPTED
    say(write_report(run).as_markdown())
    say(f"\nrows, summary: {run.out}")
    return 0


def _refuse_of_others(options: Namespace) -> None:
    """Refuse options that do not go together."""
    refuse_with_paper(options)
    if options.real and options.bop:
        raise SettingsError("--real and --bop are two studies; leave one of them out")
    chosen = "real" if options.real else "bop" if options.bop else ""
    for study, own in GROUPS.items():
        if study != chosen:
            where = f"--{study}" if study else "synthetic photos"
            refuse(options, own, f"goes with {where}; leave it out")
