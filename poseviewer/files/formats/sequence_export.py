"""Exports of a sequence: a BOP scene, pose files, a table, an animation, and a video.

A frame in which an object has no pose is left out for that object; a note says how many are.
"""

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.formats import conversion as c
from poseviewer.files.formats.bop import (
    PHOTO_FOLDERS,
    camera_entry,
    pose_entry,
    save_scene_files,
    scene_text,
)
from poseviewer.files.formats.gltf_export import Track, write_gltf_scene
from poseviewer.files.formats.known_formats import write_own
from poseviewer.files.scene_assets import check_frames
from poseviewer.files.video_encoding import has_h264, save_video
from poseviewer.files.writing import make_folder, safe_path, write_whole
from poseviewer.scene.sequence import as_still, show_frame, stale_notes
from poseviewer.scene.types import Scene, SearchResult

SEQUENCE_FORMATS = {
    "poseviewer": "", "bop": "", "csv": ".csv", "gltf": ".glb",
    "video": ".mp4" if has_h264() else ".webm",
}  # fmt: skip
"""Formats of sequences, and the endings of their files; "": a folder."""
WITH_PHOTOS = ("bop", "video")
"""Formats that hold the frames' pictures beside the poses."""
POSE = ("qx", "qy", "qz", "qw", "tx", "ty", "tz")
"""Columns of a pose in tables."""
ASSUMED_RATE = 30.0
"""Frames a second where no time stamps are known."""


@dataclass(frozen=True, slots=True)
class SequencePictures:
    """Functions that draw the pictures of exports: this package has no renderers."""

    draw: Callable[[Scene], NDArray[np.uint8]]
    """Draws the objects over the photo of a frame: (height, width, 3), RGB."""
    masks: Callable[[Scene, int], Mapping[str, bytes]]
    """Makes masks and ``scene_gt_info.json`` of an image by its number, by the files' names."""


def export_sequence(
    kind: str, scene: Scene, out: Path, options: c.ConvertOptions, pictures: SequencePictures
) -> tuple[list[Path], list[str]]:
    """Write a sequence in one of ``SEQUENCE_FORMATS``; return what was written, and notes.

    Args:
        kind: name of the format.
        scene: the sequence; its models are read where the format shows them.
        out: file, or folder.
        options: units and numbers that the scene does not say.
        pictures: draws pictures.

    Raises:
        PoseFileError: no frame has a pose, or ``out`` is there and is not to be replaced.
        PoseViewerError: a photo or a model cannot be used, or ``out`` cannot be written.
    """
    total, notes = len(scene.frames), list[str]()
    for item in scene.objects:
        if without := sum(item.id not in frame.poses for frame in scene.frames):
            notes.append(f"{item.label}: {without} of {total} frames have no pose: left out.")
    notes += stale_notes(scene)
    if not any(frame.poses for frame in scene.frames):
        raise PoseFileError("No frame of the sequence has a pose; place the model in one.")
    is_there = out.exists() and not (out.is_dir() and not any(out.iterdir()))
    if is_there and not options.overwrite:
        wanted = "name another, or replace it with `overwrite`"
        raise PoseFileError(f"{out}: is there already and was not touched; {wanted}.")
    if kind in WITH_PHOTOS:
        notes += check_frames(scene)
    if not SEQUENCE_FORMATS[kind]:
        make_folder(out)
    if kind == "poseviewer":
        return _write_poses(scene, out), notes
    if kind == "bop":
        return _write_bop(scene, out, options, pictures), notes
    if kind == "csv":
        write_whole(out, sequence_table(scene).encode(), PoseFileError)
    elif kind == "gltf":
        write_whole(out, _animation(scene, out, options, notes), PoseFileError)
    else:
        steps = np.diff(_times(scene, notes))
        step = float(np.median(steps)) if np.any(steps > 0.0) else 0.0
        rate = 1.0 / step if step > 0.0 else ASSUMED_RATE
        drawn = (pictures.draw(shown) for _, shown in iterate_frames(scene))
        notes += filter(None, [save_video(out, drawn, rate)])
    return [out], notes


def iterate_frames(scene: Scene) -> Iterator[tuple[int, Scene]]:
    """Yield index and scene of each frame, with those objects alone that have a pose there."""
    for index, frame in enumerate(scene.frames):
        shown = as_still(show_frame(scene, index))
        objects = tuple(item for item in shown.objects if item.id in frame.poses)
        yield index, replace(shown, objects=objects)


def sequence_table(scene: Scene) -> str:
    """Return the poses as a table (CSV), a row for each object in each frame.

    Poses are camera from model: a quaternion and a translation in the model's unit, OpenCV axes;
    deviations are as in pose files.
    """
    rows = list[dict[str, Any]]()
    for index, shown in iterate_frames(scene):
        frame = scene.frames[index]
        for number, item in enumerate(shown.objects):
            known, pose = frame.poses[item.id], shown.pose(number).camera_from_model
            result = item.result or SearchResult()
            sure = result.covariance.deviations if result.covariance else {}
            turn = Rotation.from_matrix(pose.rotation).as_quat(canonical=True)
            numbers = [*turn.tolist(), *pose.translation.tolist()]
            rows.append({
                "frame": index, "file": frame.file.name, "time_s": frame.time_s,
                "object": item.id, "source": known.source, "stale": known.is_stale,
                "verdict": result.verdict and result.verdict.label,
                **dict(zip(POSE, numbers, strict=True)),
                **{f"deviation_{key}": own for key, own in sure.items()},
            })  # fmt: skip
    text, names = StringIO(), dict.fromkeys(name for row in rows for name in row)
    table = csv.DictWriter(text, names, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _write_poses(scene: Scene, out: Path) -> list[Path]:
    """Write ``PHOTO.pose.json``, of several objects ``PHOTO.OBJECT.pose.json``."""
    files = list[Path]()
    for _, shown in iterate_frames(scene):
        stem = shown.views[0].file.location.stem
        for item in shown.objects:
            name = stem if len(scene.objects) == 1 else f"{stem}.{safe_path(item.id).name}"
            alone = replace(shown, objects=(item,))
            for path, content in write_own(alone, out / f"{name}.pose.json").items():
                data = content if isinstance(content, bytes) else content.encode()
                write_whole(path, data, PoseFileError)
                files.append(path)
    return files


def _write_bop(
    scene: Scene, out: Path, options: c.ConvertOptions, pictures: SequencePictures
) -> list[Path]:
    """Write a whole BOP scene with its photos; an image has the number that its file's name is."""
    stems = [frame.file.location.stem for frame in scene.frames]
    is_numbered = all(map(str.isdecimal, stems)) and len(set(map(int, stems))) == len(stems)
    cameras, poses = dict[str, Any](), dict[str, Any]()
    infos, files = dict[str, Any](), list[Path]()
    posed = [frame for frame in iterate_frames(scene) if frame[1].objects]
    for index, _ in posed:
        whole, known = show_frame(scene, index), scene.frames[index].poses
        number = f"{int(stems[index]) if is_numbered else index}"
        cameras[number] = camera_entry(whole.views[0].camera)
        poses[number] = [
            pose_entry(whole, i, 0, options)
            for i, item in enumerate(whole.objects)
            if item.id in known
        ]
    make_folder(out / PHOTO_FOLDERS[1])
    for number, (_, shown) in zip(map(int, poses), posed, strict=True):
        files.append(c.copy_photo(shown.views[0], out / PHOTO_FOLDERS[1] / f"{number:06d}"))
        for name, data in pictures.masks(shown, number).items():
            if name.endswith(".json"):
                infos.setdefault(name, {}).update(json.loads(data))
                continue
            make_folder((out / name).parent)
            write_whole(out / name, data, PoseFileError)
    save_scene_files(out, cameras, poses)
    for name, content in infos.items():
        write_whole(out / name, scene_text(content).encode(), PoseFileError)
    return [*files, *(out / name for name in infos)]


def _animation(scene: Scene, out: Path, options: c.ConvertOptions, notes: list[str]) -> bytes:
    """Return a GLB file whose camera stands still, and whose objects move."""
    times, tracks = _times(scene, notes), dict[str, Track]()
    first = dict[str, Any]()
    for index, shown in iterate_frames(scene):
        for item, place in zip(shown.objects, c.places_by_camera(shown), strict=True):
            first.setdefault(item.id, item)
            track = tracks.setdefault(item.id, Track([], []))
            track.times_s.append(times[index])
            track.places.append(place)
    objects = tuple(first[item.id] for item in scene.objects if item.id in first)
    ordered = [tracks[item.id] for item in objects]
    still = replace(scene, objects=objects, frames=(), frame_index=0)
    return write_gltf_scene(still, out, options, notes, ordered)[out]


def _times(scene: Scene, notes: list[str]) -> list[float]:
    """Time stamps of all frames, s, assumed with a note where one is not known."""
    known = [frame.time_s for frame in scene.frames if frame.time_s is not None]
    if len(known) == len(scene.frames):
        return known
    notes.append(f"No time stamps are known: {ASSUMED_RATE:g} frames a second are assumed.")
    return [index / ASSUMED_RATE for index in range(len(scene.frames))]
