"""The numba rasteriser as a ``Renderer``: everywhere, without a GPU or a display."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.colour import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render import kernel_attributes, kernel_coverage
from poseviewer.render.attributes import AttributeImage
from poseviewer.render.moments import Moments, PhotoAttributes
from poseviewer.render.texture import flatten_textures

NEAR_PER_DIAMETER = 1e-3
"""Nearer than this share of the model's diameter, nothing is drawn under perspective."""
VIEW_PX = 256
"""Side of the pictures from which the faces seen from outside are told."""

Box = tuple[int, int, int, int]


def kernels_are_compiled() -> bool:
    """Whether an earlier run left machine code for this version of the kernels."""
    source = Path(kernel_attributes.__file__)
    cached = Path(kernel_attributes.accumulate.stats.cache_path).glob(f"{source.stem}.*.nbi")
    return any(index.stat().st_mtime >= source.stat().st_mtime for index in cached)


class SoftwareRenderer:
    """The rasteriser with its buffers. Not for two threads at once: give each a ``clone``."""

    def __init__(self, mesh: Mesh, two_sided: bool = True) -> None:
        """``two_sided=False`` leaves out faces seen from behind (closed, well-wound meshes)."""
        texels, table = flatten_textures(mesh.textures)
        self.mesh = mesh
        self.two_sided = two_sided
        self._near = NEAR_PER_DIAMETER * mesh.diameter
        self._order = np.arange(len(mesh.faces), dtype=np.int32)
        vertex_data = np.concatenate([mesh.normals, mesh.colours, mesh.uvs], axis=1)
        self._surface = (
            mesh.faces,
            vertex_data.astype(np.float32),
            mesh.face_texture,
            texels,
            table,
        )
        self._allocate()
        self._draw_outside_first()

    def _allocate(self) -> None:
        count = len(self.mesh.vertices)
        self._homogeneous = np.empty((count, 4))
        self._snapped = np.empty((count, 2), np.int32)
        self._depth = np.empty((0, 0), np.float32)
        self._ids = np.empty((0, 0), np.int32)
        self._where = np.empty(kernel_attributes.RUN, np.int64)
        self._run = np.empty((0, kernel_attributes.RUN))

    def _draw_outside_first(self) -> None:
        """Put the faces that are seen from outside before those that others hide.

        It changes no picture (but which of two faces at the same depth is seen), and lets the
        rasteriser leave most of the inside of a car after one look at the depth buffer.
        """
        seen = np.zeros(len(self.mesh.faces), bool)
        for pose in _views_around(self.mesh):
            left, top, right, bottom = self._rasterise(pose)
            ids = self._ids[top:bottom, left:right]
            seen[ids[ids >= 0]] = True
        self._order = np.argsort(~seen, kind="stable").astype(np.int32)
        faces, vertex_data, face_texture, texels, table = self._surface
        self._surface = (
            np.ascontiguousarray(faces[self._order]),
            vertex_data,
            np.ascontiguousarray(face_texture[self._order]),
            texels,
            table,
        )
        faces, textures = self._surface[0], self._surface[2]
        colours = self.mesh.colours[faces]
        self._per_face = (
            self.mesh.normals[faces].reshape(-1, 9).astype(np.float32),
            np.all(colours == colours[:, :1], axis=(1, 2)) & (textures < 0),
        )

    def _run_for(self, channels: int) -> FloatArray:
        """Room for a run of pixels with n ``channels``."""
        if len(self._run) < channels + 17:
            self._run = np.empty((channels + 17, kernel_attributes.RUN))
        return self._run

    def clone(self) -> SoftwareRenderer:
        """Another renderer of the same mesh with buffers of its own, for another thread."""
        other = object.__new__(SoftwareRenderer)
        other.mesh, other.two_sided = self.mesh, self.two_sided
        other._near, other._surface = self._near, self._surface
        other._order, other._per_face = self._order, self._per_face
        other._allocate()
        return other

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre."""
        height, width = pose.camera.height, pose.camera.width
        box = self._rasterise(pose)
        reflectance = np.zeros((height, width, 3), np.float32)
        normals = np.zeros((height, width, 3), np.float32)
        rotation = pose.camera_from_model.rotation
        kernel_attributes.shade(
            box, self._ids, self._homogeneous, rotation, *self._surface, reflectance, normals
        )
        face_ids = np.full((height, width), -1, np.int32)
        left, top, right, bottom = box
        ids = self._ids[top:bottom, left:right]
        face_ids[top:bottom, left:right] = np.where(ids >= 0, self._order[ids], -1)
        return AttributeImage(face_ids, reflectance, normals)

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments, added up in the kernel: no picture of the attributes is made.

        Raises:
            ValueError: the pose's camera has another picture size than the photo.
        """
        if photo.weights.shape != (pose.camera.height, pose.camera.width):
            raise ValueError("the pose's camera and the photo differ in size")
        box = self._rasterise(pose)
        n = photo.channels.shape[2]
        size = n + photo.model_channels
        first, second = np.zeros(size), np.zeros((size, size))
        pixels, weight = kernel_attributes.accumulate(
            box,
            self._ids,
            self._homogeneous,
            *self._surface,
            *self._per_face,
            GREY_WEIGHTS,
            photo.channels,
            photo.weights,
            photo.origin,
            photo.model_channels,
            self._where,
            self._run_for(n),
            first,
            second,
        )
        if not photo.clipped:
            region = photo.region_sums
            weight = region.weight
            first[:n], second[:n, :n] = region.first, region.second
        second = np.tril(second) + np.tril(second, -1).T
        turn = _turn(pose.camera_from_model.rotation, n, size)
        first, second = turn @ first, turn @ second @ turn.T
        return Moments.from_sums(pixels, weight, first, second, photo.origin)

    def _rasterise(self, pose: Pose) -> Box:
        """Fill the id buffer inside the box that it returns; outside it, the buffer is stale."""
        camera = pose.camera
        if self._ids.shape != (camera.height, camera.width):
            self._depth = np.empty((camera.height, camera.width), np.float32)
            self._ids = np.empty((camera.height, camera.width), np.int32)
        perspective = isinstance(camera, Perspective)
        transform = pose.camera_from_model
        left, top, right, bottom, any_off = kernel_coverage.project(
            self.mesh.vertices,
            transform.rotation,
            transform.translation,
            _intrinsics(pose),
            perspective,
            self._near,
            self._homogeneous,
            self._snapped,
        )
        box = (0, 0, camera.width, camera.height)
        if not any_off:
            box = _pixel_box((left, top, right, bottom), camera.width, camera.height)
        kernel_coverage.clear(box, self._depth, self._ids)
        kernel_coverage.rasterise(
            self._homogeneous,
            self._snapped,
            self._surface[0],
            perspective,
            self._near,
            self.two_sided,
            self._depth,
            self._ids,
        )
        return box


def _views_around(mesh: Mesh) -> Iterator[Pose]:
    """The model filling a small picture, from its corners and from its sides."""
    scale = 0.9 * VIEW_PX / max(mesh.diameter, 1e-300)
    camera = Parallel(scale, VIEW_PX / 2, VIEW_PX / 2, VIEW_PX, VIEW_PX)
    for x, y, z in product((-1.0, 0.0, 1.0), repeat=3):
        if (x, y, z) == (0.0, 0.0, 0.0):
            continue
        rotation = Rotation.align_vectors([(0.0, 0.0, 1.0)], [(x, y, z)])[0].as_matrix()
        yield Pose(camera, RigidTransform(rotation, -rotation @ mesh.centre))


def _turn(rotation: FloatArray, channels: int, size: int) -> FloatArray:
    """(size, size): takes attributes with normals in the model's frame to the camera's."""
    turn = np.eye(size)
    for at in range(channels + 1, size - 2, 4):
        turn[at : at + 3, at : at + 3] = rotation
    return turn


def _intrinsics(pose: Pose) -> FloatArray:
    camera = pose.camera
    if isinstance(camera, Perspective):
        return np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    return np.array([camera.scale, camera.scale, camera.cx, camera.cy])


def _pixel_box(bounds: tuple[float, float, float, float], width: int, height: int) -> Box:
    """All pixels that the bounds touch, with a pixel to spare for snapping; empty if outside."""
    left = min(max(math.floor(bounds[0]) - 1, 0), width)
    top = min(max(math.floor(bounds[1]) - 1, 0), height)
    right = max(min(math.ceil(bounds[2]) + 1, width), left)
    bottom = max(min(math.ceil(bounds[3]) + 1, height), top)
    return left, top, right, bottom
