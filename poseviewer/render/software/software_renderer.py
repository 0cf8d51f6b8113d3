"""Numba rasteriser as a ``Renderer``: runs everywhere, without a GPU or a display."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import AttributeImage, Moments, PhotoAttributes, Renderer
from poseviewer.render.moments import moments_of_images
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.software import rasterise, shade, sums
from poseviewer.render.software.blocks import BLOCK
from poseviewer.render.software.raster_surface import Surface, face_order, make_surface
from poseviewer.render.structure import BLUR_TAPS, MODEL_NOISE, PhotoStructure
from poseviewer.render.texture import TexturePyramid

NEAR_PER_DIAMETER = 1e-3
"""Share of the model's diameter nearer than which nothing is drawn under perspective."""
VIEW_PX = 256
"""Side of the pictures by which faces are seen from outside."""
CULLED_PX = 1
"""Image motion up to which culled faces stay hidden, that of a search's end."""
NO_REGION = (False, 0.0, np.zeros(0), np.zeros((0, 0)))
"""Region of photos that are clipped to the model."""
CACHE_LINE_BYTES = 64
"""Alignment of blocks of pixels."""

Box = tuple[int, int, int, int]


class SoftwareRenderer(Renderer):
    """Renderer with its buffers. Not for two threads at once: give each a ``clone``."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._near = NEAR_PER_DIAMETER * mesh.diameter
        self._textures = TexturePyramid.of(mesh.textures)
        self._texel_areas = self._textures.texel_areas(mesh)
        self._allocate(make_surface(mesh, face_order(mesh, np.ones(len(mesh.faces), bool))))
        self._allocate(make_surface(mesh, face_order(mesh, self._outer_faces())))

    def clone(self) -> SoftwareRenderer:
        """Return another renderer of the same mesh, for another thread."""
        return self._with(self._surface)

    def cull(self, pose: Pose) -> SoftwareRenderer:
        """Return a renderer without faces hidden at a pose, for poses within ``CULLED_PX``."""
        return self._with(
            make_surface(self.mesh, self._surface.order[~self._find_hidden_faces(pose)])
        )

    def cull_unseen(self, poses: Iterable[Pose]) -> SoftwareRenderer:
        """Return a renderer without faces that none of some poses shows, nor their neighbours."""
        faces, near = self._surface.faces, np.zeros(self._surface.vertices.shape[1], bool)
        near[faces[self._find_seen_faces(poses)]] = True
        kept = near[faces].any(axis=1)
        return self._with(make_surface(self.mesh, self._surface.order[kept if kept.any() else ...]))

    def decimate(self, faces: int) -> SoftwareRenderer:
        """Return a renderer of the model with at most this number of triangles, or as it is."""
        if len(self.mesh.faces) <= faces:
            return self.clone()
        return _simplify(type(self), self.mesh, faces).clone()

    def render(self, pose: Pose) -> AttributeImage:
        """Draw faces, reflectance and normals at every pixel centre."""
        size, rotation = (pose.camera.height, pose.camera.width), pose.linear
        reflectance, normals = np.zeros((*size, 3), np.float32), np.zeros((*size, 3), np.float32)
        shade.shade(*self._draw(pose), rotation, reflectance, normals)
        left, top, right, bottom = self._drawn
        face_ids = np.full(size, -1, np.int32)
        ids = self._ids[top:bottom, left:right]
        face_ids[top:bottom, left:right] = np.where(ids >= 0, self._surface.order[ids], -1)
        return AttributeImage(face_ids, reflectance, normals)

    def render_mask(self, pose: Pose) -> NDArray[np.bool_]:
        """Return (height, width): where the model is seen, sooner than ``render`` does."""
        self._rasterise(pose)
        return self._ids[:, : pose.camera.width] >= 0

    def depth(self, pose: Pose) -> NDArray[np.float32]:
        """Return (height, width): z in the camera, in the model's unit; inf beside the model."""
        self._rasterise(pose)
        values = self._depth[:, : pose.camera.width]  # 1 / z, or -z in parallel projection
        if isinstance(pose.camera, Parallel):
            return -values
        depth = np.full(values.shape, np.inf, np.float32)
        return np.divide(np.float32(1.0), values, out=depth, where=values > 0.0)

    def level_moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Compute joint moments in the kernel, or by pictures for ``colour_reflectance``."""
        if photo.colour_reflectance:
            return moments_of_images(self.render(pose), photo)
        if photo.structure is not None:
            return self._structure_moments(pose, photo, photo.structure)
        region = NO_REGION if photo.clipped else (True, *photo.photo_sums)
        of_photo = (photo.planar, photo.weights), photo.origin, photo.model_channels
        rotation, n = pose.linear, photo.channels.shape[2]
        pixels, weight, mean, covariance = sums.moments(
            *self._draw(pose), *of_photo, region, rotation
        )
        # To freeze them here saves two copies for every pose.
        mean.flags.writeable = covariance.flags.writeable = False
        return Moments(pixels, weight, mean, covariance, n)

    def _structure_moments(
        self, pose: Pose, photo: PhotoAttributes, structure: PhotoStructure
    ) -> Moments:
        fixed, rotation = photo.photo_moments, pose.linear
        of_photo = photo.planar, structure.labels, len(structure.class_weights), photo.weights
        visible = self._draw(pose)
        if self._kept is None:
            height, width = photo.weights.shape
            planes = np.zeros((shade.PLANES, height + 2, width + 2), np.float32)
            across = np.empty((2, height, width), np.float32)
            self._kept = np.zeros((height, 2), np.int64), planes, across
        edges = photo.edge_target, rotation, MODEL_NOISE, BLUR_TAPS, self._kept
        pixels, joint, second, dot, square = sums.structure_sums(*visible, of_photo, *edges)
        (n, m), share = joint.shape, 1.0 / fixed.weight if fixed.weight > 0.0 else 0.0
        mean, covariance = np.empty(n + m), np.empty((n + m, n + m))
        # The last attribute of M is 1 on the model, so its row of ``M M^T`` is the sum of M.
        mean[:n], mean[n:] = fixed.mean, share * second[-1]
        covariance[:n, :n] = fixed.covariance
        covariance[:n, n:] = share * joint - np.multiply.outer(mean[:n], mean[n:])
        covariance[n:, :n] = covariance[:n, n:].T
        covariance[n:, n:] = share * second - np.multiply.outer(mean[n:], mean[n:])
        mean.flags.writeable = covariance.flags.writeable = False
        cosine = dot / square**0.5 if square > 0.0 else 0.0
        return Moments(pixels, fixed.weight, mean, covariance, n, cosine, fixed.photo_whitening)

    def _with(self, surface: Surface) -> SoftwareRenderer:
        """Return another renderer of the same mesh, of which it draws the ``surface``."""
        other = object.__new__(type(self))
        other.mesh, other._near = self.mesh, self._near
        other._textures, other._texel_areas = self._textures, self._texel_areas
        other._allocate(surface)
        return other

    def _find_hidden_faces(self, pose: Pose) -> NDArray[np.bool_]:
        """Find faces (F,) that show nowhere, all corners behind what is seen near by."""
        left, top, right, bottom = self._rasterise(pose)
        screen, depths = self._workspace[:2]
        columns, rows = screen // rasterise.SUBPIXELS - np.array([[left], [top]])
        free = (columns < 0) | (rows < 0) | (columns >= right - left) | (rows >= bottom - top)
        inside = np.flatnonzero(~free)
        if len(inside):
            side = 2 * CULLED_PX + 1
            depth = np.ascontiguousarray(self._depth[top:bottom, left:right])
            farthest = cv2.erode(depth, np.ones((side, side), np.uint8))
            free[inside] = depths[inside] >= farthest[rows[inside], columns[inside]]
        hidden = ~free[self._surface.faces].any(axis=1)
        ids = self._ids[top:bottom, left:right]
        hidden[ids[ids >= 0]] = False
        return hidden

    def _allocate(self, surface: Surface) -> None:
        """Make the kernels' arrays for a surface, see ``rasterise`` and ``shade``."""
        self._surface, count_of_levels = surface, self._textures.table.shape[1]
        faces, vertices = len(surface.faces), surface.vertices.shape[1]
        planes = np.zeros((faces + 1, rasterise.PLANE), np.float32)
        varyings = np.zeros((len(surface.attributes), rasterise.VARYING), np.float32)
        levels = np.zeros(faces + 1, np.int32)
        colours = surface.colours.copy()
        planes[:-1, rasterise.GREY] = colours[:-1] @ GREY_WEIGHTS
        varied, kinds = surface.kinds != rasterise.PLAIN, -surface.kinds.astype(np.float32)
        planes[:-1, rasterise.GREY][varied] = colours[:-1, 0][varied] = kinds[varied]
        shading = surface.kinds, surface.attributes, self._texel_areas[surface.order]
        self._workspace = (
            np.empty((2, vertices), np.int32),
            np.empty(vertices, np.float32),
            np.empty(faces, np.int32),
            planes,
            (*shading, count_of_levels, varyings, levels),
        )
        self._of_faces = planes, colours, bool(varied.any()), varyings, levels
        self._of_textures = surface.colours, surface.face_texture, *self._textures
        self._make_picture(0, 0)

    def _make_picture(self, width: int, height: int) -> None:
        self._size = width, height
        self._depth = _make_aligned(height, width, np.float32, -np.inf)
        self._ids = _make_aligned(height, width, np.int32, -1)
        self._drawn: Box = (0, 0, 0, 0)
        self._kept: tuple[NDArray[Any], ...] | None = None
        """Workspace of ``structure_sums``, kept from pose to pose."""

    def _draw(self, pose: Pose) -> tuple[Any, ...]:
        """Draw a pose; returns the first arguments of kernels that read the picture."""
        self._rasterise(pose)
        return self._drawn, self._ids, self._of_faces, self._of_textures

    def _rasterise(self, pose: Pose) -> Box:
        """Fill the picture; returns the box outside which it is empty."""
        camera = pose.camera
        if self._size != (camera.width, camera.height):
            self._make_picture(camera.width, camera.height)
        self._drawn = rasterise.rasterise(
            self._drawn,
            (self._surface.vertices, self._surface.faces, self._surface.normals),
            camera_entries(pose, self._surface.centre, self._near),
            camera.width,
            self._workspace,
            (self._depth, self._ids),
        )
        return self._drawn

    def _outer_faces(self) -> NDArray[np.bool_]:
        """Find the mesh's faces (F,) that others do not hide all around."""
        outer = np.zeros(len(self.mesh.faces), bool)
        outer[self._surface.order[self._find_seen_faces(_views_around(self.mesh))]] = True
        return outer

    def _find_seen_faces(self, poses: Iterable[Pose]) -> NDArray[np.bool_]:
        """Find the surface's faces (F,) that at least one pose shows."""
        seen = np.zeros(len(self._surface.faces), bool)
        for pose in poses:
            left, top, right, bottom = self._rasterise(pose)
            ids = self._ids[top:bottom, left:right]
            seen[ids[ids >= 0]] = True
        return seen


def _make_aligned(height: int, width: int, kind: type, value: float) -> NDArray[Any]:
    """Make a picture whose rows are whole blocks, each of which starts a line of the cache."""
    width = -(-width // BLOCK) * BLOCK
    size = height * width
    buffer = np.full(size + CACHE_LINE_BYTES, value, kind)
    skip = -(buffer.ctypes.data // buffer.itemsize) % (CACHE_LINE_BYTES // buffer.itemsize)
    return buffer[skip : skip + size].reshape(height, width)


def _views_around(mesh: Mesh) -> Iterator[Pose]:
    """Yield poses at which the model fills a small picture, from its corners and sides."""
    scale = 0.9 * VIEW_PX / max(mesh.diameter, 1e-300)
    camera = Parallel(scale, VIEW_PX / 2, VIEW_PX / 2, VIEW_PX, VIEW_PX)
    for direction in filter(any, product((-1.0, 0.0, 1.0), repeat=3)):
        rotation = Rotation.align_vectors([(0.0, 0.0, 1.0)], [direction])[0].as_matrix()
        yield Pose(camera, RigidTransform(rotation, -rotation @ mesh.centre))


def camera_entries(pose: Pose, centre: FloatArray, near: float) -> FloatArray:
    """Return the pose as kernels take it (CAMERA,), for vertices about ``centre``."""
    camera, linear = pose.camera, pose.linear
    numbers = np.empty(rasterise.CAMERA)
    numbers[: rasterise.TRANSLATION] = linear.ravel()
    shift = linear @ centre + pose.camera_from_model.translation
    numbers[rasterise.TRANSLATION : rasterise.FOCAL] = shift
    if isinstance(camera, Perspective):
        numbers[rasterise.FOCAL :] = camera.fx, camera.fy, camera.cx, camera.cy, max(near, 1e-300)
    else:
        numbers[rasterise.FOCAL :] = camera.scale, camera.scale, camera.cx, camera.cy, 0.0
    return numbers


@lru_cache(maxsize=8)
def _simplify(kind: type[SoftwareRenderer], mesh: Mesh, faces: int) -> SoftwareRenderer:
    return kind(simplify(mesh, faces))
