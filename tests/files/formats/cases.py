"""Poses that show a slip: unequal focal lengths, a principal point off the middle, turned axes."""

from pathlib import Path

import cv2
import numpy as np
import trimesh

from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.pose import PoseRecord
from poseviewer.files.structs import ModelReference, PhotoReference
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from tests.meshes import make_bumpy

WIDTH, HEIGHT = 200, 150
PLACE = RigidTransform.from_rotation_vector([0.4, -2.3, 0.7], [0.15, -0.1, 6.0])


def perspective_record(unit: str | None = "m") -> PoseRecord:
    """A pose in perspective, names as in a BOP scene."""
    return _record(Pose(Perspective(300.0, 270.0, 112.0, 66.0, WIDTH, HEIGHT), PLACE), unit)


def parallel_record() -> PoseRecord:
    """A pose under parallel projection."""
    return _record(Pose(Parallel(48.0, 112.0, 66.0, WIDTH, HEIGHT), PLACE), "m")


def _record(pose: Pose, unit: str | None) -> PoseRecord:
    photo = PhotoReference("000003.png", WIDTH, HEIGHT)
    return PoseRecord.of(pose, photo, model=ModelReference("obj_000005.ply", unit=unit))


def write_files(folder: Path) -> tuple[Mesh, ConvertOptions]:
    """A model and a photo whose red says the column and whose green says the row."""
    mesh = make_bumpy(3)
    model, photo = folder / "obj_000005.ply", folder / "000003.png"
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(str(model))
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.uint8)
    cv2.imwrite(str(photo), np.stack([np.zeros_like(rows), rows, columns], axis=-1))
    return mesh, ConvertOptions(photo, model)
