"""Poses by frame, as a propagation finds them: a line of JSON for each step, appended as it comes.

A process that is killed loses the frame that it was at; the same propagation goes on from there.
"""

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from poseviewer.errors import PoseFileError, PoseViewerError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile
from poseviewer.files.scene_json import form_of, result_in_view
from poseviewer.files.writing import append, json_bytes, write_whole, writing_to
from poseviewer.scene.sequence import FrameStep
from poseviewer.scene.types import Scene


def load_steps(path: Path, scene: Scene) -> list[FrameStep]:
    """Load steps of a sequence, up to the first line that is not whole; none without a file."""
    file, steps = InputFile(path, kind="file of poses", largest=MAX_DATA_BYTES), list[FrameStep]()
    with suppress(PoseViewerError, ValueError, RecursionError):
        for line in file.load_bytes().splitlines():
            steps.append(_step_of(file, line, scene))
    return steps


def _step_of(file: InputFile, line: bytes, scene: Scene) -> FrameStep:
    form = form_of(FrameStep)
    step: FrameStep = form.decode(file.decode(json.loads(line), form.kind))
    if not 0 <= step.frame_index < len(scene.frames):
        raise file.error(f"frame_index is {step.frame_index}", "wanted that of a frame")
    for object_id in step.poses:
        scene.index(object_id)  # raises for one that is not there
    results = {name: result_in_view(scene, pose) for name, pose in step.poses.items()}
    poses = {name: replace(pose, result=results[name]) for name, pose in step.poses.items()}
    return replace(step, poses=poses)


def save_steps(path: Path, steps: Iterable[FrameStep]) -> None:
    """Write steps in place of those that are there.

    Raises:
        PoseFileError: the file cannot be written.
    """
    write_whole(path, b"".join(_line_of(path, step) for step in steps), PoseFileError)


def append_step(path: Path, step: FrameStep) -> None:
    """Add a step.

    Raises:
        PoseFileError: the file cannot be written.
    """
    line = _line_of(path, step)
    with writing_to(path.parent, path.name, PoseFileError):
        append(path, line)


def _line_of(path: Path, step: FrameStep) -> bytes:
    return json_bytes(path, form_of(FrameStep).encode(step), PoseFileError, indent=None)
