"""Two things on a table, seen by more cameras than a strip has room for: as files."""

from functools import cache
from pathlib import Path

import numpy as np

from poseviewer.files.photo import save_image
from poseviewer.files.scene_assets import model_file, view_of_file
from poseviewer.files.scene_json import save_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.scene.types import PlacedModel, Scene, SceneObject, View
from tests.meshes import make_box, make_bumpy
from tests.several import LIGHT, coloured, lit_models, save_model

COUNT = 14
CAMERA = Perspective(260.0, 260.0, 80.5, 60.5, 160, 120)
BALL = coloured(make_bumpy(3), (1.0, 0.8, 0.6))
BOX = coloured(make_box((1.3, 2.2, 0.9)), (0.5, 0.7, 1.0))
WORLD_FROM_BALL = RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [-1.0, 0.2, 0.0])
WORLD_FROM_BOX = RigidTransform.from_rotation_vector([0.5, 0.5, 0.1], [1.4, 0.1, 0.3])
NAMES = tuple(f"shot_{index}.png" for index in range(1, COUNT + 1))
"""Names whose order by numbers is another than by letters, and that are no numbers."""


def camera_from_world(index: int) -> RigidTransform:
    """Where a camera stands, on an arc of 70 degrees about the table."""
    turn = np.radians(70.0 * (index / (COUNT - 1) - 0.5))
    return RigidTransform.from_rotation_vector([0.0, turn, 0.0], [0.05 * index - 0.3, 0.0, 9.0])


def write_many(folder: Path, unit: str = "m", lens: Lens | None = None) -> Path:
    """Write photos, ``ball.ply``, ``box.ply`` and a scene file without objects; returns that."""
    for index, name in enumerate(NAMES):
        save_image(folder / name, draw(index))
    save_model(folder / "ball.ply", BALL)
    save_model(folder / "box.ply", BOX)
    save_scene(folder / "set.json", Scene(views=views_in(folder, lens), unit=unit))
    return folder / "set.json"


@cache
def draw(index: int) -> np.ndarray:
    """(height, width, 3): the photo of a camera."""
    seen = zip((BALL, BOX), (WORLD_FROM_BALL, WORLD_FROM_BOX), strict=True)
    view = view_of_file(Path(NAMES[index]), CAMERA, camera_from_world=camera_from_world(index))
    placed = [PlacedModel(mesh, view.pose(Similarity(place))) for mesh, place in seen]
    return lit_models(placed, LIGHT, np.random.default_rng(index), factor=1.0)


def views_in(folder: Path, lens: Lens | None = None) -> tuple[View, ...]:
    """The views of photos in a folder, which need not be read."""
    return tuple(
        view_of_file(folder / name, CAMERA, lens=lens, camera_from_world=camera_from_world(index))
        for index, name in enumerate(NAMES)
    )


def write_two_in_many(folder: Path, model_unit: str | None = "m") -> Path:
    """Write the set, in m, and, with both things where they are, a scene file; returns that."""
    write_many(folder)
    placed = {"ball.ply": WORLD_FROM_BALL, "box.ply": WORLD_FROM_BOX}
    objects = tuple(
        SceneObject(
            id=str(number), model=model_file(folder / name, unit=model_unit),
            world_from_model=Similarity(place),
        )
        for number, (name, place) in enumerate(placed.items(), 1)
    )  # fmt: skip
    save_scene(folder / "two.scene.json", Scene(views=views_in(folder), objects=objects, unit="m"))
    return folder / "two.scene.json"
