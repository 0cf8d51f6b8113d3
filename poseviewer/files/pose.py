"""Pose files: JSON that says where the model is and which camera sees it (``pose.schema.json``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import PoseFileError
from poseviewer.files.checks import VERSION, Reading
from poseviewer.files.structs import (
    CameraNumbers,
    ChartParameters,
    Distortion,
    ModelReference,
    Number,
    PhotoReference,
    Projection,
    RecordedVerdict,
    Transform,
    Uncertainty,
    decoded,
    projection_of,
)
from poseviewer.files.symmetry import SymmetryTurns, symmetry_from
from poseviewer.files.writing import write_json
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry

FORMAT: Literal["poseviewer-pose"] = "poseviewer-pose"
AS_IN_FILE = (
    *("photo", "model", "loss", "unexplained", "settings", "software", "verdict", "mask"),
    *("without", "seen", "notes", "chart"),
)
"""Fields that ``PoseFile`` and ``PoseRecord`` share."""


class PoseFile(Struct, frozen=True, kw_only=True):
    """Pose of a known 3D model in one photo. Camera axes are OpenCV's (x right, y down, z
    forward); pixel centres are at integers; lengths are in the model's unit.

    loss: what the search minimises; unexplained: the same on a scale from 0, all of the photo is
    explained, to 1, nothing; seen: the share of the model's pixels that count, that nothing in
    front hides; mask: name of a picture beside this file, in the photo's size, whose white pixels
    count; without: names of the model's parts that are left out; symmetry: what maps the model onto
    itself: the pose is one of several that show the same, always the same one of them.
    """

    format: Literal["poseviewer-pose"] = FORMAT
    version: Literal[1] = 1
    projection: Projection
    camera: CameraNumbers
    camera_from_model: Transform
    photo: PhotoReference | None = None
    model: ModelReference | None = None
    loss: Number | None = None
    unexplained: Number | None = None
    settings: dict[str, Any] | None = None
    software: dict[str, Any] | None = None
    verdict: RecordedVerdict | None = None
    uncertainty: Uncertainty | None = None
    mask: str | None = None
    without: tuple[str, ...] = ()
    seen: Number | None = None
    notes: tuple[str, ...] = ()
    distortion: Distortion | None = None
    symmetry: SymmetryTurns | None = None
    set: dict[str, Any] | None = None
    chart: ChartParameters | None = None


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """Content of a pose file."""

    pose: Pose
    """Camera (pixel centres at i + 0.5) and ``camera_from_model``, in the model's unit."""
    photo: PhotoReference | None = None
    model: ModelReference | None = None
    chart: ChartParameters | None = None
    loss: float | None = None
    settings: Mapping[str, Any] | None = None
    software: Mapping[str, str] | None = None
    undistortion: Undistortion | None = None
    """Lens and cameras of the undistorted photo, which the pose belongs to; None: no lens."""
    verdict: RecordedVerdict | None = None
    notes: tuple[str, ...] = ()
    """Sentences for the user of the pose, such as on a camera that is a guess."""
    unexplained: float | None = None
    """The loss on the scale from 0, all explained, to 1, nothing."""
    mask: str | None = None
    """Name of the picture beside the pose file whose white pixels count (``files.masks``)."""
    without: tuple[str, ...] = ()
    """Names of the model's parts that are left out."""
    seen: float | None = None
    """The share of the model's pixels that count: that nothing else hides, as far as is known."""
    covariance: PoseCovariance | None = None
    """Covariance of the pose, if it is right; in files under ``uncertainty``."""
    symmetry: Symmetry = field(default=NO_SYMMETRY, compare=False)
    """The model's. In files that a scene is saved as, the pose is the canonical of equal ones."""
    in_set: Mapping[str, Any] | None = None
    """Pose in the frame of several photos, and in each; written by earlier versions as ``set``."""
    warnings: tuple[str, ...] = field(default=(), compare=False)
    """Sentences on how the file was read; not written."""


def load_pose(path: str | Path, width: int | None = None, height: int | None = None) -> PoseRecord:
    """Load the pose in a file, for a photo of ``width`` x ``height`` px; by default of the size
    that the file says, or 1 x 1.

    Only ``projection``, ``camera`` and ``camera_from_model`` are needed; unknown fields are
    ignored. A rotation off by rounding is made exact; below 1 degree, with a warning.

    Raises:
        PoseFileError: there is no such file, or it does not hold a pose.
    """
    reading = Reading(Path(path))
    with reading.naming_errors():
        return record_from_json(reading, reading.load_json(), width, height)


def record_from_json(
    reading: Reading, data: Any, width: int | None = None, height: int | None = None
) -> PoseRecord:
    """Read a pose file's JSON, for a photo as ``load_pose`` does."""
    reading.require_format(reading.object(data, "its content"), FORMAT)
    said = decoded(reading, data, PoseFile, raw=("mask",))
    made_for = said.photo or PhotoReference()
    width, height = width or made_for.width or 1, height or made_for.height or 1
    camera = said.camera.camera(reading, said.projection, width, height)
    pose = Pose(camera, said.camera_from_model.checked(reading))
    if (made_for.width or width, made_for.height or height) != (width, height):
        reading.warnings.append(
            f"{reading.path.name}: the pose was made for a photo of "
            f"{made_for.width}x{made_for.height} px, this one has {width}x{height} px."
        )
    return PoseRecord(
        pose,
        undistortion=said.distortion and said.distortion.undistortion(reading, width, height),
        covariance=said.uncertainty and said.uncertainty.about(pose),
        symmetry=symmetry_from(reading, said.symmetry),
        in_set=said.set,
        warnings=tuple(reading.warnings),
        **{name: getattr(said, name) for name in AS_IN_FILE},
    )


def check_against(known: PhotoReference | ModelReference | None, sha256: str) -> tuple[str, ...]:
    """A warning where a pose file names another photo or model than the one in use, or none."""
    if known is None or not known.sha256 or known.sha256.lower() == sha256:
        return ()
    what = "photo" if isinstance(known, PhotoReference) else "model"
    name = f" ({known.file})" if known.file else ""
    return (f"The pose was made with another {what}{name}: the fingerprints differ.",)


def save_pose(path: str | Path, record: PoseRecord) -> None:
    """Write a pose file, whole or not at all; every number reads back to the last digit."""
    write_json(Path(path), record_as_json(record), PoseFileError)


def record_as_json(record: PoseRecord) -> dict[str, Any]:
    """Return the JSON of a pose file."""
    lens, sure = record.undistortion, record.covariance
    data = {
        "format": FORMAT,
        "version": VERSION,
        "projection": projection_of(record.pose.camera),
        "camera": CameraNumbers.of(record.pose.camera),
        "camera_from_model": Transform.of(record.pose.camera_from_model),
        **{name: getattr(record, name) for name in AS_IN_FILE},
        "uncertainty": sure and Uncertainty.of(sure),
        "distortion": lens and Distortion.of(lens),
        "symmetry": SymmetryTurns.of(record.symmetry),
        "set": record.in_set,
    }
    data = {k: value for k, value in data.items() if value or not isinstance(value, tuple | None)}
    kept = {"settings": dict(data.pop("settings"))} if "settings" in data else {}
    return msgspec.to_builtins(data, enc_hook=float) | kept  # settings are checked when written
