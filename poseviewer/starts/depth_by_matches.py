"""Depth of what a part of a photo shows, by features matched with other photos of the set."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.image import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.scene.types import View
from poseviewer.starts.texture_features import match_features, photo_features

MAX_VIEWS = 8
"""Number of other views that are matched: with one alone most points are matched wrongly."""
MIN_PARALLAX_DEG = 1.0
"""Angle between two viewing rays from which their intersection tells a depth to some per cent."""
MAX_PARALLAX_DEG = 40.0
"""Angle between two viewing directions up to which features are matched."""
MAX_MISS = 0.004
"""Distance of two viewing rays, by the depth, up to which they meet: some px."""
MIN_POINTS = 8
"""Matches that a depth needs: wrong ones seldom agree with the cameras."""


def depth_by_matches(views: Sequence[View], index: int, box: Rectangle) -> float | None:
    """Return the median depth of what a box of a view shows, in the world's unit; None: not told.

    Photos are read and forgotten one by one.

    Args:
        views: all views of the set, with perspective cameras.
        index: of the view.
        box: part of its photo, px.
    """
    own, depths = views[index], list[float]()
    camera = own.camera
    if not isinstance(camera, Perspective):
        return None
    here = photo_features(_photo(own), box)[0]
    for other in _neighbours(views, index):
        photo = _photo(other)
        whole = Rectangle(0.0, 0.0, photo.width, photo.height)
        pixels, matched = match_features(here, photo_features(photo, whole)[0])
        motion = own.camera_from_world @ other.camera_from_world.inverse()
        if isinstance(other.camera, Perspective):
            across = other.camera.rays(matched) @ motion.rotation.T
            depths += _depths(camera.rays(pixels), across, motion.translation)
    return float(np.median(depths)) if len(depths) >= MIN_POINTS else None


def _photo(view: View) -> Photo:
    """The view's photo, which is not kept."""
    return replace(view.file).photo


def _neighbours(views: Sequence[View], index: int) -> list[View]:
    """Views that look into about the same direction, as evenly spread as they come."""
    ahead = views[index].camera_from_world.rotation[2]
    turns = [
        np.degrees(np.arccos(np.clip(view.camera_from_world.rotation[2] @ ahead, -1.0, 1.0)))
        for view in views
    ]
    alike = [i for i, turn in enumerate(turns) if i != index and turn < MAX_PARALLAX_DEG]
    return [views[i] for i in alike[:: math.ceil(len(alike) / MAX_VIEWS) or 1]]


def _depths(rays: FloatArray, across: FloatArray, centre: FloatArray) -> list[float]:
    """Depths along rays (n, 3) from 0 at which they meet those (n, 3) from another centre (3,)."""
    depths = []
    for ray, other in zip(rays, across, strict=True):
        sides = np.column_stack([ray, -other])
        (depth, along), *_ = np.linalg.lstsq(sides, centre, rcond=None)
        miss = np.linalg.norm(sides @ [depth, along] - centre)
        sine = np.linalg.norm(np.cross(ray, other)) / np.linalg.norm(ray) / np.linalg.norm(other)
        is_told = sine > np.sin(np.radians(MIN_PARALLAX_DEG))
        if is_told and min(depth, along) > 0.0 and miss < MAX_MISS * depth:
            depths.append(float(depth))
    return depths
