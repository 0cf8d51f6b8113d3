"""Propagate poses from the keys of a sequence, a video or a folder of frames, to its other frames.
The same command continues a sequence that was stopped.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import calibration_of, load_named_sequence
from poseviewer.cli.terminal import say, take_all, tell, tell_of_compiling
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE, SettingsError

if TYPE_CHECKING:
    from poseviewer.scene.types import Scene

KEY = table.option("--key N", "take --pose as that of the Nth frame (default: 1)")
MASKS = (
    table.MASK,
    table.option("--mask-all-frames", "apply the mask to all frames (default: to the key's alone)"),
)
OPTIONS = {
    "": (
        table.option(
            "photo VIDEO|FOLDER|SCENE.json",
            "video, folder of frames, or a saved sequence with keys, without MODEL",
        ),
        table.MODEL,
        table.option("--out FOLDER", "write scene and table here", required=True),
        table.POSE,
        KEY,
        *MASKS,
        *table.SEQUENCE,
        table.option("--processes N", "run this number of processes (default: one a processor)"),
        table.SCHEDULER,
        table.QUIET,
    ),
    **table.CAMERA,
}
EXAMPLES = (
    "poseviewer track clip.mp4 car.glb --pose key.json --out results",
    "poseviewer track scene.json --out results",
)


def run(options: Namespace) -> int:
    """Write the sequence with the propagated poses, and a table of its chains."""
    from poseviewer.batch.chains import SEQUENCE, open_chains, run_chain, save_sequence
    from poseviewer.batch.run import run_batch
    from poseviewer.render.pool import processors

    tell_of_compiling()
    scene = _open(options)
    for note in () if options.quiet else scene.notes:
        tell(f"note: {table.in_options(note, OPTIONS)}")
    start, batch = open_chains(scene, options.out)
    to_do = batch.to_do()
    if (done := len(batch.jobs) - len(to_do)) and not options.quiet:
        tell(f"{done} of {len(batch.jobs)} chains were done before.")
    processes = options.processes or min(processors(), max(len(to_do), 1))
    job = partial(run_chain, threads=max(1, processors() // processes))
    how = {"scheduler": options.scheduler, "processes": processes, "run": job}
    stopped = take_all(run_batch(batch, to_do, **how), len(to_do), options.quiet)
    scene, notes = save_sequence(start, batch)
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
    """Open the sequence, with its keys."""
    from poseviewer.files.image_sequence import images_in
    from poseviewer.files.scene_assets import check_frames
    from poseviewer.opening.scenes import open_scene
    from poseviewer.opening.sources import Sources

    path = options.photo
    if options.model is None:
        of_camera = table.CALIBRATION, *table.OF_CALIBRATION
        of_frames = (table.POSE, KEY, *MASKS, *table.SEQUENCE, *of_camera)
        table.refuse(
            options, of_frames, f"without MODEL; leave it out, or name {path.name}'s model"
        )
        scene = open_scene(Sources(scene=path))
        return replace(scene, notes=(*scene.notes, *check_frames(scene)))
    if options.pose is None:
        raise SettingsError("a key is wanted: give --pose, the pose in the first frame")
    frames = load_named_sequence(options, images_in(path) if path.is_dir() else [path])
    how = {"calibration": calibration_of(options), "key": (options.key or 1) - 1}
    how |= {"mask": options.mask, "mask_all_frames": options.mask_all_frames}
    sources = Sources(frames=frames, model=options.model, start=options.pose, **how)
    return open_scene(sources)
