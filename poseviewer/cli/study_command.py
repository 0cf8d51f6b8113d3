"""Fit from many starts, on synthetic photos and others with known poses; write DIR/trials.csv and
study.md. Rows that are there are not run again.
"""

from argparse import Namespace
from pathlib import Path

from poseviewer.cli import options as table
from poseviewer.cli.case import refuse_with_paper
from poseviewer.cli.terminal import ignore, progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, SettingsError
from poseviewer.evaluation.plan import KINDS, READINGS, Plan
from poseviewer.scene.settings import Limits

PLAN = Plan(out=Path())
SMALLEST_SIDE_PX = 32

OPTIONS = {
    "": (
        table.option("--out DIR", required=True),
        *table.METHODS,
        table.PIXELS,
        table.EVALUATIONS,
        table.option("--jobs N", "processes (one per processor)"),
        table.SCHEDULER,
        table.QUIET,
    ),
    "deviations of a vehicle's parameters": (
        table.option("--paper", "the paper's figure: by its loss and search, where none is named"),
        table.option("--starts N", f"for each point ({PLAN.starts})"),
        table.option("--deviations PERCENT,..."),
        table.option("--readings NAME,...", ",".join(READINGS), type=table.some_of(READINGS)),
        table.option("--kinds NAME,...", ",".join(KINDS), type=table.some_of(KINDS)),
        table.option("--photos N", f"synthetic ones of a kind ({PLAN.photos})"),
        table.option("--size WIDTHxHEIGHT", "of these ({}x{})".format(*PLAN.size)),
        table.option("--model MODEL", "a vehicle, for these (the bundled one)"),
        table.option("--seed SEED"),
    ),
    "real photos with fixed starts": (
        table.option("--real FOLDER", "of cases.json and starts.json"),
        table.option("--degrees N,...", f"({','.join(map(str, PLAN.degrees))})"),
        table.option("--cases PATTERN", "a part of the id, or with * and ?"),
        table.option("--draws N", f"starts of each case ({PLAN.draws})"),
        table.option(
            "--among-others", "give the true poses of the other cases, for what they hide"
        ),
        table.option("--free-focal", "start a tenth off in focal length, and find that as well"),
    ),
    "published estimates of a BOP data set": (
        table.option("--bop ESTIMATES", "a table of BOP results; fits start from it"),
        table.option("--dataset FOLDER", "of models and test (above the table)"),
    ),
}


def run(options: Namespace) -> int:
    """Print the table."""
    options.loss = options.loss or ("paper" if options.paper else None)
    _refuse_of_others(options)
    from poseviewer.evaluation.study import open_study, write_report
    from poseviewer.render.pool import processors

    plan = table.made(Plan, options, limits=table.made(Limits, options))
    try:
        run = open_study(plan, ignore if options.quiet else tell)
        with progress_bar(len(run.left), options.quiet) as bar:
            for _ in run.trials(options.jobs or processors(), options.scheduler):
                bar.update()
    except KeyboardInterrupt:
        tell("poseviewer: stopped; what is done is kept: run the same again to go on.")
        return EXIT_INTERRUPTED
    say(write_report(run))
    say(f"\nrows, summary: {run.out}")
    return 0


def _refuse_of_others(options: Namespace) -> None:
    """Refuse options that do not go together."""
    refuse_with_paper(options)
    if options.real and options.bop:
        raise SettingsError("--real and --bop are two studies; leave one of them out")
    if options.size and min(options.size) < SMALLEST_SIDE_PX:
        raise SettingsError(f"--size: each side needs {SMALLEST_SIDE_PX} px at least")
    _, synthetic, (real, *of_real), (bop, *of_bop) = OPTIONS.values()
    is_other = bool(options.real or options.bop)
    table.refuse(options, synthetic if is_other else (), "goes with synthetic photos; leave it out")
    for chosen, own in ((real, of_real), (bop, of_bop)):
        if not getattr(options, chosen.name):
            table.refuse(options, own, f"goes with {chosen.flag}; leave it out")
