"""BOP: a pose appended to a scene's ``scene_gt.json`` and ``scene_camera.json``.

As published in the BOP toolkit's ``docs/bop_datasets_format.md``: translations in mm, rotations and
K row-major, OpenCV axes, pixel centres at integers. Masks, boxes and ``scene_gt_info.json`` are
the toolkit's to make, from these.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.matrix import camera_from_intrinsics, intrinsics_matrix
from poseviewer.files.formats.request import (
    Request,
    Written,
    make_folder,
    make_record,
    metres_per_unit,
    refuse_lens,
    require_perspective,
    size_of,
    unit_of,
)
from poseviewer.files.pose.checks import Reading, checked_rotation, read_json
from poseviewer.files.pose.file import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.transform import RigidTransform

UNIT = "mm"
LARGEST_SCENE = 1_000_000_000
"""Bytes: thousands of images of dozens of objects."""
PHOTO_NAME, MODEL_NAME = r"(\d+)\.\w+", r"obj_(\d+)\.\w+"

SceneFile = dict[str, Any]


def write_bop(record: PoseRecord, out: Path, request: Request) -> Written:
    """Append a pose to the scene folder ``out``; what is there stays, nothing is said twice.

    Raises:
        PoseFileError: parallel projection; the unit, image or object is not known; the image is
            there with another camera; the folder cannot be written to.
    """
    refuse_lens(record, "BOP")
    camera = camera_as_integer_centres(require_perspective(record, "BOP"))
    assert isinstance(camera, Perspective)
    image = str(_image_id(record, request))
    entry = _entry(record, request)
    matrix = intrinsics_matrix(camera).reshape(-1).tolist()
    folder_files = out / "scene_camera.json", out / "scene_gt.json"
    cameras, poses = (load_scene_file(path) for path in folder_files)
    there = cameras.setdefault(image, {"cam_K": matrix, "depth_scale": 1.0})
    if not _alike(Reading(folder_files[0].name, []), there, image, matrix):
        raise PoseFileError(
            f"{folder_files[0]}: image {image} is there with another camera; give the pose another "
            "image with --image NUMBER, or convert it with that camera."
        )
    of_image = poses.setdefault(image, [])
    if not isinstance(of_image, list):
        raise PoseFileError(
            f"{folder_files[1]}: image {image} is not a list; is it a scene of BOP's?"
        )
    if entry in of_image:
        return Written(folder_files, (f"Image {image} had this very pose already.",))
    of_image.append(entry)
    make_folder(out)
    for path, content in zip(folder_files, (cameras, poses), strict=True):
        write_whole(path, scene_text(content).encode(), PoseFileError)
    return Written(folder_files)


def read_bop(path: Path, request: Request) -> PoseRecord:
    """Read one pose of a scene folder: of image ``request.image`` and object ``object_id``.

    Either may be left out where there is but one. Lengths are in mm unless ``unit`` says else.

    Raises:
        PoseFileError: there is no such pose, or more than one.
    """
    files = path / "scene_camera.json", path / "scene_gt.json"
    for file in files:
        if not file.is_file():
            raise PoseFileError(f"{file}: no such file; name a BOP scene's folder.")
    cameras, poses = (load_scene_file(file) for file in files)
    image = _chosen_image(files[1], poses, request)
    reading = Reading(files[0].name, [])
    entry = reading.object(cameras.get(image), f"image {image}")
    width, height = size_of(reading, request)
    matrix = np.array(reading.numbers(entry.get("cam_K"), f"{image}.cam_K", 9)).reshape(3, 3)
    camera = camera_from_intrinsics(reading, matrix, width, height)
    place = _place(Reading(files[1].name, reading.warnings), poses[image], image, request)
    unit = request.unit or UNIT
    return make_record(reading, Pose(camera_from_integer_centres(camera), place), None, unit)


def _entry(record: PoseRecord, request: Request) -> dict[str, Any]:
    unit = unit_of(record, request)
    if unit is None:
        raise PoseFileError(
            "The pose file does not say the model's unit, and BOP wants mm; add --unit, such as "
            "--unit mm."
        )
    transform = record.pose.camera_from_model
    millimetres = transform.translation * (metres_per_unit(unit) / metres_per_unit(UNIT))
    return entry_of(_object_id(record, request), RigidTransform(transform.rotation, millimetres))


def entry_of(object_id: int, camera_from_model: RigidTransform) -> dict[str, Any]:
    """A pose as ``scene_gt.json`` has it; lengths in mm."""
    return {
        "cam_R_m2c": camera_from_model.rotation.reshape(-1).tolist(),
        "cam_t_m2c": camera_from_model.translation.tolist(),
        "obj_id": object_id,
    }


def _image_id(record: PoseRecord, request: Request) -> int:
    name = record.photo.file if record.photo else None
    return _number(request.image, PHOTO_NAME, name, "image", "000003.png")


def _object_id(record: PoseRecord, request: Request) -> int:
    if request.object_id is not None:
        return request.object_id
    name = record.model.file if record.model else None
    return _number(None, MODEL_NAME, name, "object", "obj_000005.ply")


def _number(given: str | None, pattern: str, name: str | None, what: str, example: str) -> int:
    said = name if given is None else given
    found = re.fullmatch(pattern, said or "")
    text = found[1] if found else given or ""
    if not text.isdecimal():
        raise PoseFileError(
            f"BOP wants the {what}'s number, and found {said or 'none'!r}; add "
            f"--{what} NUMBER (a file called like {example} says it by its name)."
        )
    return int(text)


def load_scene_file(path: Path) -> SceneFile:
    """What a scene's file holds by image; nothing where it is not there yet.

    Raises:
        PoseFileError: it is damaged.
    """
    if not path.exists():
        return {}
    reading = Reading(path.name, [])
    return reading.object(read_json(path, LARGEST_SCENE), "its content")


def _alike(reading: Reading, there: Any, image: str, matrix: list[float]) -> bool:
    """Whether the camera that an image has is this one."""
    entry = reading.object(there, f"image {image}")
    numbers = reading.numbers(entry.get("cam_K"), f"{image}.cam_K", 9)
    return np.allclose(numbers, matrix, rtol=1e-9, atol=1e-9)


def scene_text(content: SceneFile) -> str:
    """One image a line, in order, as the toolkit writes it."""
    lines = (
        f"  {json.dumps(image)}: {json.dumps(content[image])}"
        for image in sorted(content, key=lambda name: (len(name), name))
    )
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _chosen_image(path: Path, poses: SceneFile, request: Request) -> str:
    by_number = {str(int(name)): name for name in poses if name.isdecimal()}
    if request.image is None and len(poses) == 1:
        return next(iter(poses))
    wanted = request.image or ""
    name = by_number.get(str(int(wanted)) if wanted.isdecimal() else "")
    if name is None:
        raise PoseFileError(
            f"{path}: it has {len(poses)} images, none of them {wanted or 'chosen'!r}; "
            "choose one with --image NUMBER."
        )
    return name


def _place(reading: Reading, entries: Any, image: str, request: Request) -> RigidTransform:
    of_object = [
        reading.object(entry, f"image {image}")
        for entry in (entries if isinstance(entries, list) else [])
    ]
    wanted = request.object_id
    if wanted is not None:
        of_object = [entry for entry in of_object if entry.get("obj_id") == wanted]
    if len(of_object) != 1:
        raise reading.error(
            f"image {image} has {len(of_object)} poses"
            + (f" of object {wanted}" if wanted else ""),
            "wanted one, choose it with --object NUMBER",
        )
    scale = metres_per_unit(UNIT) / metres_per_unit(request.unit or UNIT)
    return transform_of(reading, of_object[0], scale)


def transform_of(reading: Reading, entry: dict[str, Any], scale: float) -> RigidTransform:
    """Camera from model of a pose in ``scene_gt.json``; its mm times ``scale``.

    Raises:
        PoseFileError: it is no pose.
    """
    numbers = reading.numbers(entry.get("cam_R_m2c"), "cam_R_m2c", 9)
    rotation = checked_rotation(reading, np.array(numbers).reshape(3, 3))
    millimetres = np.array(reading.numbers(entry.get("cam_t_m2c"), "cam_t_m2c", 3))
    return RigidTransform(rotation, millimetres * scale)
