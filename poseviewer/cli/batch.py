"""Fit every row of a table with the columns photo, model and start (a pose file, or auto); relative
paths start from the table's folder. Or fit the images of a BOP scene. Run again, it goes on where
it was.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.options import (
    KEPT,
    add_fields,
    add_search,
    add_settings,
    listed,
    made,
    option,
    refuse,
    settings_of,
    whole,
)
from poseviewer.cli.terminal import progress_bar, say, tell
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE
from poseviewer.fit.settings import FitSettings

if TYPE_CHECKING:
    from poseviewer.batch.scene import SceneOptions


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer batch``."""
    option(parser, "jobs JOBS.csv|BOP_SCENE", kind=Path)
    option(parser, "--out FOLDER", kind=Path, required=True)
    option(parser, "--processes N", "(one for each processor)", whole)
    option(parser, "--scheduler ADDRESS", "of a Dask cluster to run on")
    option(parser, "--quiet", "no progress")
    scene = parser.add_argument_group("of a BOP scene")
    option(scene, "--models FOLDER", "of obj_000001.ply and so on, in mm", Path)
    option(scene, "--objects NUMBER,...", "(all with a pose)", listed(whole))
    add_settings(parser)
    add_fields(add_search(parser), FitSettings, KEPT)


def run(options: Namespace) -> int:
    """Write a pose and a picture for each row, a table and a report."""
    from poseviewer.batch.results import REPORT, TABLE
    from poseviewer.batch.run import open_batch, run_batch, save_outcome

    scene = _scene_options(options)
    opened = open_batch(options.jobs, options.out, settings_of(options), options.mask, scene)
    rows = len(opened.jobs)
    if opened.done and not options.quiet:
        tell(f"{len(opened.done)} of {rows} rows were done before.")
    fresh, stopped = [], False
    results = run_batch(opened, scheduler=options.scheduler, processes=options.processes)
    with closing(results), progress_bar(len(opened.to_do), options.quiet) as bar:
        try:
            for result in results:
                fresh.append(result)
                bar.update()
        except KeyboardInterrupt:
            stopped = True
    known = save_outcome(opened, fresh)
    failed = sum(result.failed for result in known)
    more = "; stopped, run it again to go on" if stopped else ""
    say(f"{len(known) - failed} of {rows} rows fitted, {failed} failed{more}")
    say(f"table: {options.out / TABLE}\nreport: {options.out / REPORT}")
    if opened.manifest.scene is not None:
        say(f"BOP scene: {options.out}")
    if stopped:
        return EXIT_INTERRUPTED
    return EXIT_MENDABLE if failed else 0


def _scene_options(options: Namespace) -> SceneOptions | None:
    """What the options say of a BOP scene; None for a table."""
    from poseviewer.batch.scene import SceneOptions

    if options.jobs.is_dir():
        return made(SceneOptions, options)
    table = f"with {options.jobs.name}, which is a table: it is for the folder of a BOP scene"
    refuse(options, ("models", "objects"), f"{table}; leave it out, or name such a folder")
    return None
