"""A sequence as a batch: a row for each chain of frames from one key to the next.

All rows start from ``scene.json``; a row's result is a scene of its frames alone. In the end
``scene.json`` has the poses of all rows so far.
"""

import hashlib
import time
from collections import Counter
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from poseviewer.api import make_registration
from poseviewer.batch.job_table import KEY_LENGTH, Job, file_stamp
from poseviewer.batch.result_folder import (
    PICTURES,
    POSES,
    ROWS,
    TABLE,
    Batch,
    JobResult,
    load_result,
    save_failure,
    save_result,
    save_table,
)
from poseviewer.batch.run_row import result_files, shrink_picture
from poseviewer.errors import BatchError, PoseViewerError
from poseviewer.files.formats.sequence_export import sequence_table
from poseviewer.files.photo import save_image
from poseviewer.files.scene_json import as_saved, load_scene, save_scene, scene_contents
from poseviewer.files.writing import make_folder, require_replaceable, write_whole
from poseviewer.fit.propagation import FrameStep, find_chains
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.sequence import remove_propagated, require_keys, show_frame
from poseviewer.scene.types import Scene

SEQUENCE = "scene.json"
"""File of the sequence with all poses so far."""
POSE_TABLE = "poses.csv"
"""File of the table of poses, a row for each object in each frame."""
SAVE_S = 10.0
"""Time after which an unfinished row writes what it has, s: a stopped one loses no more."""


def open_chains(scene: Scene, folder: str | Path) -> tuple[Scene, Batch]:
    """Make the folder of results of a sequence, with a row for each chain; also return the sequence
    that its chains start from, without poses that are no keys.

    Raises:
        SettingsError: the scene is no sequence, or has no keys.
        BatchError: the folder cannot be used.
    """
    folder, jobs = Path(folder).resolve(), []
    last = len(scene.frames) - 1
    require_keys(scene, [item.id for item in scene.objects])
    chains = find_chains(scene, 0, last, range(len(scene.objects)))
    for item in scene.objects:
        scene = remove_propagated(scene, item.id, 0, last)
    for name in (ROWS, POSES, PICTURES):
        make_folder(folder / name, BatchError)
    for name in (SEQUENCE, POSE_TABLE, TABLE):
        require_replaceable(folder / name, BatchError)
    save_scene(folder / SEQUENCE, as_saved(scene))
    for row, (first, end) in enumerate(chains, 1):
        part = as_saved(_part(scene, (first, end)))
        contents = b"".join(scene_contents(folder / SEQUENCE, part).values())
        key = hashlib.sha256(contents).hexdigest()[:KEY_LENGTH]
        name = scene.frames[first].file.name
        jobs.append(Job(row, name, "", SEQUENCE, str(folder), key, frames=(first, end)))
    return scene, Batch(folder, tuple(jobs))


def _part(scene: Scene, ends: tuple[int, int]) -> Scene:
    """The frames of a chain alone; the first with poses is shown."""
    part = replace(scene, frames=scene.frames[ends[0] : ends[1] + 1])
    keyed = (index for index, frame in enumerate(part.frames) if frame.poses)
    return show_frame(part, next(keyed, 0))


@lru_cache(maxsize=1)
def _open_sequence(path: Path, _stamp: tuple[int, int]) -> Scene:
    """Open the sequence, which all chains share that a process runs."""
    return open_scene(Sources(scene=path))


def run_chain(job: Job, plan: Batch, threads: int = 1) -> JobResult:
    """Propagate poses through a chain and save them, unless that was done before.

    Raises:
        BatchError: the result cannot be saved.
    """
    known = load_result(plan.folder, job.key)
    if known is not None and not known.failed:
        return known
    pose_name, picture_name = result_files(job)
    began = saved = time.monotonic()

    def watch(scene: Scene, _: FrameStep) -> None:
        nonlocal saved
        if time.monotonic() - saved > SAVE_S:
            save_scene(plan.folder / pose_name, as_saved(scene))
            saved = time.monotonic()

    try:
        start = job.path(job.start)
        sequence = _open_sequence(start, file_stamp(start))
        chain = make_registration(_part(sequence, job.frames))
        end = chain.track(watch=watch, threads=threads)
        save_scene(plan.folder / pose_name, as_saved(end.scene))
        picture = shrink_picture(end.picture())
        save_image(plan.folder / picture_name, picture)
    except PoseViewerError as error:
        return save_failure(plan.folder, job, str(error))
    new = [note for note in end.notes if note not in chain.notes]
    poses = [pose for frame in end.scene.frames for pose in frame.poses.values()]
    verdicts = [p.result.verdict for p in poses if p.source == "propagated" and p.result]
    count = Counter(verdict.label for verdict in verdicts if verdict)
    worst = "doubtful" if count["doubtful"] else "found" if count["found"] else "lost"
    result = JobResult(
        f"{len(verdicts)} of {len(end.scene.frames)} frames have propagated poses.",
        seconds=round(time.monotonic() - began, 3),
        pose=pose_name,
        picture=picture_name,
        verdict=worst,
        reasons="\n".join(new),
    )
    return save_result(plan.folder, job, result)


def save_sequence(scene: Scene, batch: Batch) -> tuple[Scene, list[str]]:
    """Write a sequence of ``open_chains`` with the poses of all rows so far, and the tables of
    poses and of rows.

    Returns:
        The sequence, and notes on where poses end or jump.
    """
    rows, frames = batch.rows(), list(scene.frames)
    for job in batch.jobs:
        pose_name, _ = result_files(job)
        if (batch.folder / pose_name).exists():
            part = load_scene(batch.folder / pose_name)
            for index, frame in enumerate(part.frames, job.frames[0]):
                poses = {**frame.poses, **frames[index].poses}
                frames[index] = replace(frames[index], poses=poses)
    scene = show_frame(replace(scene, frames=tuple(frames)), scene.frame_index)
    save_scene(batch.folder / SEQUENCE, as_saved(scene))
    write_whole(batch.folder / POSE_TABLE, sequence_table(scene).encode(), BatchError)
    save_table(batch.folder, rows)
    notes = [line for row in rows for line in row.result.reasons.split("\n") if line]
    return scene, notes
