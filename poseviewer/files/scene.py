"""Scene files: JSON that says which models are where in one photo (``scene.schema.json``).

Photo and camera are said once, in a pose file's words; each object has an id, a model, a pose, and
may have a mask. A pose is that of a pose file beside the scene, or stands in the scene itself in
the same words, without camera and photo. Paths start from the scene's folder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PhotoFileError, PoseFileError
from poseviewer.files.checks import VERSION, Reading, is_there, kind_of, read_json
from poseviewer.files.masks import mask_as_png
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import same_undistortion
from poseviewer.files.pose import (
    ModelReference,
    PhotoReference,
    PoseRecord,
    load_pose,
    record_as_json,
    record_from_json,
)
from poseviewer.files.writing import write_json, write_whole
from poseviewer.geometry.camera import Camera, Parallel
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.mask import Mask

FORMAT = "poseviewer-scene"
KIND = "scene file"
ENDING = ".scene.json"
OF_SCENE = ("projection", "camera", "distortion", "photo")
"""What a scene says once for the poses of all its objects."""
OF_POSE = (
    *("camera_from_model", "without", "chart", "loss", "unexplained", "seen", "verdict", "notes"),
    *("uncertainty", "settings"),
)
"""What is written of each object's own."""
NOWHERE = {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.0]}
SAME = 1e-9
"""Relative: files round cameras in their last digit."""


@dataclass(frozen=True, slots=True)
class ObjectRecord:
    """A model in a scene."""

    id: str
    """Of this object alone; the same model may be there several times."""
    model: Path
    record: PoseRecord
    """Its pose, by the scene's camera, and what else a pose file says of it."""
    name: str = ""
    """For people."""
    mask: Path | None = None
    """A picture of the photo's size: black hides what stands in front of this object."""

    @property
    def label(self) -> str:
        """What it is called: its name, or else its id."""
        return self.name or self.id


@dataclass(frozen=True, slots=True)
class SceneRecord:
    """All that a scene file says."""

    photo: Path
    photo_reference: PhotoReference
    """The photo's size, which has to be known, and its fingerprint."""
    camera: Camera
    objects: tuple[ObjectRecord, ...]
    """One or more, each with an id of its own."""
    undistortion: Undistortion | None = None
    """Where the camera is that of the undistorted photo: how that is made of the one as taken."""
    warnings: tuple[str, ...] = ()
    """What the user should know about how the file was read; not written."""

    def with_records(self, records: Sequence[PoseRecord]) -> SceneRecord:
        """The scene with other poses of its objects, in their order."""
        pairs = zip(self.objects, records, strict=True)
        return replace(self, objects=tuple(replace(one, record=new) for one, new in pairs))

    def index(self, object_id: str) -> int:
        """Which object has an id.

        Raises:
            PoseFileError: none has.
        """
        ids = [one.id for one in self.objects]
        if object_id not in ids:
            raise PoseFileError(
                f"There is no object {object_id!r} in the scene; there are {', '.join(ids)}."
            )
        return ids.index(object_id)


def is_scene(data: Any) -> bool:
    """Whether a file's JSON says that it is a scene."""
    return isinstance(data, dict) and data.get("format") == FORMAT


def is_scene_file(path: Path) -> bool:
    """Whether a file is JSON that says that it is a scene, or is called ``.scene.json``: then what
    is wrong with it can be told. What it is otherwise is not asked.
    """
    if path.name.lower().endswith(ENDING):
        return True
    try:
        return is_scene(read_json(path))
    except PoseFileError:
        return False


def load_scene(path: str | Path) -> SceneRecord:
    """The scene in a file; its photo, models and masks are there, but not yet read.

    Raises:
        PoseFileError: there is no such file, it does not hold a scene, or names a file that is not
            there; two objects have one id; a pose file is by another camera.
    """
    reading = Reading(Path(path), kind=KIND)
    with reading.naming_errors():
        return _scene_in(reading)


def _scene_in(reading: Reading) -> SceneRecord:
    data = reading.load_object()
    if not is_scene(data):
        raise reading.error(f"format is {kind_of(data.get('format'))}", f"wanted {FORMAT!r}")
    reading.require_format(data, FORMAT)
    sizes = reading.fields(data.get("photo"), "photo", width=Reading.size, height=Reading.size)
    if None in sizes:
        raise reading.error("photo.width or photo.height is missing", "wanted the photo's size, px")
    entries = data.get("objects")
    if not isinstance(entries, list) or not entries:
        raise reading.error(f"objects is {kind_of(entries)}", "wanted a list of one or more")
    photo = _file(reading, data["photo"].get("file"), "photo.file")
    shared = {key: data[key] for key in OF_SCENE if data.get(key) is not None}
    # The scene's own part is that of a pose file whose pose is to come.
    whole = record_from_json(reading, {**shared, "camera_from_model": NOWHERE}, *sizes)
    objects = tuple(
        _object(reading, entry, f"objects[{number}]", shared, whole)
        for number, entry in enumerate(entries)
    )
    _require_own_ids(reading, objects)
    return SceneRecord(
        photo,
        whole.photo or PhotoReference(),
        whole.pose.camera,
        objects,
        whole.undistortion,
        tuple(dict.fromkeys(reading.warnings)),
    )


def save_scene(
    path: str | Path, scene: SceneRecord, masks: Mapping[str, Mask] | None = None
) -> None:
    """Write a scene file, whole or not at all, with the poses of its objects in it. ``masks``, by
    the ids of objects, are written beside it, in place of those that they had.

    Raises:
        PoseViewerError: two objects have one id; an object's pose is by another camera than the
            scene's; the folder is missing or cannot be written to; a number is not finite.
    """
    path = Path(path)
    reading = Reading(path, kind=KIND)
    _require_own_ids(reading, scene.objects)
    for one in scene.objects:
        _require_camera(reading, one.id, one.record, scene.camera, scene.undistortion)
    objects = []
    for number, one in enumerate(scene.objects, 1):
        if masks and one.id in masks:
            beside = path.with_name(f"{path.stem}.{number}.mask.png")
            write_whole(beside, mask_as_png(masks[one.id]), PhotoFileError)
            one = replace(one, mask=beside)
        objects.append(_object_as_json(path, one, scene.camera))
    reference = replace(scene.photo_reference, file=_relative(path, scene.photo))
    first = scene.objects[0].record
    of_scene = replace(first.pose, camera=scene.camera)
    first = replace(first, pose=of_scene, photo=reference, undistortion=scene.undistortion)
    shared = record_as_json(first)
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        **{key: shared[key] for key in OF_SCENE if key in shared},
        "objects": objects,
    }
    write_json(path, data, PoseFileError)


def _object_as_json(path: Path, one: ObjectRecord, camera: Camera) -> dict[str, Any]:
    record = record_as_json(one.record)
    data: dict[str, Any] = {"id": one.id}
    if one.name:
        data["name"] = one.name
    data["model"] = {**record.get("model", {}), "file": _relative(path, one.model)}
    data["pose"] = {key: record[key] for key in OF_POSE if key in record}
    if one.record.pose.camera != camera and isinstance(camera, Parallel):
        data["pose"]["scale"] = record["camera"]["scale"]
    if one.mask is not None:
        data["mask"] = _relative(path, one.mask)
    return data


def _object(
    reading: Reading, entry: Any, what: str, shared: dict[str, Any], whole: PoseRecord
) -> ObjectRecord:
    """An object of a scene; ``shared`` is what that says of all, as it is and as it was read."""
    name, model, mask = reading.fields(
        entry, what, name=Reading.text, model=Reading.object, mask=Reading.text
    )
    object_id, pose = entry.get("id"), entry.get("pose")
    if not isinstance(object_id, str) or not object_id:
        raise reading.error(f"{what}.id is {kind_of(object_id)}", "wanted a text")
    # Errors in what the scene says of the object name it.
    own = replace(reading, path=Path(f"{reading.path.name}, {what}"))
    size = whole.pose.camera.width, whole.pose.camera.height
    if isinstance(pose, str):
        path = _file(reading, pose, f"{what}.pose")
        record = load_pose(path, *size)
        reading.warnings.extend(record.warnings)
        beside = None if record.mask is None else path.with_name(bare_name(record.mask))
        mask = mask or (None if beside is None else os.path.relpath(beside, reading.path.parent))
    else:
        said = {**own.object(pose, "pose"), **shared}
        if isinstance(whole.pose.camera, Parallel) and "scale" in said:
            said["camera"] = {**shared["camera"], "scale": said["scale"]}
        record = record_from_json(own, said, *size)
    _require_camera(reading, object_id, record, whole.pose.camera, whole.undistortion)
    file = _file(reading, model.get("file"), f"{what}.model.file")
    mask = None if mask is None else _file(reading, mask, f"{what}.mask")
    known = ModelReference(file.name, *reading.fields(
        model, f"{what}.model", sha256=Reading.text, unit=Reading.text
    ))  # fmt: skip
    record = replace(record, photo=whole.photo, model=known, mask=None, warnings=())
    return ObjectRecord(object_id, file, record, name or "", mask)


def _require_own_ids(reading: Reading, objects: Sequence[ObjectRecord]) -> None:
    ids = [one.id for one in objects]
    for number, one in enumerate(ids):
        if one in ids[:number]:
            raise reading.error(f"two objects have the id {one!r}", "give each an id of its own")


def _require_camera(
    reading: Reading,
    object_id: str,
    record: PoseRecord,
    camera: Camera,
    undistortion: Undistortion | None,
) -> None:
    own = record.pose.camera
    if isinstance(own, Parallel) and isinstance(camera, Parallel):
        own = replace(own, scale=camera.scale)  # each is as large as the photo has it
    is_same = type(own) is type(camera) and np.allclose(astuple(own), astuple(camera), rtol=SAME)
    if not is_same or not same_undistortion(record.undistortion, undistortion):
        raise reading.error(
            f"the pose of object {object_id!r} is by another camera than the scene's",
            "one photo has one camera, fit the object again with that of the scene",
        )


def _file(reading: Reading, name: Any, what: str) -> Path:
    """A file that the scene names, from its folder."""
    if not isinstance(name, str) or not name:
        raise reading.error(f"{what} is {kind_of(name)}", "wanted the name of a file")
    path = reading.path.parent / name
    if not is_there(path):
        raise reading.error(
            f"{what} is {name}, and there is no such file",
            "put it there, seen from the scene's folder; on a page, drop that folder as a whole",
        )
    return path


def _relative(path: Path, file: Path) -> str:
    """A file as the scene at ``path`` names it: from the scene's folder, if there is a way."""
    try:
        return Path(os.path.relpath(file.resolve(), path.resolve().parent)).as_posix()
    except ValueError:  # on another drive
        return str(file.resolve())
