"""Fit from many starts on photos with known poses, synthetic or real, and write DIR/trials.csv and
study.md. The same command continues a study that was stopped.
"""

from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path

from poseviewer.cli import options as table
from poseviewer.cli.case import refuse_beside_loss
from poseviewer.cli.terminal import ignore, progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, SettingsError
from poseviewer.evaluation.plan import KINDS, READINGS, Plan
from poseviewer.losses.paper_loss import PAPER
from poseviewer.scene.settings import Limits

PLAN = Plan(out=Path())
"""Plan with the defaults that the help names."""
MIN_SIDE_PX = 32
"""Least side of a synthetic photo, in px: on smaller ones no fit has enough pixels."""


def _join(values: Iterable[object]) -> str:
    return ",".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)


OPTIONS = {
    "": (
        table.option("--out DIR", "write trials.csv and study.md here", required=True),
        *table.METHODS,
        table.option("--pixels", "compare these pixels, see fit (default: near, or the paper's)"),
        table.EVALUATIONS,
        table.option("--jobs N", "run this number of processes (default: one a processor)"),
        table.SCHEDULER,
        table.QUIET,
    ),
    "deviations of a vehicle's parameters": (
        table.option("--paper", "measure by the paper's loss and search unless others are named"),
        table.option("--starts N", f"fit from N starts a point (default: {PLAN.starts})"),
        table.option(
            "--deviations PERCENT,...",
            f"put starts so far off, in %% of each parameter (default: {_join(PLAN.deviations)})",
        ),
        table.option(
            "--readings NAME,...",
            f"measure %% of a parameter's value or of its scale (default: {_join(READINGS)})",
            type=table.some_of(READINGS),
        ),
        table.option(
            "--kinds NAME,...",
            f"fit these kinds of photos (default: {_join(KINDS)})",
            type=table.some_of(KINDS),
        ),
        table.option("--photos N", f"draw N synthetic photos of a kind (default: {PLAN.photos})"),
        table.option(
            "--size WIDTHxHEIGHT",
            "draw photos of this size, in px (default: {}x{})".format(*PLAN.size),
        ),
        table.option("--model MODEL", "draw this vehicle (default: the bundled car)"),
        table.option("--seed SEED", f"seed the random numbers (default: {PLAN.seed})"),
    ),
    "real photos with fixed starts": (
        table.option("--real FOLDER", "fit the photos of cases.json here (default: none)"),
        table.option(
            "--degrees N,...",
            f"fit from starts so far off, in degrees (default: {_join(PLAN.degrees)})",
        ),
        table.option(
            "--cases PATTERN", "fit cases whose id holds this text or pattern (default: all)"
        ),
        table.option("--draws N", f"fit from N starts for each case (default: {PLAN.draws})"),
        table.option("--among-others", "give the true poses of the other cases, as occluders"),
        table.option("--free-focal", "search for the focal length, too, from a tenth off"),
    ),
    "published estimates of a BOP data set": (
        table.option("--bop ESTIMATES", "fit from this table of BOP results (default: none)"),
        table.option("--dataset FOLDER", "read models and test here (default: above the table)"),
    ),
}
EXAMPLES = (
    "poseviewer study --paper --starts 5 --out paper",
    "poseviewer study --real photos --degrees 5,15 --draws 1 --out real",
)


def run(options: Namespace) -> int:
    """Print the table."""
    options.loss = options.loss or (PAPER.name if options.paper else None)
    _refuse_mixed_studies(options)
    from poseviewer.evaluation.study import open_study, write_report
    from poseviewer.render.pool import processors

    plan = table.make(Plan, options, limits=table.make(Limits, options))
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


def _refuse_mixed_studies(options: Namespace) -> None:
    """Refuse options that do not go together."""
    refuse_beside_loss(options)
    if options.real and options.bop:
        raise SettingsError("--real and --bop are two studies; leave one of them out")
    if options.size and min(options.size) < MIN_SIDE_PX:
        raise SettingsError(f"--size: each side needs {MIN_SIDE_PX} px at least")
    _, synthetic, (real, *of_real), (bop, *of_bop) = OPTIONS.values()
    is_other = bool(options.real or options.bop)
    table.refuse(options, synthetic if is_other else (), "goes with synthetic photos; leave it out")
    for chosen, own in ((real, of_real), (bop, of_bop)):
        if not getattr(options, chosen.name):
            table.refuse(options, own, f"goes with {chosen.flag}; leave it out")
