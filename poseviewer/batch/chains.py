"""A sequence as a batch: a row for each chain of frames from one key to the next.

All rows start from ``scene.json``; each appends the poses that it finds, frame by frame, to a file
of its own. In the end ``scene.json`` has the poses of all rows so far.
"""

import hashlib
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from itertools import takewhile
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
from poseviewer.errors import BatchError, PoseViewerError, list_names
from poseviewer.files.checks import is_there
from poseviewer.files.formats.sequence_export import sequence_table
from poseviewer.files.frame_steps import append_step, load_steps, save_steps
from poseviewer.files.photo import save_image
from poseviewer.files.scene_json import as_saved, load_scene, save_scene, scene_contents
from poseviewer.files.writing import make_folder, require_replaceable, write_whole
from poseviewer.fit.painting import paint_object
from poseviewer.fit.propagation import chain_steps, find_chains
from poseviewer.geometry.painted_model import Painting
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.sequence import (
    FrameStep,
    remove_propagated,
    require_keys,
    show_frame,
    store_poses,
)
from poseviewer.scene.types import Frame, FramePose, Scene

SEQUENCE = "scene.json"
"""File of the sequence with all poses so far."""
POSE_TABLE = "poses.csv"
"""File of the table of poses, a row for each object in each frame."""
MAX_NAMED = 5


def open_chains(scene: Scene, folder: str | Path, is_painted: bool = False) -> tuple[Scene, Batch]:
    """Make the folder of results of a sequence, with a row for each chain; also return the sequence
    that its chains start from, without poses that are no keys.

    Args:
        scene: the sequence.
        folder: folder of the results.
        is_painted: whether chains are run with models painted from the keys.

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
        key = hashlib.sha256(contents + b"painted" * is_painted).hexdigest()[:KEY_LENGTH]
        name = scene.frames[first].file.name
        jobs.append(Job(row, name, "", SEQUENCE, str(folder), key, frames=(first, end)))
    return scene, Batch(folder, tuple(jobs))


def _part(scene: Scene, ends: tuple[int, int]) -> Scene:
    """The frames of a chain alone; the first with poses is shown."""
    part = replace(scene, frames=scene.frames[ends[0] : ends[1] + 1])
    keyed = (i for i, frame in enumerate(part.frames) if frame.poses and not _has_vanished(frame))
    return show_frame(part, next(keyed, 0))


def _has_vanished(frame: Frame) -> bool:
    return not is_there(frame.file.location)


def count_steps(scene: Scene, job: Job) -> int:
    """Return how many steps a chain takes if no object is lost."""
    free = [index for index, item in enumerate(scene.objects) if not item.locked]
    return len(chain_steps(scene, job.frames, free))


def count_known(batch: Batch, jobs: Iterable[Job]) -> int:
    """Return how many steps of chains are in the folder so far."""
    files = [batch.folder / steps_file(job) for job in jobs]
    return sum(file.read_bytes().count(b"\n") for file in files if is_there(file))


def steps_file(job: Job) -> str:
    """Return the path of a chain's poses by frame, relative to the folder of results."""
    return f"{result_files(job)[0]}l"


@lru_cache(maxsize=1)
def _open_sequence(path: Path, _stamp: tuple[int, int]) -> Scene:
    """Open the sequence, which all chains share that a process runs; photos of frames may have
    vanished.
    """
    scene = load_scene(path, photos_may_miss=True)
    there = (index for index, frame in enumerate(scene.frames) if not _has_vanished(frame))
    return open_scene(Sources(scene=show_frame(scene, next(there, 0))))


@lru_cache(maxsize=1)
def _paintings(path: Path, stamp: tuple[int, int]) -> tuple[Painting, ...]:
    """Paint the models from all keys of the sequence, for all chains that a process runs."""
    scene = _open_sequence(path, stamp)
    return tuple(paint_object(scene, index) for index in range(len(scene.objects)))


def run_chain(job: Job, plan: Batch, threads: int = 1, is_painted: bool = False) -> JobResult:
    """Propagate poses through a chain, unless that was done before, and save those of each frame
    as they are found: a chain that was stopped goes on after the last.

    Args:
        job: the chain.
        plan: batch of the chains.
        threads: number of threads.
        is_painted: whether the models are painted from the keys of the whole sequence.

    Raises:
        BatchError: the result cannot be saved.
    """
    known = load_result(plan.folder, job.key)
    if known is not None and not known.failed:
        return known
    began, start = time.monotonic(), job.path(job.start)
    steps_name, (_, picture_name) = steps_file(job), result_files(job)
    path = plan.folder / steps_name
    try:
        stamp = file_stamp(start)
        scene = _part(_open_sequence(start, stamp), job.frames)
        for index, painting in enumerate(_paintings(start, stamp) if is_painted else ()):
            scene = scene.with_object(index, painting=painting)
        steps = load_steps(path, scene)
        if known is not None:  # it failed: where a track ended, it is tried again
            steps = [*takewhile(lambda step: not step.note, steps)]
        save_steps(path, steps)
        chain = make_registration(scene)
        for step in chain.propagate(threads=threads, known=steps):
            append_step(path, step)
            steps.append(step)
        end = make_registration(store_poses(scene, _poses_by_frame(steps)))
        save_image(plan.folder / picture_name, shrink_picture(end.picture()))
        _require_frames(scene)
    except PoseViewerError as error:
        return save_failure(plan.folder, job, str(error))
    found = _poses_by_frame(steps)
    poses = [pose for frame in found.values() for pose in frame.values()]
    verdicts = [pose.result.verdict for pose in poses if pose.result]
    count = Counter(verdict.label for verdict in verdicts if verdict)
    worst = "doubtful" if count["doubtful"] else "found" if count["found"] else "lost"
    posed = sum(map(bool, found.values()))
    result = JobResult(
        f"{posed} of {len(scene.frames)} frames have propagated poses.",
        seconds=round(time.monotonic() - began, 3),
        pose=steps_name,
        picture=picture_name,
        verdict=worst,
        reasons="\n".join(dict.fromkeys(step.note for step in steps if step.note)),
    )
    return save_result(plan.folder, job, result)


def _poses_by_frame(steps: Iterable[FrameStep], first: int = 0) -> dict[int, dict[str, FramePose]]:
    """Return the last poses of each frame, by frame and object; ``first`` is the index of the
    chain's first frame.
    """
    found = defaultdict[int, dict[str, FramePose]](dict)
    for step in steps:
        found[first + step.frame_index] |= step.poses
    return found


def _require_frames(scene: Scene) -> None:
    if gone := [frame.file.name for frame in scene.frames if _has_vanished(frame)]:
        found = f"{list_names(gone, MAX_NAMED)}: no longer there"
        raise BatchError(f"{found}; put it back, and run the same again to go on.")


def save_sequence(scene: Scene, batch: Batch) -> tuple[Scene, list[str]]:
    """Write a sequence of ``open_chains`` with the poses of all rows so far, and the tables of
    poses and of rows. Frames that have vanished since are not in the scene, which could not be
    opened with them.

    Returns:
        The sequence, and notes on where poses end or jump.
    """
    rows, found = batch.rows(), dict[int, dict[str, FramePose]]()
    for job in batch.jobs:
        steps = load_steps(batch.folder / steps_file(job), _part(scene, job.frames))
        found |= _poses_by_frame(steps, job.frames[0])
    scene = store_poses(scene, found)
    write_whole(batch.folder / POSE_TABLE, sequence_table(scene).encode(), BatchError)
    save_table(batch.folder, rows)
    notes = [line for row in rows for line in row.result.reasons.split("\n") if line]
    there = [index for index, frame in enumerate(scene.frames) if not _has_vanished(frame)]
    if 0 < len(there) < len(scene.frames):
        count = len(scene.frames) - len(there)
        are = "1 frame is" if count == 1 else f"{count} frames are"
        notes.append(f"{are} no longer there, and not in {SEQUENCE}.")
        shown = there.index(scene.frame_index) if scene.frame_index in there else 0
        left = replace(scene, frames=tuple(scene.frames[i] for i in there), frame_index=0)
        scene = show_frame(left, shown)
    save_scene(batch.folder / SEQUENCE, as_saved(scene))
    return scene, notes
