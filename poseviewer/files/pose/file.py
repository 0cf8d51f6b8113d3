"""Pose files: JSON that says where the model is and which camera sees it (``pose.schema.json``).

In files, pixel centres are at integers, as in OpenCV; inside at i + 0.5 (``geometry.frames``).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.camera.distortion_block import distortion_as_json, distortion_from_json
from poseviewer.files.pose.checks import Reading, checked_rotation, kind_of, read_json
from poseviewer.files.pose.verdict import (
    RecordedVerdict,
    verdict_as_json,
    verdict_from_json,
)
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.transform import RigidTransform

FORMAT, VERSION = "poseviewer-pose", 1


@dataclass(frozen=True, slots=True)
class PhotoReference:
    """The photo that a pose was found on."""

    file: str | None = None
    width: int | None = None
    height: int | None = None
    sha256: str | None = None


@dataclass(frozen=True, slots=True)
class ModelReference:
    """The model that a pose places."""

    file: str | None = None
    sha256: str | None = None
    unit: str | None = None


@dataclass(frozen=True, slots=True)
class ChartParameters:
    """The pose as the numbers of a chart."""

    name: str
    names: tuple[str, ...]
    parameters: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """All that a pose file says."""

    pose: Pose
    """Camera (pixel centres at i + 0.5) and ``camera_from_model``, in the model's unit."""
    photo: PhotoReference | None = None
    model: ModelReference | None = None
    chart: ChartParameters | None = None
    loss: float | None = None
    settings: Mapping[str, Any] | None = None
    software: Mapping[str, str] | None = None
    undistortion: Undistortion | None = None
    """Where the pose belongs to the undistorted photo: how that is made of the one as taken."""
    verdict: RecordedVerdict | None = None
    """What the fit thought of the pose."""
    warnings: tuple[str, ...] = field(default=(), compare=False)
    """What the user should know about how the file was read; not written."""


def pose_schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of pose files."""
    text = files("poseviewer.files.pose").joinpath("pose.schema.json").read_text(encoding="utf-8")
    return json.loads(text)


def load_pose(path: str | Path, width: int, height: int) -> PoseRecord:
    """The pose in a file, for a photo of ``width`` x ``height`` px.

    Only ``projection``, ``camera`` and ``camera_from_model`` are needed; unknown fields are
    ignored. A rotation off by rounding is made exact; below 1 degree, with a warning.

    Raises:
        PoseFileError: there is no such file, or it does not hold a pose.
    """
    path = Path(path)
    reading = Reading(path.name, [])
    return record_from_json(reading, read_json(path), width, height)


def record_from_json(reading: Reading, data: Any, width: int, height: int) -> PoseRecord:
    """What a pose file's JSON says, for a photo of ``width`` x ``height`` px.

    Raises:
        PoseFileError: it does not hold a pose.
    """
    data = reading.object(data, "its content")
    if data.get("format", FORMAT) != FORMAT:
        raise reading.error(f"format is {data['format']!r}", f"wanted {FORMAT!r}")
    version = data.get("version", VERSION)
    if version is True or version != VERSION:
        raise reading.error(
            f"version is {version!r}", f"this poseviewer reads version {VERSION}, try a newer one"
        )
    pose = Pose(camera_from_json(reading, data, width, height), _transform(reading, data))
    photo = _photo(reading, data.get("photo"))
    if photo is not None:
        _warn_of_size(reading, photo, width, height)
    return PoseRecord(
        pose,
        photo,
        _model(reading, data.get("model")),
        _chart(reading, data.get("chart")),
        None if data.get("loss") is None else reading.number(data["loss"], "loss"),
        _optional_object(reading, data, "settings"),
        _optional_object(reading, data, "software"),
        None
        if data.get("distortion") is None
        else distortion_from_json(reading, data["distortion"], width, height),
        verdict_from_json(reading, data.get("verdict")),
        tuple(reading.warnings),
    )


def check_against(record: PoseRecord, photo_sha256: str, model_sha256: str) -> tuple[str, ...]:
    """Warnings where a pose file names another photo or model than the ones in use."""
    found = []
    pairs = (("photo", record.photo, photo_sha256), ("model", record.model, model_sha256))
    for what, reference, sha256 in pairs:
        if reference is not None and reference.sha256 and reference.sha256.lower() != sha256:
            name = f" ({reference.file})" if reference.file else ""
            found.append(f"The pose was made with another {what}{name}: the fingerprints differ.")
    return tuple(found)


def save_pose(path: str | Path, record: PoseRecord) -> None:
    """Write a pose file, whole or not at all; every number reads back to the last digit.

    Raises:
        PoseFileError: the folder is missing or cannot be written to; a number is not finite.
    """
    path = Path(path)
    try:
        text = json.dumps(record_as_json(record), indent=2, allow_nan=False, ensure_ascii=False)
    except (ValueError, TypeError) as error:
        raise PoseFileError(
            f"{path.name}: the pose holds what JSON cannot ({error}); nothing was written."
        ) from error
    write_whole(path, (text + "\n").encode(), PoseFileError)


def record_as_json(record: PoseRecord) -> dict[str, Any]:
    """What a pose file says, as JSON has it."""
    transform = record.pose.camera_from_model
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "photo": _without_none(record.photo, ("file", "width", "height", "sha256")),
        "model": _without_none(record.model, ("file", "sha256", "unit")),
        **camera_as_json(record.pose.camera),
        "camera_from_model": {
            "rotation": transform.rotation.tolist(),
            "translation": transform.translation.tolist(),
        },
        "loss": None if record.loss is None else float(record.loss),
        "settings": None if record.settings is None else dict(record.settings),
        "software": None if record.software is None else dict(record.software),
    }
    if record.verdict is not None:
        data["verdict"] = verdict_as_json(record.verdict)
    if record.undistortion is not None:
        data["distortion"] = distortion_as_json(record.undistortion)
    if record.chart is not None:
        parameters = [float(number) for number in record.chart.parameters]
        names = list(record.chart.names)
        data["chart"] = {"name": record.chart.name, "names": names, "numbers": parameters}
    return {key: value for key, value in data.items() if value is not None}


def camera_as_json(camera: Camera) -> dict[str, Any]:
    """``projection`` and ``camera`` as a pose file says them, pixel centres at integers."""
    camera = camera_as_integer_centres(camera)
    perspective = isinstance(camera, Perspective)
    names = ("fx", "fy", "cx", "cy") if perspective else ("scale", "cx", "cy")
    return {
        "projection": "perspective" if perspective else "parallel",
        "camera": {name: float(getattr(camera, name)) for name in names},
    }


def _without_none(reference: object, names: tuple[str, ...]) -> dict[str, Any] | None:
    if reference is None:
        return None
    values = {name: getattr(reference, name) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def camera_from_json(reading: Reading, data: dict[str, Any], width: int, height: int) -> Camera:
    """The camera in a pose file's ``projection`` and ``camera``, pixel centres at i + 0.5.

    Raises:
        PoseFileError: it is not there, or not one.
    """
    projection = data.get("projection")
    if projection not in ("perspective", "parallel"):
        raise reading.error(
            f"projection is {kind_of(projection)}", "wanted 'perspective' or 'parallel'"
        )
    camera = reading.object(data.get("camera"), "camera")
    cx = reading.number(camera.get("cx"), "camera.cx")
    cy = reading.number(camera.get("cy"), "camera.cy")
    if projection == "parallel":
        scale = reading.number(camera.get("scale"), "camera.scale", positive=True)
        return camera_from_integer_centres(Parallel(scale, cx, cy, width, height))
    fx = reading.number(camera.get("fx"), "camera.fx", positive=True)
    fy = reading.number(camera.get("fy"), "camera.fy", positive=True)
    return camera_from_integer_centres(Perspective(fx, fy, cx, cy, width, height))


def _transform(reading: Reading, data: dict[str, Any]) -> RigidTransform:
    value = reading.object(data.get("camera_from_model"), "camera_from_model")
    rows = value.get("rotation")
    if not isinstance(rows, list) or len(rows) != 3:
        raise reading.error(f"the rotation is {kind_of(rows)}", "wanted 3 rows of 3 numbers")
    matrix = [reading.numbers(row, f"rotation[{i}]", 3) for i, row in enumerate(rows)]
    translation = reading.numbers(value.get("translation"), "translation", 3)
    return RigidTransform(checked_rotation(reading, np.array(matrix)), np.array(translation))


def _photo(reading: Reading, value: Any) -> PhotoReference | None:
    if value is None:
        return None
    value = reading.object(value, "photo")
    return PhotoReference(
        reading.text(value.get("file"), "photo.file"),
        reading.size(value.get("width"), "photo.width"),
        reading.size(value.get("height"), "photo.height"),
        reading.text(value.get("sha256"), "photo.sha256"),
    )


def _warn_of_size(reading: Reading, photo: PhotoReference, width: int, height: int) -> None:
    if (photo.width or width, photo.height or height) != (width, height):
        reading.warnings.append(
            f"{reading.name}: the pose was made for a photo of {photo.width}x{photo.height} px, "
            f"this one has {width}x{height} px."
        )


def _model(reading: Reading, value: Any) -> ModelReference | None:
    if value is None:
        return None
    value = reading.object(value, "model")
    return ModelReference(
        *(reading.text(value.get(key), f"model.{key}") for key in ("file", "sha256", "unit"))
    )


def _chart(reading: Reading, value: Any) -> ChartParameters | None:
    if value is None:
        return None
    value = reading.object(value, "chart")
    names = value.get("names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise reading.error(f"chart.names is {kind_of(names)}", "wanted a list of texts")
    parameters = reading.numbers(value.get("numbers"), "chart.numbers", len(names))
    name = reading.text(value.get("name"), "chart.name") or ""
    return ChartParameters(name, tuple(names), tuple(parameters))


def _optional_object(reading: Reading, data: dict[str, Any], key: str) -> Any:
    return None if data.get(key) is None else reading.object(data[key], key)
