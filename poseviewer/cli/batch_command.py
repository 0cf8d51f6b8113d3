"""Fit every row of a table with the columns photo, model and start (a pose file, or auto), or every
image of a BOP scene. Relative paths in the table start from its folder. The same command continues
a batch that was stopped.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Generator
from contextlib import closing
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import make_settings, mask_of
from poseviewer.cli.terminal import GOES_ON, progress_bar, say, take_all, tell
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE

if TYPE_CHECKING:
    from poseviewer.batch.result_folder import JobResult

OUT = (
    table.option("--out FOLDER", "write poses, pictures, table and report here", required=True),
    table.option("--processes N", "run this number of processes (default: one a processor)"),
    table.SCHEDULER,
    table.QUIET,
)
BOP_SCENE = (
    table.option("--models FOLDER", "read obj_000001.ply, ..., in mm, here (default: none)"),
    table.option("--objects N,...", "fit these objects (default: all with a pose)"),
)
OPTIONS = {
    "": (
        table.option("jobs JOBS.csv|BOP_SCENE", "table of jobs, or the folder of a BOP scene"),
        *OUT,
    ),
    "BOP scene": BOP_SCENE,
    "comparison": table.COMPARED,
    "search": (*table.LIMITS, table.KEEP_START, table.FEATURES),
}
EXAMPLES = (
    "poseviewer batch jobs.csv --out results",
    "poseviewer batch test/000002 --models models --objects 1,5 --out results",
)
STOPPED = GOES_ON


def run(options: Namespace) -> int:
    """Write a pose and a picture for each row, a table and a report."""
    return run_rows(options)


def run_rows(options: Namespace, is_audit: bool = False) -> int:
    """Run the rows that are not done yet, and write the summaries of all."""
    from poseviewer.batch.audit import name_doubted
    from poseviewer.batch.result_folder import (
        REPORT,
        TABLE,
        summarise_failures,
        summarise_findings,
        summarise_questions,
    )
    from poseviewer.batch.run import open_batch, run_batch, save_summaries

    named = options.jobs, options.out, make_settings(options), mask_of(options)
    features = getattr(options, "features", None)
    batch = open_batch(*named, options.models, options.objects or (), is_audit, features)
    to_do, count = batch.to_do(), len(batch.jobs)
    keys = {job.key for job in to_do}
    if (done := sum(job.key not in keys for job in batch.jobs)) and not options.quiet:
        tell(f"{done} of {count} rows were done before.")
    results = run_batch(batch, to_do, scheduler=options.scheduler, processes=options.processes)
    with progress_bar(len(to_do), options.quiet) as bar:
        stopped = take_all(_asking(results), bar.update)
    rows = save_summaries(batch)
    failed = sum(row.result.failed for row in rows)
    more = "; stopped, run it again to go on" if stopped else ""
    say(f"{len(rows) - failed} of {count} rows fitted, {failed} failed{more}")
    if why := summarise_failures(rows):
        say(why)
    if is_audit:
        for line in (summarise_findings(rows), *name_doubted(batch, rows)):
            say(line)
    if question := summarise_questions(rows):
        say(question)
    say(f"table: {options.out / TABLE}\nreport: {options.out / REPORT}")
    if batch.scene is not None:
        say(f"BOP scene: {options.out}")
    if stopped:
        return EXIT_INTERRUPTED
    return EXIT_MENDABLE if failed else 0


def _asking(results: Generator[JobResult, None, None]) -> Generator[JobResult, None, None]:
    """Yield the results, and tell the first question as it comes: all rows may be for nothing."""
    with closing(results):
        asked = False
        for result in results:
            if result.question and not asked:
                tell(result.question)
            asked |= bool(result.question)
            yield result
