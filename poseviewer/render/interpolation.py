"""From the visible face of each pixel to its attributes, in NumPy: the plain, exact way.

A vertex at ``(x, y, z)`` in the camera frame has homogeneous picture coordinates
``h = (X, Y, W)`` with ``u = X / W``, ``v = Y / W`` and W = z, or 1 under parallel projection. For
the pixel centre ``p = (u, v, 1)`` the perspective-correct barycentrics are
``l_0 ~ det(p, h_1, h_2)`` and cyclic, normalised to the sum 1; their sum is ``det(h_0, h_1, h_2)``,
negative where the front of the face is seen (y runs down). They need no division by W, and so hold
for faces that reach behind the camera as well (M. Olano and T. Greer, *Triangle scan conversion
using 2D homogeneous coordinates*, 1997).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.texture import TexturePyramid, mip_levels
from poseviewer.render.types import AttributeImage


class AttributeInterpolator:
    """A mesh and its textures, ready to give the attributes of any picture of visible faces."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._pyramid = TexturePyramid.from_textures(mesh.textures)
        self._texel_areas = self._pyramid.texel_areas(mesh)

    def attributes(self, pose: Pose, face_ids: NDArray[np.int32]) -> AttributeImage:
        """The attributes of the faces (height, width), -1 for none, at the pixel centres."""
        rows, columns = np.nonzero(face_ids >= 0)
        faces = face_ids[rows, columns]
        reflectance = np.zeros((*face_ids.shape, 3), np.float32)
        normals = np.zeros((*face_ids.shape, 3), np.float32)
        if len(faces):
            visible, index = _distinct(faces, len(self.mesh.faces))
            corners = self._homogeneous_corners(pose, visible)
            centres = np.stack([columns, rows], axis=-1).astype(float) + 0.5
            shares, towards = _barycentrics(corners, index, centres)
            normals[rows, columns] = self._normals(pose, faces, shares, towards)
            levels = self._levels(corners, visible)[index]
            reflectance[rows, columns] = self._reflectance(faces, shares, levels)
        return AttributeImage(face_ids, reflectance, normals)

    def _homogeneous_corners(self, pose: Pose, faces: NDArray[np.intp]) -> FloatArray:
        points = pose.camera_from_model.apply(self.mesh.vertices[self.mesh.faces[faces]])
        return homogeneous(pose.camera, points)

    def _normals(
        self, pose: Pose, faces: NDArray[np.int32], shares: FloatArray, towards: FloatArray
    ) -> FloatArray:
        """(N, 3): unit, in the camera frame, turned to the side that is seen."""
        corners = self.mesh.normals[self.mesh.faces[faces]]
        normals = _weighted(shares, corners) @ pose.camera_from_model.rotation.T
        length = np.linalg.norm(normals, axis=1)
        scale = np.divide(towards, length, out=np.zeros_like(length), where=length > 0.0)
        return normals * scale[:, None]

    def _levels(self, corners: FloatArray, visible: NDArray[np.intp]) -> NDArray[np.int64]:
        """(F,): the mip level of each visible face."""
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = corners[..., :2] / np.where(corners[..., 2:] > 0.0, corners[..., 2:], np.nan)
            first, second = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
            pixels = np.abs(first[:, 0] * second[:, 1] - second[:, 0] * first[:, 1])
        return mip_levels(self._texel_areas[visible], pixels, self._pyramid.table.shape[1])

    def _reflectance(
        self, faces: NDArray[np.int32], shares: FloatArray, levels: NDArray[np.int64]
    ) -> FloatArray:
        """(N, 3): the vertex colours, times the texture where there is one."""
        corners = self.mesh.faces[faces]
        reflectance = _weighted(shares, self.mesh.colours[corners])
        texture = self.mesh.face_texture[faces]
        textured = np.flatnonzero(texture >= 0)
        if len(textured):
            uv = _weighted(shares[textured], self.mesh.uvs[corners[textured]])
            reflectance[textured] *= self._pyramid.sample(texture[textured], levels[textured], uv)
        return reflectance


def homogeneous(camera: Camera, points: FloatArray) -> FloatArray:
    """Points (..., 3) in the camera frame to (X, Y, W) (..., 3): the picture's (X / W, Y / W)."""
    x, y, z = np.moveaxis(points, -1, 0)
    if isinstance(camera, Perspective):
        return np.stack([camera.fx * x + camera.cx * z, camera.fy * y + camera.cy * z, z], axis=-1)
    u, v = camera.scale * x + camera.cx, camera.scale * y + camera.cy
    return np.stack([u, v, np.ones_like(z)], axis=-1)


def _distinct(faces: NDArray[np.int32], count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The distinct faces, in order, and the place of each entry among them (faster than unique)."""
    seen = np.zeros(count, bool)
    seen[faces] = True
    place = np.cumsum(seen) - 1
    return np.flatnonzero(seen), place[faces]


def _barycentrics(
    corners: FloatArray, index: NDArray[np.intp], centres: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Barycentrics (N, 3) of pixel centres (N, 2) in faces ``corners[index]``, (F, 3, 3) each.

    The second result (N,) is 1 where the front of the face is seen, -1 where its back is.
    """
    h = corners[index]
    x = h[..., 0] - centres[:, :1] * h[..., 2]
    y = h[..., 1] - centres[:, 1:] * h[..., 2]
    after, before = [1, 2, 0], [2, 0, 1]
    raw = x[:, after] * y[:, before] - x[:, before] * y[:, after]
    total = raw.sum(axis=1, keepdims=True)
    raw[total[:, 0] == 0.0] = 1.0  # exactly edge-on; only the rasteriser's rounding showed it
    # That rounding may also put the pixel centre just outside the exact face: stay on it.
    shares = np.maximum(raw * np.where(total < 0.0, -1.0, 1.0), 0.0)
    return shares / shares.sum(axis=1, keepdims=True), np.where(total[:, 0] > 0.0, -1.0, 1.0)


def _weighted(shares: FloatArray, corners: NDArray) -> FloatArray:
    """The mean of the corners' values (N, 3, k), weighted by (N, 3)."""
    a, b, c = shares[:, :1], shares[:, 1:2], shares[:, 2:]
    return a * corners[:, 0] + b * corners[:, 1] + c * corners[:, 2]
