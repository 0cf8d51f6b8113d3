"""Propagate poses from the keys of a sequence, a video or a folder of frames, to its other frames.
The same command continues a sequence that was stopped.
"""

from __future__ import annotations

from argparse import Namespace
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.terminal import progress_bar, say, tell, tell_of_compiling
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE

if TYPE_CHECKING:
    from poseviewer.scene.types import Scene

OPTIONS = {
    "": (
        table.option("photo SCENE.json", "sequence with keys"),
        table.option("--out FOLDER", "write scene and table here", required=True),
        table.option("--processes N", "run this number of processes (default: one a processor)"),
        table.SCHEDULER,
        table.QUIET,
    ),
}
EXAMPLES = ("poseviewer track scene.json --out results",)


def run(options: Namespace) -> int:
    """Write the sequence with the propagated poses, and a table of its chains."""
    from poseviewer.batch.chains import SEQUENCE, open_chains, run_chain, save_sequence
    from poseviewer.batch.run import run_batch
    from poseviewer.render.pool import processors

    tell_of_compiling()
    batch = open_chains(_open(options), options.out)
    to_do, stopped = batch.to_do(), False
    if (done := len(batch.jobs) - len(to_do)) and not options.quiet:
        tell(f"{done} of {len(batch.jobs)} chains were done before.")
    processes = options.processes or min(processors(), max(len(to_do), 1))
    job = partial(run_chain, threads=max(1, processors() // processes))
    how = {"scheduler": options.scheduler, "processes": processes, "run": job}
    with (
        closing(run_batch(batch, to_do, **how)) as results,
        progress_bar(len(to_do), options.quiet) as bar,
    ):
        try:
            for _ in results:
                bar.update()
        except KeyboardInterrupt:
            stopped = True
    scene, notes = save_sequence(batch)
    for note in notes:
        say(note)
    failed = [row for row in batch.rows() if row.result.failed]
    for row in failed:
        say(f"{row.job.photo}: {row.result.reason}")
    posed = sum(bool(frame.poses) for frame in scene.frames)
    more = "; stopped, run it again to go on" if stopped else ""
    say(f"{posed} of {len(scene.frames)} frames have poses{more}")
    say(f"scene: {options.out / SEQUENCE}")
    return EXIT_INTERRUPTED if stopped else EXIT_MENDABLE if failed else 0


def _open(options: Namespace) -> Scene:
    from poseviewer.starts.loading import open_scene_files

    return open_scene_files(options.photo)
