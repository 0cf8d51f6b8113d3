"""Scenes of one object in one view, as tests of fits want them."""

from dataclasses import replace
from typing import Any

from poseviewer.fit.problem import FitProblem
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene, View, scene_at


def scene_of(
    photo: Photo,
    mesh: Mesh,
    start: Pose,
    settings: FitSettings | None = None,
    mask: Mask | None = None,
    keypoints: Any = None,
) -> Scene:
    """A mesh at a start in a photo."""
    view = View(PhotoFile.of(photo), start.camera, mask=mask)
    model = ModelFile.of(mesh, None, "0" * 64, name="m.ply", keypoints=keypoints)
    return scene_at(view, model, start, settings=settings)


def by(scene: Scene, **settings: Any) -> Scene:
    """The scene whose object is fitted by settings."""
    return scene.with_object(0, settings=FitSettings(**settings))


def locked(problem: FitProblem, *names: str) -> FitProblem:
    """The problem whose search leaves numbers of the chart as they are."""
    return replace(problem, settings=replace(problem.settings, lock=names))
