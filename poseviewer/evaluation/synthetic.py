"""Synthetic photographs with known poses, drawn by OpenGL, not by the fit's own rasteriser."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl import OpenGLRenderer

SHARPNESS = 46.8
"""Exponent of Blinn-Phong highlights: that of a roughness of 0.45, as of car paint."""
OVER_THE_SHOULDER = (0.0, -0.6, -0.8)
"""Direction of the sun in the camera frame: from behind and above the photographer."""
MAX_LIGHT_ANGLE_DEG = 65.0
"""Largest angle of a light from that direction."""
SUPERSAMPLING = 4
"""Samples along each side of a pixel, which is their mean."""


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """Light from everywhere and from n directions; 1 is the photo's white."""

    ambient: FloatArray
    """(3,): RGB of a white surface that no directional light reaches."""
    towards: FloatArray
    """(n, 3): unit vectors towards the lights, in the camera frame."""
    intensity: FloatArray
    """(n, 3): RGB that a white surface facing each light gains."""


def random_lighting(rng: np.random.Generator) -> Lighting:
    """Draw light as of day: ambient, a strong light from behind the camera, often a weak one."""
    ambient = rng.uniform(0.15, 0.4) * _tint(rng)
    lights = [(_direction(rng), rng.uniform(0.4, 0.7) * _tint(rng))]
    if rng.random() >= 0.4:
        lights.append((_direction(rng), rng.uniform(0.05, 0.2) * _tint(rng)))
    towards, intensity = (np.array(values) for values in zip(*lights, strict=True))
    return Lighting(ambient, towards, intensity)


def _tint(rng: np.random.Generator) -> FloatArray:
    return rng.uniform(0.9, 1.1, 3)


def _direction(rng: np.random.Generator) -> FloatArray:
    """Draw a direction evenly on the spherical cap around ``OVER_THE_SHOULDER``."""
    cosine = rng.uniform(np.cos(np.radians(MAX_LIGHT_ANGLE_DEG)), 1.0)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    sine = np.sqrt(1.0 - cosine**2)
    on_cap = np.array([sine * np.cos(angle), sine * np.sin(angle), cosine])
    rotation = Rotation.align_vectors([OVER_THE_SHOULDER], [(0.0, 0.0, 1.0)])[0]
    return rotation.apply(on_cap)


def cut_out(
    renderer: OpenGLRenderer, pose: Pose, lighting: Lighting, highlights: float = 0.0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Draw the model without background: RGB times coverage (h, w, 3), and coverage (h, w).

    Both are in [0, 1]. RGB is ``reflectance (ambient + sum of intensity max(0, n.l))`` plus
    highlights of Blinn and Phong, clamped, in display-encoded values.

    Args:
        renderer: renderer of the model.
        pose: pose of the model.
        lighting: lighting of the scene.
        highlights: factor of the highlights.
    """
    camera, fine = pose.camera, pose.rescale(SUPERSAMPLING)
    image = renderer.render(fine)
    rows, columns = np.nonzero(image.mask)
    normals = image.normals[image.mask].astype(float)
    towards_eye = np.array([0.0, 0.0, -1.0])
    if isinstance(fine.camera, Perspective):
        rays = fine.camera.rays(np.column_stack([columns, rows]) + 0.5)
        towards_eye = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    diffuse, highlight = np.broadcast_to(lighting.ambient, normals.shape), 0.0
    for towards, intensity in zip(lighting.towards, lighting.intensity, strict=True):
        arriving = np.maximum(normals @ towards, 0.0)[:, None] * intensity
        diffuse = diffuse + arriving
        half = towards + towards_eye
        half = half / np.linalg.norm(half, axis=-1, keepdims=True)
        peak = np.maximum(np.sum(normals * half, axis=1), 0.0)
        highlight = highlight + arriving * peak[:, None] ** SHARPNESS
    shaded = np.zeros((*image.mask.shape, 4), np.float32)
    colours = image.reflectance[image.mask] * diffuse + highlights * highlight
    shaded[image.mask] = np.column_stack([np.clip(colours, 0.0, 1.0), np.ones(len(rows))])
    size = (camera.width, camera.height)
    small = np.asarray(cv2.resize(shaded, size, interpolation=cv2.INTER_AREA), np.float32)
    return small[..., :3], small[..., 3]


def photograph(
    mesh: Mesh,
    pose: Pose,
    lighting: Lighting,
    background: ArrayLike = (0.7, 0.7, 0.7),
    *,
    highlights: float = 0.0,
    blur_px: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Draw a photo (h, w, 3), in the thread of ``opengl`` alone.

    Args:
        mesh: the model.
        pose: pose of the model.
        lighting: lighting of the scene.
        background: RGB in [0, 1], one or a picture (h, w, 3) of them.
        highlights: factor of the highlights.
        blur_px: standard deviation of the lens's blur.
        noise: standard deviation of the sensor's noise, grey levels of 255.
        seed: seed of the noise.
    """
    renderer = OpenGLRenderer(mesh)
    try:
        colour, coverage = cut_out(renderer, pose, lighting, highlights)
    finally:
        renderer.close()
    behind = np.asarray(background, np.float32)
    photo = 255.0 * (colour + (1.0 - coverage[..., None]) * behind)
    if blur_px > 0.0:
        photo = cv2.GaussianBlur(photo, (0, 0), blur_px)
    photo = photo + np.random.default_rng(seed).normal(0.0, noise, photo.shape)
    return np.clip(np.rint(photo), 0.0, 255.0).astype(np.uint8)
