"""What is open: a photo, a model, and where the model starts."""

from __future__ import annotations

from dataclasses import dataclass

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.vehicle.keypoints import VehicleKeypoints


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A model file as it was read: many photos can share one."""

    mesh: Mesh
    name: str
    """The file's name, without its folder."""
    sha256: str
    keypoints: VehicleKeypoints | None


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """What is open: the photo, the model and where the model starts."""

    photo: Photo
    mesh: Mesh
    mesh_name: str
    mesh_sha256: str
    keypoints: VehicleKeypoints | None
    start: Pose
    warnings: tuple[str, ...]
    start_is_guess: bool = False
    """Nobody has said yet where the model is."""
