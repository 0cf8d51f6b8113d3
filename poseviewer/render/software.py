"""The numba rasteriser as a ``Renderer``: everywhere, without a GPU or a display."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.colour import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render import kernel_attributes, kernel_buffers, kernel_coverage
from poseviewer.render.attributes import AttributeImage
from poseviewer.render.clusters import make_clusters
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
        self.mesh = mesh
        self.two_sided = two_sided
        self._near = NEAR_PER_DIAMETER * mesh.diameter
        self._textures = flatten_textures(mesh.textures)
        self._surface = make_clusters(mesh, np.ones(len(mesh.faces), bool))
        self._allocate()
        self._surface = make_clusters(mesh, self._seen_from_outside())
        self._allocate()

    def _allocate(self) -> None:
        count = len(self._surface.vertices)
        self._homogeneous = np.empty((count, 4))
        self._snapped = np.empty((count, 2), np.int32)
        self._likely = np.zeros(len(self._surface.cluster_box), np.int8)
        self._where = np.empty(kernel_attributes.RUN, np.int64)
        self._run = np.empty((0, kernel_attributes.RUN))
        self._make_picture(0, 0)

    def _make_picture(self, width: int, height: int) -> None:
        self._depth = np.full((height, _padded(width)), -np.inf, np.float32)
        self._ids = np.full((height, _padded(width)), -1, np.int32)
        tile = 1 << kernel_coverage.TILE_BITS
        self._tiles = np.empty((height // tile + 2, width // tile + 2), np.float32)
        self._drawn: Box = (0, 0, 0, 0)

    def _seen_from_outside(self) -> NDArray[np.bool_]:
        """(F,): the mesh's faces that others do not hide all around."""
        seen = np.zeros(len(self.mesh.faces), bool)
        for pose in _views_around(self.mesh):
            left, top, right, bottom = self._rasterise(pose)
            ids = self._ids[top:bottom, left:right]
            seen[self._surface.order[ids[ids >= 0]]] = True
        return seen

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
        other._textures = self._textures
        other._allocate()
        return other

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre."""
        height, width = pose.camera.height, pose.camera.width
        box = self._rasterise(pose)
        reflectance = np.zeros((height, width, 3), np.float32)
        normals = np.zeros((height, width, 3), np.float32)
        rotation = pose.camera_from_model.rotation
        surface = self._surface
        kernel_attributes.shade(
            box,
            self._ids,
            self._homogeneous,
            rotation,
            surface.faces,
            surface.vertex_data,
            surface.face_texture,
            *self._textures,
            reflectance,
            normals,
        )
        face_ids = np.full((height, width), -1, np.int32)
        left, top, right, bottom = box
        ids = self._ids[top:bottom, left:right]
        face_ids[top:bottom, left:right] = np.where(ids >= 0, surface.order[ids], -1)
        return AttributeImage(face_ids, reflectance, normals)

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen, and nothing about it: what is quickest."""
        covered = np.zeros((pose.camera.height, pose.camera.width), bool)
        left, top, right, bottom = self._rasterise(pose)
        part = slice(top, bottom), slice(left, right)
        covered[part] = self._ids[part] >= 0
        return covered

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments, added up in the kernel: no picture of the attributes is made.

        Raises:
            ValueError: the pose's camera has another picture size than the photo.
        """
        if photo.weights.shape != (pose.camera.height, pose.camera.width):
            raise ValueError("the pose's camera and the photo differ in size")
        box = self._rasterise(pose)
        surface, n = self._surface, photo.channels.shape[2]
        size = n + photo.model_channels
        first, second = np.zeros(size), np.zeros((size, size))
        pixels, weight = kernel_attributes.accumulate(
            box,
            self._ids,
            self._homogeneous,
            surface.faces,
            surface.vertex_data,
            surface.face_texture,
            *self._textures,
            surface.face_data,
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
        """Fill the id buffer; returns the box outside which it is empty."""
        camera, surface = pose.camera, self._surface
        if self._ids.shape != (camera.height, _padded(camera.width)):
            self._make_picture(camera.width, camera.height)
        else:
            kernel_buffers.clear(
                self._drawn, kernel_coverage.CLUSTER_BITS, self._depth, self._ids, self._likely
            )
        self._drawn = kernel_coverage.draw(
            surface.vertices,
            surface.faces,
            surface.cluster_start,
            surface.cluster_box,
            _camera_numbers(pose, self._near),
            self.two_sided,
            self._likely,
            self._homogeneous,
            self._snapped,
            self._tiles,
            self._depth,
            self._ids,
            camera.width,
        )
        return self._drawn


def _padded(width: int) -> int:
    """The columns of a buffer whose rows are whole blocks."""
    return -(-width // kernel_coverage.BLOCK) * kernel_coverage.BLOCK


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


def _camera_numbers(pose: Pose, near: float) -> FloatArray:
    """(17,): the pose as ``kernel_coverage.draw`` takes it."""
    camera, transform = pose.camera, pose.camera_from_model
    if isinstance(camera, Perspective):
        numbers = (camera.fx, camera.fy, camera.cx, camera.cy, max(near, 1e-300))
    else:
        numbers = (camera.scale, camera.scale, camera.cx, camera.cy, 0.0)
    return np.array([*transform.rotation.flat, *transform.translation, *numbers])
