"""Synthetic photographs with known poses, drawn by OpenGL, not by the fit's own rasteriser."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl import OpenGLRenderer

SHARPNESS = 46.8
"""Exponent of Blinn-Phong highlights: that of a roughness of 0.45, as of car paint."""
OVER_THE_SHOULDER = (0.0, -0.6, -0.8)
"""Camera frame (y down, z away): from behind and above the photographer."""
WIDEST_ANGLE_DEG = 65.0


@dataclass(frozen=True, slots=True, eq=False)
class DirectionalLight:
    """A light so far away that it comes from one direction."""

    towards: FloatArray
    """(3,): unit vector towards the light, in the camera frame."""
    intensity: FloatArray
    """(3,): RGB that a white surface facing the light gains; 1 is the photo's white."""

    def __post_init__(self) -> None:
        towards = np.asarray(self.towards, dtype=float)
        towards = towards / np.linalg.norm(towards)
        object.__setattr__(self, "towards", frozen_array(towards, (3,)))
        object.__setattr__(self, "intensity", frozen_array(self.intensity, (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class LightSources:
    """Light from everywhere and light from a few directions."""

    ambient: FloatArray
    """(3,): RGB of a white surface that no directional light reaches."""
    lights: tuple[DirectionalLight, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "ambient", frozen_array(self.ambient, (3,)))


def random_lighting(rng: np.random.Generator) -> LightSources:
    """Daylight-like: some ambient light, one strong light and often a weak one, slightly tinted.

    The strong light comes from within 65 degrees of over the photographer's shoulder.
    """
    ambient = rng.uniform(0.15, 0.4) * _tint(rng)
    key = DirectionalLight(_direction(rng), rng.uniform(0.4, 0.7) * _tint(rng))
    if rng.random() < 0.4:
        return LightSources(ambient, (key,))
    fill = DirectionalLight(_direction(rng), rng.uniform(0.05, 0.2) * _tint(rng))
    return LightSources(ambient, (key, fill))


def _tint(rng: np.random.Generator) -> FloatArray:
    return rng.uniform(0.9, 1.1, 3)


def _direction(rng: np.random.Generator) -> FloatArray:
    """Uniform on the spherical cap around ``OVER_THE_SHOULDER``."""
    cosine = rng.uniform(np.cos(np.radians(WIDEST_ANGLE_DEG)), 1.0)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    sine = np.sqrt(1.0 - cosine**2)
    on_cap = np.array([sine * np.cos(angle), sine * np.sin(angle), cosine])
    turn = Rotation.align_vectors([OVER_THE_SHOULDER], [(0.0, 0.0, 1.0)])[0]
    return turn.apply(on_cap)


@dataclass(frozen=True, slots=True)
class PhotoQuality:
    """What a camera does to a picture."""

    supersampling: int = 4
    """Each pixel is the mean of this number squared of samples."""
    blur_px: float = 0.0
    """Standard deviation of a Gaussian blur."""
    noise: float = 0.0
    """Standard deviation of the sensor's noise, in grey levels of 255."""


class Photographer:
    """A model in a studio, to be photographed in many poses. One thread only, as ``opengl``."""

    def __init__(self, mesh: Mesh, highlights: float = 0.0) -> None:
        """``highlights``: strength of Blinn-Phong highlights; 0 is Lambert's law alone."""
        self.highlights = highlights
        self._renderer = OpenGLRenderer(mesh)

    def cut_out(
        self, pose: Pose, lighting: LightSources, supersampling: int = 4
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Draw the picture before any background: RGB times coverage (h, w, 3), coverage (h, w).

        Both in [0, 1]. RGB is ``reflectance (ambient + sum of intensity max(0, n.l))`` and
        highlights, clamped, in display-encoded values.
        """
        camera = pose.camera
        fine = pose.scaled(supersampling)
        image = self._renderer.render(fine)
        rows, columns = np.nonzero(image.mask)
        normals = image.normals[image.mask].astype(float)
        towards_eye = np.array([0.0, 0.0, -1.0])
        if isinstance(fine.camera, Perspective):
            rays = fine.camera.rays(np.column_stack([columns, rows]) + 0.5)
            towards_eye = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
        diffuse, highlight = np.broadcast_to(lighting.ambient, normals.shape), 0.0
        for light in lighting.lights:
            arriving = np.maximum(normals @ light.towards, 0.0)[:, None] * light.intensity
            diffuse = diffuse + arriving
            half = light.towards + towards_eye
            half = half / np.linalg.norm(half, axis=-1, keepdims=True)
            peak = np.maximum(np.sum(normals * half, axis=1), 0.0)
            highlight = highlight + arriving * peak[:, None] ** SHARPNESS
        shaded = np.zeros((*image.mask.shape, 4), np.float32)
        colours = image.reflectance[image.mask] * diffuse + self.highlights * highlight
        shaded[image.mask] = np.column_stack([np.clip(colours, 0.0, 1.0), np.ones(len(rows))])
        size = (camera.width, camera.height)
        small = np.asarray(cv2.resize(shaded, size, interpolation=cv2.INTER_AREA), np.float32)
        return small[..., :3], small[..., 3]

    def photograph(
        self,
        pose: Pose,
        lighting: LightSources,
        background: ArrayLike = (0.7, 0.7, 0.7),
        quality: PhotoQuality | None = None,
        seed: int = 0,
    ) -> NDArray[np.uint8]:
        """(h, w, 3) RGB. ``background``: RGB in [0, 1], or a photo (h, w, 3) uint8, resized.

        ``seed`` is that of the sensor's noise.
        """
        quality = quality or PhotoQuality()
        colour, coverage = self.cut_out(pose, lighting, quality.supersampling)
        behind = _background(background, pose.camera.width, pose.camera.height)
        return as_photographed(colour + (1.0 - coverage[..., None]) * behind, quality, seed)

    def close(self) -> None:
        """Free the graphics memory; the next picture takes it again."""
        self._renderer.close()


def as_photographed(
    picture: NDArray[np.floating], quality: PhotoQuality, seed: int
) -> NDArray[np.uint8]:
    """What lens and sensor make of a picture (h, w, 3) of display-encoded RGB in [0, 1]."""
    photo = 255.0 * picture
    if quality.blur_px > 0.0:
        photo = cv2.GaussianBlur(photo, (0, 0), quality.blur_px)
    if quality.noise > 0.0:
        photo = photo + np.random.default_rng(seed).normal(0.0, quality.noise, photo.shape)
    return np.clip(np.rint(photo), 0.0, 255.0).astype(np.uint8)


def _background(background: ArrayLike, width: int, height: int) -> NDArray[np.float32]:
    picture = np.asarray(background)
    if picture.ndim == 1:
        return picture.astype(np.float32)
    smaller = picture.shape[0] > height or picture.shape[1] > width
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    picture = picture.astype(np.float32) / np.float32(255.0)
    return np.asarray(cv2.resize(picture, (width, height), interpolation=how), np.float32)
