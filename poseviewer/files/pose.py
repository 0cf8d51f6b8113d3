"""Pose files: JSON that says where the model is and which camera sees it (``pose.schema.json``).

In files, pixel centres are at integers, as in OpenCV; inside at i + 0.5 (``geometry.frames``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import (
    VERSION,
    Reading,
    checked_camera,
    checked_rotation,
    kind_of,
    read_json,
)
from poseviewer.files.symmetry import symmetry_as_json, symmetry_from_json
from poseviewer.files.writing import write_json
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel, Undistortion
from poseviewer.geometry.pose_covariance import PoseCovariance
from poseviewer.geometry.symmetry import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import SIZE

FORMAT = "poseviewer-pose"
VERDICTS = ("found", "doubtful", "lost")
NOTE = (
    "The pose, its camera and its chart belong to the undistorted photo, not to the photo as taken."
)
CAMERAS = {
    "perspective": (Perspective, ("fx", "fy"), ("cx", "cy")),
    "parallel": (Parallel, ("scale",), ("cx", "cy")),
}
"""The projections by what files call them: what is above 0, and the other numbers."""
MODELS: dict[str, LensModel] = {"opencv": "opencv", "opencv-fisheye": "fisheye"}
"""What the file calls a lens model."""


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
class RecordedVerdict:
    """The verdict on a pose when it was found."""

    word: str
    """``found``, ``doubtful`` or ``lost``."""
    probability: float
    """That the pose is right, in [0, 1]."""
    reasons: tuple[str, ...] = ()
    features: Mapping[str, float] = field(default_factory=dict)
    """The numbers that it comes from, by name; in files under ``evidence``."""


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
    notes: tuple[str, ...] = ()
    """What the user of the pose should know, such as a camera that is a guess."""
    unexplained: float | None = None
    """The loss on the scale from 0, all explained, to 1, nothing."""
    mask: str | None = None
    """Name of the picture beside the pose file whose white pixels count (``files.masks``)."""
    without: tuple[str, ...] = ()
    """Names of the model's parts that are left out."""
    seen: float | None = None
    """The share of the model's pixels that count: that nothing else hides, as far as is known."""
    covariance: PoseCovariance | None = None
    """How sure the pose is, if it is right; in files under ``uncertainty``."""
    symmetry: Symmetry = field(default=NO_SYMMETRY, compare=False)
    """The model's; in files, the pose is the canonical one of those that are equal."""
    in_set: Mapping[str, Any] | None = None
    """Where it was found on several photos: the pose in the set's frame, and in each photo; in
    files under ``set``."""
    warnings: tuple[str, ...] = field(default=(), compare=False)
    """What the user should know about how the file was read; not written."""


def load_pose(path: str | Path, width: int, height: int) -> PoseRecord:
    """The pose in a file, for a photo of ``width`` x ``height`` px.

    Only ``projection``, ``camera`` and ``camera_from_model`` are needed; unknown fields are
    ignored. A rotation off by rounding is made exact; below 1 degree, with a warning.

    Raises:
        PoseFileError: there is no such file, or it does not hold a pose.
    """
    reading = Reading(Path(path))
    with reading.naming_errors():
        return record_from_json(reading, reading.load_json(), width, height)


def recorded_size(path: Path) -> tuple[int, int]:
    """The width and height of the photo that a pose file was made for; 1 x 1 where ``load_pose``
    will say what is wrong with them, or they are not said.
    """
    try:
        photo = read_json(path)["photo"]
        width, height = photo["width"], photo["height"]
    except (PoseFileError, KeyError, TypeError):
        return 1, 1
    return (width, height) if isinstance(width, int) and isinstance(height, int) else (1, 1)


def record_from_json(reading: Reading, data: Any, width: int, height: int) -> PoseRecord:
    """What a pose file's JSON says, for a photo of ``width`` x ``height`` px.

    Raises:
        PoseFileError: it does not hold a pose.
    """
    data = reading.object(data, "its content")
    reading.require_format(data, FORMAT)

    def optional(key: str, read: Callable[[Reading, Any, str], Any]) -> Any:
        return None if data.get(key) is None else read(reading, data[key], key)

    record = PoseRecord(
        Pose(camera_from_json(reading, data, width, height), transform_from_json(reading, data)),
        optional("photo", _photo),
        optional("model", _model),
        optional("chart", _chart),
        optional("loss", Reading.number),
        optional("settings", Reading.object),
        optional("software", Reading.object),
        optional("distortion", lambda r, v, _: distortion_from_json(r, v, width, height)),
        optional("verdict", _verdict),
        optional("notes", Reading.texts) or (),
        optional("unexplained", Reading.number),
        optional("mask", Reading.text),
        optional("without", Reading.texts) or (),
        optional("seen", Reading.number),
        symmetry=optional("symmetry", symmetry_from_json) or NO_SYMMETRY,
        in_set=optional("set", Reading.object),
    )
    if data.get("uncertainty") is not None:
        record = replace(record, covariance=_covariance(reading, data["uncertainty"], record.pose))
    made_for = record.photo or PhotoReference()
    if (made_for.width or width, made_for.height or height) != (width, height):
        reading.warnings.append(
            f"{reading.path.name}: the pose was made for a photo of "
            f"{made_for.width}x{made_for.height} px, this one has {width}x{height} px."
        )
    return replace(record, warnings=tuple(reading.warnings))


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
    write_json(Path(path), record_as_json(record), PoseFileError)


def record_as_json(record: PoseRecord) -> dict[str, Any]:
    """What a pose file says, as JSON has it."""
    pose = record.symmetry.canonical(record.pose)
    transform = pose.camera_from_model
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "photo": _reference_as_json(record.photo),
        "model": _reference_as_json(record.model),
        **camera_as_json(pose.camera),
        "camera_from_model": transform_as_json(transform),
        "loss": None if record.loss is None else float(record.loss),
        "unexplained": None if record.unexplained is None else float(record.unexplained),
        "settings": None if record.settings is None else dict(record.settings),
        "software": None if record.software is None else dict(record.software),
    }
    if (verdict := record.verdict) is not None:
        features = {name: float(value) for name, value in verdict.features.items()}
        data["verdict"] = {
            "word": verdict.word,
            "probability": float(verdict.probability),
            "reasons": list(verdict.reasons),
            "evidence": {name: value for name, value in features.items() if math.isfinite(value)},
        }
    if record.covariance is not None:
        data["uncertainty"] = covariance_as_json(record.covariance.about(pose))
    if record.mask is not None:
        data["mask"] = record.mask
    if record.without:
        data["without"] = list(record.without)
    if record.seen is not None:
        data["seen"] = float(record.seen)
    if record.notes:
        data["notes"] = list(record.notes)
    if record.undistortion is not None:
        data["distortion"] = distortion_as_json(record.undistortion)
    if not record.symmetry.is_none:
        data["symmetry"] = symmetry_as_json(record.symmetry)
    if record.in_set is not None:
        data["set"] = dict(record.in_set)
    if (chart := record.chart) is not None and pose is record.pose:
        numbers = [float(number) for number in chart.parameters]
        data["chart"] = {"name": chart.name, "names": list(chart.names), "numbers": numbers}
    return {key: value for key, value in data.items() if value is not None}


def transform_as_json(transform: RigidTransform) -> dict[str, Any]:
    """A rigid transform as files say it."""
    rotation, translation = transform.rotation, transform.translation
    return {"rotation": rotation.tolist(), "translation": translation.tolist()}


def camera_as_json(camera: Camera) -> dict[str, Any]:
    """``projection`` and ``camera`` as a pose file says them, pixel centres at integers."""
    projection = "perspective" if isinstance(camera, Perspective) else "parallel"
    _, above_0, others = CAMERAS[projection]
    shifted = camera_as_integer_centres(camera)
    values = {name: float(getattr(shifted, name)) for name in (*above_0, *others)}
    return {"projection": projection, "camera": values}


def covariance_as_json(covariance: PoseCovariance) -> dict[str, Any]:
    """The covariance, and what it says of single quantities."""
    deviations = {
        name: getattr(covariance, name)
        for name in (
            *("depth", "sideways", "scale_percent", "degrees", "focal_px", "size_percent", "px"),
        )
    }
    return {
        "covariance": covariance.matrix.tolist(),
        "names": list(covariance.names),
        "centre": covariance.centre.tolist(),
        "deviations": {k: float(value) for k, value in deviations.items() if value is not None},
    }


def _reference_as_json(reference: PhotoReference | ModelReference | None) -> dict | None:
    if reference is None:
        return None
    values = {f.name: getattr(reference, f.name) for f in fields(reference)}
    return {name: value for name, value in values.items() if value is not None}


def camera_from_json(reading: Reading, data: dict[str, Any], width: int, height: int) -> Camera:
    """The camera in a pose file's ``projection`` and ``camera``, pixel centres at i + 0.5.

    Raises:
        PoseFileError: it is not there, or not one.
    """
    projection = data.get("projection")
    if not isinstance(projection, str) or projection not in CAMERAS:
        wanted = " or ".join(map(repr, CAMERAS))
        raise reading.error(f"projection is {kind_of(projection)}", f"wanted {wanted}")
    return _camera(reading, data.get("camera"), projection, "camera", width, height)


def _camera(
    reading: Reading, value: Any, projection: str, what: str, width: int, height: int
) -> Any:
    kind, above_0, others = CAMERAS[projection]
    checks = dict.fromkeys(above_0, Reading.positive) | dict.fromkeys(others, Reading.number)
    found = kind(*reading.fields(value, what, **checks), width, height)
    return camera_from_integer_centres(checked_camera(reading, found))


def distortion_as_json(undistortion: Undistortion) -> dict[str, Any]:
    """All that is needed to make the undistorted photo of the one as taken."""
    lens = undistortion.lens
    return {
        "note": NOTE,
        "model": next(name for name, model in MODELS.items() if model == lens.model),
        "coefficients": [float(value) for value in lens.coefficients],
        "camera_as_taken": camera_as_json(undistortion.taken)["camera"],
        "camera_undistorted": camera_as_json(undistortion.camera)["camera"],
    }


def distortion_from_json(reading: Reading, value: Any, width: int, height: int) -> Undistortion:
    """What a block says, for a photo of ``width`` x ``height`` px; raises the reading's error."""
    value = reading.object(value, "distortion")
    name, coefficients = value.get("model"), value.get("coefficients")
    if not isinstance(name, str) or name not in MODELS:
        wanted = " or ".join(repr(model) for model in MODELS)
        raise reading.error(f"distortion.model is {kind_of(name)}", f"wanted {wanted}")
    if not isinstance(coefficients, list) or len(coefficients) not in COEFFICIENTS[MODELS[name]]:
        wanted = ", ".join(str(count) for count in COEFFICIENTS[MODELS[name]])
        found = f"distortion.coefficients is {kind_of(coefficients)}"
        raise reading.error(found, f"wanted a list of {wanted} numbers")
    numbers = reading.numbers(coefficients, "distortion.coefficients", len(coefficients))
    taken, camera = (
        _camera(reading, value.get(key), "perspective", f"distortion.{key}", width, height)
        for key in ("camera_as_taken", "camera_undistorted")
    )
    return Undistortion(Lens(MODELS[name], tuple(numbers)), taken, camera)


def transform_from_json(
    reading: Reading, data: dict[str, Any], what: str = "camera_from_model"
) -> RigidTransform:
    """The rigid transform that ``data`` calls ``what``; raises the reading's error."""
    rotation, translation = reading.fields(
        data.get(what), what, rotation=Reading.matrix, translation=Reading.numbers
    )
    return RigidTransform(checked_rotation(reading, rotation), np.array(translation))


def _photo(reading: Reading, value: Any, what: str) -> PhotoReference:
    text, size = Reading.text, Reading.size
    return PhotoReference(
        *reading.fields(value, what, file=text, width=size, height=size, sha256=text)
    )


def _model(reading: Reading, value: Any, what: str) -> ModelReference:
    text = Reading.text
    return ModelReference(*reading.fields(value, what, file=text, sha256=text, unit=text))


def _chart(reading: Reading, value: Any, what: str) -> ChartParameters:
    name, names = reading.fields(value, what, name=Reading.text, names=Reading.texts)
    numbers = reading.numbers(value.get("numbers"), f"{what}.numbers", len(names))
    return ChartParameters(name or "", names, tuple(numbers))


def _covariance(reading: Reading, value: Any, pose: Pose) -> PoseCovariance:
    value, what = reading.object(value, "uncertainty"), "uncertainty"
    rows = value.get("covariance")
    size = 7 if isinstance(rows, list) and len(rows) == 7 else 6
    matrix = reading.matrix(rows, f"{what}.covariance", (size,), size)
    if not np.all(np.diag(matrix) >= 0.0):
        raise reading.error(f"{what}.covariance has a variance below 0", "wanted none")
    centre = reading.numbers(value.get("centre"), f"{what}.centre")
    deviations = reading.object(value.get("deviations", {}), f"{what}.deviations")
    px = reading.number(deviations.get("px", 0.0), f"{what}.deviations.px")
    names = value.get("names")
    seventh = SIZE if isinstance(names, list) and SIZE in names else "log_focal"
    return PoseCovariance(pose, np.array(centre), matrix, px, seventh)


def _verdict(reading: Reading, value: Any, what: str) -> RecordedVerdict:
    value = reading.object(value, what)
    word = value.get("word")
    if word not in VERDICTS:
        raise reading.error(f"verdict.word is {kind_of(word)}", f"wanted {', '.join(VERDICTS)}")
    features = reading.object(value.get("evidence", {}), "verdict.evidence")
    return RecordedVerdict(
        word,
        reading.number(value.get("probability"), "verdict.probability"),
        reading.texts(value.get("reasons", []), "verdict.reasons"),
        {key: reading.number(n, f"verdict.evidence.{key}") for key, n in features.items()},
    )


@dataclass(frozen=True, slots=True, eq=False)
class SetFrame:
    """Where the model is in a set of photos."""

    name: str
    """Of the set's file or folder."""
    unit: str | None
    """Of the set's lengths; None: not said."""
    size: float
    """By which the model is made larger, before it is placed."""
    place: RigidTransform
    others: tuple[PoseRecord, ...]
    """The pose in the set's other photos, in the model's unit."""

    @property
    def set_from_model(self) -> FloatArray:
        """(4, 4): ``x_in_set = set_from_model @ x_in_model``, for points as columns."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.size * self.place.rotation, self.place.translation
        return matrix

    @property
    def sentence(self) -> str:
        """What it says, for people."""
        rows = ", ".join(str([float(x) for x in row]) for row in self.set_from_model)
        unit = f" ({self.unit})" if self.unit else ""
        return f"The frame of {self.name}{unit}: x_in_set = [{rows}] @ x_in_model"


def set_frame(record: PoseRecord) -> SetFrame | None:
    """That of the set that a pose was found in; None: it was found in one photo.

    Raises:
        PoseFileError: the file's block about the set is damaged.
    """
    if record.in_set is None:
        return None
    data, reading = dict(record.in_set), Reading(Path("set"))
    place = transform_from_json(reading, data, "set_from_model")
    size = reading.positive(data["set_from_model"].get("size"), "set_from_model.size")
    entries = data.get("views")
    if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
        raise reading.error("views is no list of photos", "wanted a pose file as it was written")
    others = tuple(_in_view(record, entry, index) for index, entry in enumerate(entries) if index)
    name = reading.text(data.get("file"), "file") or "the set"
    return SetFrame(name, reading.text(data.get("unit"), "unit"), size, place, others)


def _in_view(record: PoseRecord, entry: dict, index: int) -> PoseRecord:
    reading = Reading(Path(f"set.views[{index}]"))
    photo = entry.get("photo")
    sizes = [photo.get(key) if isinstance(photo, dict) else None for key in ("width", "height")]
    width, height = (reading.size(one, "the photo's size") for one in sizes)
    if width is None or height is None:
        raise PoseFileError(f"{reading.path}: its photo's size is missing; wanted width, height.")
    found = record_from_json(reading, entry, width, height)
    return replace(found, model=record.model)
