"""A drawn sequence: a ball that rolls, and a box that passes in front of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from poseviewer.files.photo import save_image
from poseviewer.files.scene_assets import frame_file, model_file
from poseviewer.files.scene_json import as_saved, save_scene
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import show_frame, with_frames
from poseviewer.scene.types import Frame, FramePose, PlacedModel, Scene, SceneObject, View
from tests.several import CAMERA, LIGHT, MESHES, lit_models, save_model

FRAMES = 6
BALL, BOX = MESHES[0], MESHES[1]


def ball(index: float, left: float = -0.4) -> PlacedModel:
    """The ball in a frame: it rolls to the right."""
    rotation, place = [0.4, -0.3 + 0.04 * index, 0.2], [left + 0.06 * index, 0.05, 7.0]
    return PlacedModel(BALL, Pose(CAMERA, RigidTransform.from_rotation_vector(rotation, place)))


def box(index: float) -> PlacedModel:
    """The box in a frame: it comes from the right, and passes before the ball."""
    rotation, place = [0.1, 0.6 - 0.03 * index, -0.1], [1.4 - 0.1 * index, 0.1, 5.0]
    return PlacedModel(BOX, Pose(CAMERA, RigidTransform.from_rotation_vector(rotation, place)))


@cache
def photo(index: int, drawn: tuple[Callable[[float], PlacedModel], ...], is_covered: bool) -> Photo:
    """A frame with some models, or with a board of noise in front of them."""
    random = np.random.default_rng(index)
    ground = np.random.default_rng(9).uniform(0.1, 0.4, (720, 960, 1))
    pixels = lit_models([one(index) for one in drawn], LIGHT, random, ground)
    if is_covered:
        shape = (*pixels.shape[:2], 1)
        pixels = np.broadcast_to(random.integers(60, 120, shape), pixels.shape).astype(np.uint8)
    return Photo(pixels, f"{index}.png", "0" * 64)


def sequence(
    keys: Mapping[int, Sequence[PlacedModel]],
    drawn: tuple[Callable[[float], PlacedModel], ...] = (ball,),
    covered: Sequence[int] = (),
    count: int = FRAMES,
) -> Scene:
    """Frames, with the poses of some models as keys."""
    photos = [photo(index, drawn, index in covered) for index in range(count)]
    view = View(PhotoFile.of(photos[0]), CAMERA)
    first = keys[min(keys)]
    scene = Scene(
        views=(view,),
        objects=tuple(
            SceneObject(
                id=name,
                model=ModelFile.of(one.mesh, name=name),
                world_from_model=view.world_from_model(one.pose),
            )
            for name, one in zip("ab", first, strict=False)
        ),
    )
    poses = {
        index: {
            name: FramePose(world_from_model=view.world_from_model(one.pose))
            for name, one in zip("ab", placed, strict=False)
        }
        for index, placed in keys.items()
    }
    frames = [Frame(file=PhotoFile.of(p), poses=poses.get(i, {})) for i, p in enumerate(photos)]
    return with_frames(scene, frames)


def off(scene: Scene, index: int, truth: PlacedModel, name: str = "a") -> float:
    """Distance from the truth, % of the model's size."""
    pose = scene.views[0].pose(scene.frames[index].poses[name].world_from_model)
    return pose_error(truth.mesh, pose, truth.pose).percent


def write_sequence(folder: Path, scene: Scene) -> Path:
    """Write ``scene.json`` with its photos in ``frames`` and its models; returns its path."""
    (folder / "frames").mkdir()
    frames = []
    for frame in scene.frames:
        path = folder / "frames" / frame.file.name
        save_image(path, frame.file.photo.pixels)
        frames.append(replace(frame, file=frame_file(path, scene.views[0])))
    for index, item in enumerate(scene.objects):
        save_model(folder / f"{item.id}.ply", item.mesh)
        scene = scene.with_object(index, model=model_file(folder / f"{item.id}.ply"))
    scene = show_frame(replace(scene, frames=tuple(frames)), 0)
    save_scene(folder / "scene.json", as_saved(scene))
    return folder / "scene.json"
