"""Propagate poses from the keys of a sequence, a video or a folder of frames, to its other frames.
The same command continues a sequence that was stopped.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import calibration_of, load_named_sequence, mask_of
from poseviewer.cli.terminal import GOES_ON, progress_bar, say, take_all, tell, tell_of_compiling
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE, SettingsError, list_names

if TYPE_CHECKING:
    from poseviewer.scene.types import Scene

KEY = table.option(
    "--key N|N=POSE.json|FOLDER",
    "take --pose as that of the Nth frame, or POSE.json; repeat for more; or take all pose files "
    "of a folder, named as their frames (default: 1)",
    action="append",
)
MASKS = (
    table.MASK,
    table.MASK_LABEL,
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
        table.option("--paint", "paint the model from the keys, and search by what it shows then"),
        table.option(
            "--processes N",
            "run this number of processes (default: one a processor, as far as the memory reaches)",
        ),
        table.SCHEDULER,
        table.QUIET,
    ),
    **table.CAMERA,
}
EXAMPLES = (
    "poseviewer track clip.mp4 car.glb --pose key.json --out results",
    "poseviewer track scene.json --out results --paint",
)
STOPPED = GOES_ON


def run(options: Namespace) -> int:
    """Write the sequence with the propagated poses, and a table of its chains."""
    from poseviewer.batch import chains
    from poseviewer.batch.run import run_batch
    from poseviewer.files.photo import frame_bytes
    from poseviewer.processes import memory_bytes
    from poseviewer.render.pool import processors

    tell_of_compiling()
    scene = _open(options)
    hint = "" if options.paint else _note_of_bare(scene)
    for note in () if options.quiet else filter(None, (*_notes_of(scene), hint)):
        tell(f"note: {table.in_options(note, OPTIONS)}")
    start, batch = chains.open_chains(scene, options.out, options.paint)
    to_do = batch.to_do()
    if (done := len(batch.jobs) - len(to_do)) and not options.quiet:
        tell(f"{done} of {len(batch.jobs)} chains were done before.")
    camera = scene.views[0].camera
    in_memory = memory_bytes() / frame_bytes(camera.width, camera.height)
    processes = options.processes or int(max(1, min(processors(), len(to_do), in_memory)))
    threads = max(1, processors() // processes)
    job = partial(chains.run_chain, threads=threads, is_painted=options.paint)
    how = {"scheduler": options.scheduler, "processes": processes, "run": job}
    total = sum(chains.count_steps(start, job) for job in to_do)
    known = chains.count_known(batch, to_do)
    with progress_bar(total, options.quiet, known) as bar:

        def show() -> None:  # a chain that failed takes its last frames back
            bar.update(max(chains.count_known(batch, to_do) - bar.n, 0))

        stopped = take_all(run_batch(batch, to_do, **how, tick=show), show)
    scene, notes = chains.save_sequence(start, batch)
    for note in notes:
        say(note)
    failed = [row for row in batch.rows() if row.result.failed]
    for row in failed:
        say(f"chain from {row.job.photo} on: {row.result.reason}")
    posed = sum(bool(frame.poses) for frame in scene.frames)
    more = "; stopped, run it again to go on" if stopped else ""
    say(f"{posed} of {len(scene.frames)} frames have poses{more}")
    say(f"scene: {options.out / chains.SEQUENCE}")
    return EXIT_INTERRUPTED if stopped else EXIT_MENDABLE if failed else 0


def _notes_of(scene: Scene) -> tuple[str, ...]:
    """Return all notes on what was opened; one on a focal length that is assumed is the last."""
    view = scene.views[0]
    notes = (*scene.notes, *(note for item in scene.objects for note in item.notes))
    return tuple(dict.fromkeys(filter(None, (*notes, view.photo.focal_note(view.camera)))))


def _note_of_bare(scene: Scene) -> str:
    """Say which models have no colours, so that paint may help; "": each has some."""
    bare = dict.fromkeys(i.model.name for i in scene.objects if not i.mesh.has_reflectance)
    why = "painted from its key a thing with print is followed more exactly, a shiny one less"
    return f"{list_names([*bare])}: no colours; {why} (--paint)." if bare else ""


def _open(options: Namespace) -> Scene:
    """Open the sequence, with its keys."""
    from poseviewer.files.image_sequence import images_in, poses_named
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
    given = options.key or []
    if options.pose is None and all(isinstance(key, int) for key in given):
        found = "a key is wanted: give --pose, the pose in the first frame, or --key N=POSE.json"
        raise SettingsError(found)
    frames = load_named_sequence(options, images_in(path) if path.is_dir() else [path])
    of_pose = [key for key in given if isinstance(key, int)]
    if len(of_pose) > 1 or (of_pose and options.pose is None):
        raise SettingsError(f"--key {of_pose[-1]} without a pose of its own; give N=POSE.json")
    first, keys = (of_pose or [1])[0] - 1, dict[int, Path]()
    for key in given:
        if not isinstance(key, int):
            own = poses_named(frames, key) if isinstance(key, Path) else {key[0] - 1: key[1]}
            taken = {first, *keys} if options.pose is not None else set(keys)
            if twice := sorted(taken & set(own)):
                raise SettingsError(f"frame {twice[0] + 1} has two poses by --key; leave one out")
            keys |= own
    how = {"calibration": calibration_of(options), "key": first, "keys": keys}
    how |= {"mask": mask_of(options), "mask_all_frames": options.mask_all_frames}
    sources = Sources(frames=frames, model=options.model, start=options.pose, **how)
    return open_scene(sources)
