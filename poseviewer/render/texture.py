"""Textures as one flat array of texels with mip levels, for NumPy and the kernels.

All renderers sample by one definition. At ``(u, v)``, v upwards and both wrapped around, a level of
``width x height`` texels is read bilinearly at ``x = (u - floor(u)) width - 0.5``,
``y = (1 - v + floor(v)) height - 0.5``. Texel (0, 0) is the upper left one, and neighbours are
taken modulo the size.

The level of a face is ``log2(sqrt(texel area / pixel area))`` of the whole face, rounded, so that a
texel is about as large as a pixel (L. Williams, *Pyramidal parametrics*, 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh

MAX_TEXTURE_SIDE_PX = 2048
"""Longest side of a texture, in px; larger ones are reduced to bound the memory."""


def _levels(texture: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
    """Box-filtered halvings of a texture down to one texel, the largest first."""
    level = np.asarray(texture, np.float32) / np.float32(255.0)
    shrink = min(1.0, MAX_TEXTURE_SIDE_PX / max(level.shape[:2]))
    if shrink < 1.0:
        level = _resize(level, round(level.shape[1] * shrink), round(level.shape[0] * shrink))
    levels = [level]
    while max(level.shape[:2]) > 1:
        level = _resize(level, level.shape[1] // 2, level.shape[0] // 2)
        levels.append(level)
    return levels


def _resize(image: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """Mean over the area of each new texel, also for odd sizes."""
    size = (max(1, width), max(1, height))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


def mip_levels(texel_areas: ArrayLike, pixel_areas: ArrayLike, count: int) -> NDArray[np.int64]:
    """Choose the levels (N,), in [0, count - 1], of faces by their areas (N,) in texels and in px.

    Faces seen edge-on get the last level, faces that reach behind the camera (nan) level 0.
    """
    texels = np.asarray(texel_areas, dtype=float)
    pixels = np.nan_to_num(np.asarray(pixel_areas, dtype=float), nan=np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(texels <= pixels, 1.0, texels / pixels)
        levels = np.floor(0.5 * np.log2(ratio) + 0.5)
    return np.minimum(levels, count - 1).astype(np.int64)


def double_areas(corners: FloatArray) -> FloatArray:
    """(F,): twice the areas of flat triangles (F, 3, 2)."""
    (x1, y1), (x2, y2) = (corners[:, k].T - corners[:, 0].T for k in (1, 2))
    return np.abs(x1 * y2 - x2 * y1)


class TexturePyramid(NamedTuple):
    """The textures of a mesh, to be sampled at many points at once."""

    texels: NDArray[np.float32]
    """(N, 3) in [0, 1]: all levels of all textures."""
    table: NDArray[np.int64]
    """(T, L, 3): ``(offset, width, height)`` of each level; smaller textures repeat their last
    level, of one texel."""

    @classmethod
    def of(cls, textures: Sequence[NDArray[np.uint8]]) -> TexturePyramid:
        """Make the levels of textures, each (h, w, 3) RGB."""
        pyramids = [_levels(texture) for texture in textures]
        count = max((len(levels) for levels in pyramids), default=1)
        table, offset = np.zeros((len(pyramids), count, 3), np.int64), 0
        blocks = [np.zeros((0, 3), np.float32)]
        for t, levels in enumerate(pyramids):
            for k, level in enumerate(levels):
                height, width = level.shape[:2]
                table[t, k:] = offset, width, height
                blocks.append(level.reshape(-1, 3))
                offset += width * height
        return cls(np.concatenate(blocks), table)

    def texel_areas(self, mesh: Mesh) -> FloatArray:
        """(F,): twice each face's area in texels of level 0; 0 for a face without texture."""
        areas = np.zeros(len(mesh.faces))
        textured = np.flatnonzero(mesh.face_texture >= 0)
        area = double_areas(mesh.uvs[mesh.faces[textured]].astype(float))
        size = self.table[mesh.face_texture[textured], 0, 1:]
        areas[textured] = area * size[:, 0] * size[:, 1]
        return areas

    def sample(self, texture: ArrayLike, level: ArrayLike, uv: ArrayLike) -> FloatArray:
        """Sample RGB (N, 3) in [0, 1] of textures (N,) at levels (N,) and coordinates (N, 2)."""
        entry = self.table[np.asarray(texture), np.asarray(level)]
        offset, size = entry[..., 0], entry[..., 1:]
        uv = np.asarray(uv, dtype=float)
        part = uv - np.floor(uv)
        part[..., 1] = 1.0 - part[..., 1]
        position = part * size - 0.5
        corner = np.floor(position)
        share = np.asarray(position - corner, dtype=np.float64)
        left, top = np.moveaxis(corner.astype(np.int64) % size, -1, 0)
        right, bottom = (left + 1) % size[..., 0], (top + 1) % size[..., 1]
        width = size[..., 0]
        fx, fy = share[..., :1], share[..., 1:]
        upper, lower = (
            (1.0 - fx) * self.texels[row + left] + fx * self.texels[row + right]
            for row in (offset + top * width, offset + bottom * width)
        )
        return (1.0 - fy) * upper + fy * lower
