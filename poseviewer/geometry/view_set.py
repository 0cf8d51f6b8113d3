"""Several photos of one thing, by cameras whose poses to one another are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.transform import RigidTransform

LEAST_PARALLAX = 1e-3
"""Sine of the angle between lines of sight from which they are said to meet."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A photo of a set."""

    name: str
    """Of its file, without the folder."""
    photo: Photo
    """Undistorted, with its camera."""
    camera_from_set: RigidTransform
    """In the set's unit."""
    mask: Mask | None = None
    """How much each pixel counts; None: all do."""
    path: Path | None = None
    """Of the photo's file; None: it is in none."""

    @property
    def camera(self) -> Perspective:
        """Of the undistorted photo."""
        assert self.photo.camera is not None  # the photos of a set have one
        return self.photo.camera


@dataclass(frozen=True, slots=True, eq=False)
class ViewSet:
    """Two photos or more."""

    name: str
    """Of its file or folder."""
    views: tuple[View, ...]
    unit: str | None = None
    """Of the set's lengths; None: not said."""
    scale: float | None = None
    """How many lengths of the model's unit one of the set's is; None: not known."""

    def posed(self, index: int, pose: Pose, scale: float) -> tuple[Pose, ...]:
        """In each view the pose that is ``pose`` in view ``index``, by this ``scale`` of the set;
        there it is the same object.
        """
        set_from_camera = self.views[index].camera_from_set.inverse()
        found = []
        for view in self.views:
            moved = view.camera_from_set @ set_from_camera
            moved = RigidTransform(moved.rotation, scale * moved.translation)
            found.append(Pose(view.camera, moved @ pose.camera_from_model))
        found[index] = pose
        return tuple(found)

    def scale_by_sight(self, reference: int, ray: FloatArray, depth: float) -> float | None:
        """The scale by which what view ``reference`` sees along a ``ray`` (3,) of its camera,
        z = 1, at a ``depth`` in the model's unit, is where the others look; None where their lines
        of sight do not meet that ray.
        """
        own = self.views[reference].camera_from_set.inverse()
        start, along = own.translation, own.rotation @ ray
        left, right = 0.0, 0.0
        for index, view in enumerate(self.views):
            if index == reference:
                continue
            set_from_camera = view.camera_from_set.inverse()
            middle = np.array([view.camera.width / 2.0, view.camera.height / 2.0])
            sight = set_from_camera.rotation @ view.camera.rays(middle)
            sight /= np.linalg.norm(sight)
            across = np.eye(3) - np.outer(sight, sight)
            left += float(along @ across @ along)
            right += float(along @ across @ (set_from_camera.translation - start))
        if not left > LEAST_PARALLAX**2 * float(along @ along) or not right > 0.0:
            return None
        return depth * left / right
