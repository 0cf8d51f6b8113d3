"""Synthetic photographs with known poses, drawn by OpenGL, not by the fit's own rasteriser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl.renderer import clip_from_world

if TYPE_CHECKING:
    from poseviewer.render.opengl.shading import ShadedCanvas, Shading

FAR_EYE_PER_DIAMETER = 100.0
"""How far away highlights see the eye of a parallel camera, which has no place of its own."""
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
    """At most four."""

    def __post_init__(self) -> None:
        if len(self.lights) > 4:
            raise ValueError(f"{len(self.lights)} directional lights; at most 4 can be drawn")
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

    supersampling: int = 3
    """Each pixel is the mean of this number squared of smaller ones, each of 4 samples."""
    blur_px: float = 0.0
    """Standard deviation of a Gaussian blur."""
    noise: float = 0.0
    """Standard deviation of the sensor's noise, in grey levels of 255."""


class Photographer:
    """A model in a studio, to be photographed in many poses. One thread only, as ``opengl``."""

    def __init__(self, mesh: Mesh, shading: Shading = "diffuse") -> None:
        """``shading`` as ``render.opengl.shading.Shading``."""
        self.mesh = mesh
        self.shading: Shading = shading
        self._canvas: ShadedCanvas | None = None

    def cut_out(
        self, pose: Pose, lighting: LightSources, supersampling: int = 3, shadows: bool = False
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The picture before any background: RGB times coverage (h, w, 3), coverage (h, w).

        Both in [0, 1]. What is ``diffuse`` is ``reflectance (ambient + sum of intensity
        max(0, n.l))``, clamped, in display-encoded values.
        """
        camera = pose.camera
        rgba = self._draw(pose.scaled(supersampling), lighting, shadows)
        fine = rgba.astype(np.float32) / np.float32(255.0)
        size = (camera.width, camera.height)
        small = np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.float32)
        return small[..., :3], small[..., 3]

    def photograph(
        self,
        pose: Pose,
        lighting: LightSources,
        background: ArrayLike = (0.7, 0.7, 0.7),
        quality: PhotoQuality | None = None,
        shadows: bool = False,
        seed: int = 0,
    ) -> NDArray[np.uint8]:
        """(h, w, 3) RGB. ``background``: RGB in [0, 1], or a photo (h, w, 3) uint8, resized.

        ``seed`` is that of the sensor's noise.
        """
        quality = quality or PhotoQuality()
        colour, coverage = self.cut_out(pose, lighting, quality.supersampling, shadows)
        behind = _background(background, pose.camera.width, pose.camera.height)
        return as_photographed(colour + (1.0 - coverage[..., None]) * behind, quality, seed)

    def close(self) -> None:
        """Free the graphics memory; the next picture takes it again."""
        if self._canvas is not None:
            self._canvas.delete()
            self._canvas = None

    def _draw(self, pose: Pose, lighting: LightSources, shadows: bool) -> NDArray[np.uint8]:
        # Importing it makes the OpenGL context, which must not happen before it is wanted.
        from poseviewer.render.opengl.shading import ShadedCanvas

        mesh = self.mesh
        if self._canvas is None:
            self._canvas = ShadedCanvas(mesh, self.shading)
        clip = clip_from_world(mesh, pose)
        if clip is None:
            return np.zeros((pose.camera.height, pose.camera.width, 4), np.uint8)
        model_from_camera = pose.camera_from_model.inverse()
        eye = -FAR_EYE_PER_DIAMETER * mesh.diameter * model_from_camera.rotation[:, 2]
        if isinstance(pose.camera, Perspective):
            eye = model_from_camera.translation - mesh.centre
        return self._canvas.draw(
            (pose.camera.width, pose.camera.height),
            clip,
            eye,
            lighting.ambient,
            [(model_from_camera.rotation @ o.towards, o.intensity) for o in lighting.lights],
            shadows,
        )


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
