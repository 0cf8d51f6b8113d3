"""Fit from many starts, on synthetic photos and others with known poses; write DIR/trials.csv,
study.md and study.png. Rows that are there are not run again.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.options import (
    add_fields,
    listed,
    made,
    names,
    option,
    positive,
    refuse_with_paper,
    seed,
    size,
    whole,
)
from poseviewer.cli.terminal import ignore, progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, SettingsError
from poseviewer.fit.settings import FitSettings, Limits

if TYPE_CHECKING:
    from poseviewer.evaluation.bop import BopPlan
    from poseviewer.evaluation.plan import RealPlan, StudyPlan


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
    kinds = "plain,background,photo-parallel,photo-perspective"
    option(drawn, "--kinds NAME,...", kinds, names)
    option(drawn, "--photos N", "synthetic ones of a kind (5)", whole)
    option(drawn, "--size WIDTHxHEIGHT", "of these (640x480)", size)
    option(drawn, "--projection", "of these", choices=("parallel", "perspective"))
    option(drawn, "--model MODEL", "a vehicle (the bundled one)", Path)
    option(drawn, "--backgrounds FOLDER", "of photos", Path)
    option(drawn, "--cars FOLDER", "of cases.json, for photo-...", Path)
    option(drawn, "--seed SEED", kind=seed)
    real = parser.add_argument_group("real photos with fixed starts")
    option(real, "--real FOLDER", "of cases.json and starts.json", Path, dest="folder")
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
    from poseviewer.evaluation.run import open_study, write_report
    from poseviewer.render.pool import processors

    plan = _plan_of(options)
    try:
        run = open_study(plan, ignore if options.quiet else tell)
        with progress_bar(len(run.left), options.quiet) as bar:
            for _ in run.trials(options.jobs or processors()):
                bar.update()
    except KeyboardInterrupt:
        tell("poseviewer: stopped; what is done is kept: run the same again to go on.")
        return EXIT_INTERRUPTED
    say(write_report(run).as_text())
    say(f"\nrows, summary: {run.out}")
    return 0


def _plan_of(options: Namespace) -> StudyPlan | RealPlan | BopPlan:
    """The study that is wanted; what was not typed is as its plan has it.

    Raises:
        SettingsError: the options do not go together, or one is out of range.
    """
    from poseviewer.evaluation.bop import BopPlan
    from poseviewer.evaluation.plan import RealPlan, StudyPlan

    refuse_with_paper(options)
    chosen = {"real": options.folder, "bop": options.bop}
    plans = {"": StudyPlan, "real": RealPlan, "bop": BopPlan}
    named = [name for name, value in chosen.items() if value is not None]
    if len(named) > 1:
        raise SettingsError("--real and --bop are two studies; leave one of them out")
    wanted = plans.pop(named[0] if named else "")
    known = {field.name for field in fields(wanted)}
    for other, plan in plans.items():
        for name in (field.name for field in fields(plan) if field.name not in known):
            if getattr(options, name) is not None:
                where = f"--{other}" if other else "synthetic photos"
                flag = f"--{name.replace('_', '-')}"
                raise SettingsError(f"{flag} goes with {where}; leave out {flag}")
    return made(wanted, options, limits=made(Limits, options))
