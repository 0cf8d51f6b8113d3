"""Path-traced photos of the study: light, paint and place drawn at random, and a cache of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PhotoFileError
from poseviewer.files.mesh.load import linear_from_srgb
from poseviewer.files.photo.load import load_photo, save_image
from poseviewer.files.state.folder import state_folder
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.study.cycles import surroundings
from poseviewer.study.cycles.photographer import CyclesPhotographer, Scene
from poseviewer.study.synthetic import PhotoQuality

QUALITY = PhotoQuality(blur_px=0.5, noise=2.0)
CACHE = "traced"
"""Folder of the user's state folder."""
PAINTS = (
    (0.75, 0.76, 0.78),
    (0.86, 0.86, 0.84),
    (0.10, 0.10, 0.11),
    (0.45, 0.46, 0.48),
    (0.55, 0.06, 0.07),
    (0.07, 0.20, 0.45),
    (0.12, 0.30, 0.20),
    (0.55, 0.45, 0.32),
)
"""Display-encoded RGB of cars: silver, white, black, grey, red, blue, green, sand."""
SUN_RISE_DEG, SUN_TURN_DEG, SUN_ANGLE_DEG = (22.0, 65.0), 100.0, (0.6, 6.0)
"""Above the horizon; to either side of the photographer; across: behind haze it is wider."""
GREYS = (0.25, 0.75)
"""Display-encoded, of the ground of a ``grey`` photo."""


def random_scene(
    pose: Pose,
    upright: FloatArray,
    behind: NDArray[np.uint8] | FloatArray,
    repainted: bool,
    random: np.random.Generator,
) -> Scene:
    """Daylight on a vehicle before a photo (h, w, 3) uint8, or a plain of one colour (3,).

    ``upright``: (3, 3), the stage from the model. The sun is somewhere on the photographer's side.
    """
    towards_camera = -(upright @ pose.camera_from_model.rotation[2])
    azimuth = math.atan2(towards_camera[1], towards_camera[0])
    azimuth += math.radians(random.uniform(-SUN_TURN_DEG, SUN_TURN_DEG))
    rise = math.radians(random.uniform(*SUN_RISE_DEG))
    level = math.cos(rise)
    towards = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(rise)])
    if behind.ndim == 1:
        picture = np.asarray(behind, np.float32)
        ground = linear_from_srgb(picture)
        around = surroundings.of_a_plain(np.asarray(ground, float), random)
    else:
        height, width = pose.camera.height, pose.camera.width
        photo = np.asarray(behind, np.uint8)
        picture = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA) / np.float32(255)
        around = surroundings.of_photo(photo)
        ground = linear_from_srgb(picture[-max(1, height // 6) :]).mean(axis=(0, 1))
    paint = np.array(PAINTS[int(random.integers(len(PAINTS)))])
    return Scene(
        sun_towards=towards,
        sun_light=random.uniform(0.5, 1.1) * np.array([1.0, 0.95, 0.87]),
        sun_angle=math.radians(random.uniform(*SUN_ANGLE_DEG)),
        surroundings=surroundings.scaled_to(around, random.uniform(0.35, 0.6)),
        ground=np.asarray(ground, float),
        behind=np.asarray(picture, np.float32),
        paint=paint if repainted else None,
        exposure=random.uniform(1.0, 1.5),
        seed=int(random.integers(2**31)),
    )


def draw_traced(
    photographer: CyclesPhotographer, pose: Pose, scene: Scene, tell: Callable[[str], None]
) -> NDArray[np.uint8]:
    """The photo, (h, w, 3) RGB: from the cache, if one like it was drawn before.

    Raises:
        RendererUnavailableError: there is no Blender.
        PoseViewerError: the cache cannot be written to.
    """
    path = _cache() / f"{photographer.fingerprint(pose, scene, QUALITY)}.png"
    if path.is_file():
        return load_photo(path).as_rgb8(pose.camera.width, pose.camera.height)
    began = perf_counter()
    pixels = photographer.photograph(pose, scene, QUALITY)
    tell(f"a photo was path-traced in {perf_counter() - began:.0f} s")
    save_image(path, pixels)
    return pixels


def _cache() -> Path:
    folder = state_folder() / CACHE
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise PhotoFileError(f"{folder}: cannot be made ({error.strerror})") from None
    return folder
