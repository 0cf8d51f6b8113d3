"""Fit from many starts, on synthetic photos and others with known poses; write DIR/trials.csv and
study.md. Rows that are there are not run again.
"""

from __future__ import annotations

from argparse import Namespace

from poseviewer.cli.case import refuse, refuse_with_paper
from poseviewer.cli.options import (
    EVALUATIONS,
    METHOD,
    PIXELS,
    QUIET,
    made,
    option,
)
from poseviewer.cli.terminal import ignore, progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, SettingsError
from poseviewer.fit.settings import Limits

GROUPS = {
    "": ("starts", "deviations", "readings", "kinds", "photos", "size", "model", "seed"),
    "real": ("degrees", "cases", "draws", "among_others"),
    "bop": ("dataset",),
}
"""Options of one study alone, by the option that chooses it."""
OPTIONS = {
    "": (
        option("--out DIR", required=True),
        METHOD,
        PIXELS,
        EVALUATIONS,
        option("--jobs N", "processes (one per processor)"),
        QUIET,
    ),
    "deviations of a vehicle's parameters": (
        option("--starts N", "for each point (10)"),
        option("--deviations PERCENT,..."),
        option("--readings NAME,...", "relative,absolute"),
        option("--kinds NAME,...", "plain,background,photo-parallel,photo-perspective"),
        option("--photos N", "synthetic ones of a kind (5)"),
        option("--size WIDTHxHEIGHT", "of these (640x480)"),
        option("--model MODEL", "a vehicle, for these (the bundled one)"),
        option("--seed SEED"),
    ),
    "real photos with fixed starts": (
        option("--real FOLDER", "of cases.json and starts.json"),
        option("--degrees N,...", "(5,15)"),
        option("--cases PATTERN", "a part of the id, or with * and ?"),
        option("--draws N", "starts of each case (5)"),
        option("--among-others", "give the true poses of the other cases, for what they hide"),
    ),
    "published estimates of a BOP data set": (
        option("--bop ESTIMATES", "a table of BOP results; fits start from it"),
        option("--dataset FOLDER", "of models and test (above the table)"),
    ),
}


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
