"""Pose files: JSON that says where the model is and which camera sees it (``pose.schema.json``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from msgspec import field, structs

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseFileError
from poseviewer.files import structs as s
from poseviewer.files.checks import InputFile, Number
from poseviewer.files.symmetry import SymmetryTurns
from poseviewer.files.writing import json_bytes, write_whole
from poseviewer.geometry.camera import Pose
from poseviewer.scene.types import OBJECT_TEXTS

FORMAT: Literal["poseviewer-pose"] = "poseviewer-pose"


class PoseRecord(s.CameraRecord, frozen=True, kw_only=True, omit_defaults=True):
    """Pose of a known 3D model in one photo. Camera axes are OpenCV's (x right, y down, z
    forward); pixel centres are at integers; lengths are in the model's unit.

    loss: what the search minimises; unexplained: the same on a scale from 0, all of the photo is
    explained, to 1, nothing; seen: the share of the model's pixels that count, that nothing in
    front hides; mask: name of a picture beside this file, in the photo's size, whose white pixels
    count; occluders: name of another one, black where a search found something in front, which does
    not count either; without: names of the model's parts that are left out; symmetry: what maps the
    model onto itself: the pose is one of several that show the same, always the same one of them;
    note: the user's.
    """

    format: Literal["poseviewer-pose"] = FORMAT
    version: Literal[1] = 1
    camera_from_model: s.Transform
    photo: s.PhotoReference | None = None
    model: s.ModelReference | None = None
    loss: Number | None = None
    unexplained: Number | None = None
    settings: dict[str, Any] | None = None
    software: dict[str, Any] | None = None
    verdict: Verdict | None = None
    uncertainty: s.Uncertainty | None = None
    without: tuple[str, ...] = ()
    seen: Number | None = None
    occluders: str | None = None
    notes: tuple[str, ...] = ()
    turns: SymmetryTurns | None = field(name="symmetry", default=None)
    chart: s.ChartJson | None = None
    note: str = ""
    warnings: tuple[str, ...] = ()
    """Sentences on how the file was read; not written."""

    @classmethod
    def of(cls, pose: Pose, photo: s.PhotoReference | None = None, **said: Any) -> PoseRecord:
        """The record of a pose, and what else is ``said``, by the names of the fields."""
        camera, photo = pose.camera, photo or s.PhotoReference()
        photo = structs.replace(photo, width=camera.width or None, height=camera.height or None)
        return cls(
            projection=s.projection_of(camera), numbers=s.CameraNumbers.of(camera),
            camera_from_model=s.Transform.of(pose.camera_from_model),
            photo=None if photo == s.PhotoReference() else photo, **said,
        )  # fmt: skip

    def with_pose(self, pose: Pose, **changes: Any) -> PoseRecord:
        """Change the pose, and other fields."""
        made = self.of(pose, self.photo)
        names = ("projection", "numbers", "camera_from_model", "photo")
        return structs.replace(self, **{n: getattr(made, n) for n in names}, **changes)

    @property
    def texts(self) -> dict[str, Any]:
        """Texts that the user has written of the object, by the names of its fields."""
        return {name: getattr(self, name) for name in OBJECT_TEXTS}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photo (px); 1 where nothing says it."""
        photo = self.photo or s.PhotoReference()
        return photo.width or 1, photo.height or 1

    @property
    def pose(self) -> Pose:
        """Camera (pixel centres at i + 0.5) and ``camera_from_model``, in the model's unit."""
        return Pose(self.camera, self.camera_from_model.rigid)

    @property
    def covariance(self) -> PoseCovariance | None:
        """Covariance of the pose, if it is right."""
        return self.uncertainty and self.uncertainty.about(self.pose)


TABLES = (".csv", ".tsv", ".txt", ".trc", ".c3d")
"""Endings of OptiTrack's and Vicon's files, and of texts of poses."""


def load_pose(path: str | Path, width: int | None = None, height: int | None = None) -> PoseRecord:
    """Load the pose in a file, for a photo of ``width`` x ``height`` px or of the file's size.

    Needed are ``projection``, ``camera`` and ``camera_from_model``; unknown fields are ignored.
    A rotation off by less than 1 degree is made exact, beyond rounding with a warning.

    Raises:
        PoseFileError: there is no such file, or it does not hold a pose.
    """
    file = InputFile(Path(path))
    with file.naming_errors():
        if file.path.suffix.lower() in TABLES:
            wanted = "wanted a pose file; a 4x4 matrix becomes one with poseviewer convert"
            raise file.error("a table or a text, such as motion capture exports", wanted)
        data = file.load_object()
        file.require_format(data, FORMAT)
        if data.keys().isdisjoint(("projection", "camera", "camera_from_model")):
            found = f"no pose of poseviewer's (its keys: {', '.join(data)[:80] or 'none'})"
            wanted = "make one of another tool's with poseviewer convert"
            raise file.error(found, wanted)
        record = file.decode(data, PoseRecord, raw=("mask", "occluders"))
    known = record.photo or s.PhotoReference()
    made_for = known.width or width, known.height or height
    photo = structs.replace(known, width=width or known.width, height=height or known.height)
    if made_for != (photo.width, photo.height):
        size = f"a photo of {made_for[0]}x{made_for[1]} px, this one has {width}x{height} px"
        file.warnings.append(f"{file.path.name}: the pose was made for {size}.")
    return structs.replace(record, photo=photo, warnings=tuple(file.warnings))


def check_against(
    known: s.PhotoReference | s.ModelReference | None, sha: str | None
) -> tuple[str, ...]:
    """Warn where a pose file names another photo or model than the one in use."""
    if known is None or not known.sha256 or known.sha256.lower() == sha:
        return ()
    what = "photo" if isinstance(known, s.PhotoReference) else "model"
    name = f" ({known.file})" if known.file else ""
    return (f"The pose was made with another {what}{name}: the fingerprints differ.",)


def save_pose(path: str | Path, record: PoseRecord) -> None:
    """Write a pose file, whole or not at all; every number reads back to the last digit."""
    write_whole(Path(path), pose_bytes(Path(path), record), PoseFileError)


def pose_bytes(path: Path, record: PoseRecord) -> bytes:
    """Return the content of a pose file.

    Raises:
        PoseFileError: a number is not finite.
    """
    data = structs.replace(record, warnings=())
    return json_bytes(path, data, PoseFileError, format=FORMAT, version=record.version)
