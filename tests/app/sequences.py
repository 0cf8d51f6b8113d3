"""A shape that turns and wanders through a few small frames, in memory and as files."""

from functools import cache
from pathlib import Path

import numpy as np

from poseviewer.app.state.document import Document
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.image import Photo
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import with_frames
from poseviewer.scene.types import Frame, PlacedModel, View, scene_at
from tests.meshes import make_bumpy
from tests.several import LIGHT, coloured, lit_models, save_model
from tests.writing import write

CAMERA = Perspective(300.0, 300.0, 120.5, 90.5, 240, 180)
MESH = coloured(make_bumpy(3), (1.0, 0.8, 0.6))
COUNT = 7


def true_pose(index: int) -> Pose:
    """Pose in a frame: it turns by 4 degrees a frame, and goes to the right."""
    rotation = [0.4, -0.3 + 0.07 * index, 0.2]
    return Pose(CAMERA, RigidTransform.from_rotation_vector(rotation, [0.08 * index - 0.3, 0.1, 7]))


@cache
def make_frame(index: int) -> Photo:
    """The photo of a frame, with noise."""
    placed = [PlacedModel(MESH, true_pose(index))]
    pixels = lit_models(placed, LIGHT, np.random.default_rng(index), 0.08, 2.0)
    return Photo(pixels, f"{index:04d}.png", f"{index:064d}", camera=CAMERA)


def make_sequence(count: int = COUNT) -> Document:
    """The sequence in memory, with the object at its true pose in the first frame, and no key."""
    files = [PhotoFile.of(make_frame(index % COUNT)) for index in range(count)]
    scene = scene_at(View(files[0], CAMERA), ModelFile.of(MESH, name="m.ply"), true_pose(0))
    frames = [Frame(file=file, time_s=0.04 * i) for i, file in enumerate(files)]
    return Document.of(with_frames(scene, frames))


def write_sequence(folder: Path) -> tuple[Path, Path, Path, Path]:
    """Write photos into a folder, and the model, the camera and the pose in the first frame."""
    frames, *files = (folder / name for name in ("frames", "m.ply", "camera.json", "start.json"))
    model, camera, start = files
    frames.mkdir()
    for index in range(COUNT):
        save_image(frames / f"{index:04d}.png", make_frame(index).pixels)
    save_model(model, MESH)
    given = camera_as_integer_centres(CAMERA)
    write(camera, {name: getattr(given, name) for name in ("fx", "fy", "cx", "cy")})
    save_pose(start, PoseRecord.of(true_pose(0)))
    return frames, model, camera, start
