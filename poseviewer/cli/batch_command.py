"""Fit every row of a table with the columns photo, model and start (a pose file, or auto); relative
paths start from the table's folder. Or fit the images of a BOP scene. Run again, it goes on where
it was.
"""

from argparse import Namespace
from contextlib import closing

from poseviewer.cli import options as table
from poseviewer.cli.case import settings_of
from poseviewer.cli.terminal import progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE

OPTIONS = {
    "": (
        table.option("jobs JOBS.csv|BOP_SCENE"),
        table.option("--out FOLDER", required=True),
        table.option("--processes N", "(one for each processor)"),
        table.SCHEDULER,
        table.QUIET,
    ),
    "of a BOP scene": (
        table.option("--models FOLDER", "of obj_000001.ply and so on, in mm"),
        table.option("--objects N,...", "(all with a pose)"),
    ),
    "what is compared": table.COMPARED,
    "search": (*table.LIMITS, table.KEEP_START),
}


def run(options: Namespace) -> int:
    """Write a pose and a picture for each row, a table and a report."""
    from poseviewer.batch.results import REPORT, TABLE
    from poseviewer.batch.run import open_batch, run_batch, save_summaries

    named = options.jobs, options.out, settings_of(options), options.mask
    batch = open_batch(*named, options.models, options.objects or ())
    to_do, count = batch.to_do(), len(batch.jobs)
    keys = {job.key for job in to_do}
    if (done := sum(job.key not in keys for job in batch.jobs)) and not options.quiet:
        tell(f"{done} of {count} rows were done before.")
    stopped = False
    results = run_batch(batch, to_do, scheduler=options.scheduler, processes=options.processes)
    with closing(results), progress_bar(len(to_do), options.quiet) as bar:
        try:
            for _ in results:
                bar.update()
        except KeyboardInterrupt:
            stopped = True
    rows = save_summaries(batch)
    failed = sum(row.result.failed for row in rows)
    more = "; stopped, run it again to go on" if stopped else ""
    say(f"{len(rows) - failed} of {count} rows fitted, {failed} failed{more}")
    say(f"table: {options.out / TABLE}\nreport: {options.out / REPORT}")
    if batch.scene is not None:
        say(f"BOP scene: {options.out}")
    if stopped:
        return EXIT_INTERRUPTED
    return EXIT_MENDABLE if failed else 0
