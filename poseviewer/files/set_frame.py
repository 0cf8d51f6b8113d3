"""The frame of a set of photos, and the pose in each of them, as a pose file has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import Reading
from poseviewer.files.pose import PoseRecord, record_from_json, transform_from_json
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform


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
        """What it says, for comments in files."""
        rows = ", ".join(str([float(x) for x in row]) for row in self.set_from_model)
        unit = f" ({self.unit})" if self.unit else ""
        return f"The frame of {self.name}{unit}: x_in_set = [{rows}] @ x_in_model"

    def camera_from_set(self, pose: Pose) -> RigidTransform:
        """How the camera of a pose stands in the set's frame, by lengths of the model's unit."""
        scaled = RigidTransform(self.place.rotation, self.place.translation / self.size)
        return pose.camera_from_model @ scaled.inverse()


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
