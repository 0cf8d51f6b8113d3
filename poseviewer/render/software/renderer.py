"""The numba rasteriser as a ``Renderer``: everywhere, without a GPU or a display."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.colour import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.pyramid.level_pose import level_pose
from poseviewer.render.software import (
    kernel_attributes,
    kernel_blocks,
    kernel_coverage,
    kernel_pose,
    kernel_visibility,
)
from poseviewer.render.software.clusters import make_clusters
from poseviewer.render.software.workspace import ClassRoom
from poseviewer.render.structure import BLUR_TAPS, MODEL_NOISE, PhotoStructure
from poseviewer.render.texture import TexturePyramid, flatten_textures
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes

NEAR_PER_DIAMETER = 1e-3
"""Nearer than this share of the model's diameter, nothing is drawn under perspective."""
VIEW_PX = 256
"""Side of the pictures from which the faces seen from outside are told."""

NEVER = -(1 << 30)
"""The number of the picture that faces were seen in which none has shown yet."""
NO_REGION = (False, 0.0, np.zeros(0), np.zeros((0, 0)))
CACHE_LINE = 64  # bytes

Box = tuple[int, int, int, int]


class SoftwareRenderer:
    """The rasteriser with its buffers. Not for two threads at once: give each a ``clone``."""

    def __init__(self, mesh: Mesh, two_sided: bool = True) -> None:
        """``two_sided=False`` leaves out faces seen from behind (closed, well-wound meshes)."""
        self.mesh = mesh
        self.two_sided = two_sided
        self._near = NEAR_PER_DIAMETER * mesh.diameter
        self._textures = flatten_textures(mesh.textures)
        self._texel_areas = TexturePyramid(*self._textures).texel_areas(mesh)
        self._surface = make_clusters(mesh, np.ones(len(mesh.faces), bool))
        self._allocate()
        self._surface = make_clusters(mesh, self._seen_from_outside())
        self._allocate()

    def _allocate(self) -> None:
        surface = self._surface
        faces, clusters = len(surface.faces), len(surface.cluster_box)
        planes = np.zeros((faces + 1, kernel_blocks.PLANE), np.float32)
        planes[:-1, kernel_blocks.GREY] = surface.colours[:-1] @ GREY_WEIGHTS
        varied, kinds = surface.kinds != kernel_blocks.PLAIN, -surface.kinds.astype(np.float32)
        planes[:-1, kernel_blocks.GREY][varied] = kinds[varied]
        paints = np.zeros((len(surface.paint), kernel_blocks.PAINT), np.float32)
        levels = np.zeros(faces + 1, np.int32)
        count_of_levels = self._textures[1].shape[1]
        painting = surface.kinds, surface.paint, self._texel_areas[surface.order]
        self._now = 0
        self._memory = np.full(faces + 1, NEVER, np.int32), np.full(clusters + 1, NEVER, np.int32)
        self._for_drawing = (
            np.zeros(clusters, np.bool_),
            np.empty(4, np.int32),
            np.empty(faces + 1, np.int32),
            np.empty((2, surface.vertices.shape[1]), np.int32),
            np.empty(surface.vertices.shape[1], np.float32),
            planes,
            (*painting, count_of_levels, paints, levels),
            kernel_coverage.make_room(),
        )
        self._shape = (
            surface.vertices,
            surface.faces,
            surface.corners,
            surface.cluster_start,
            surface.cluster_box,
        )
        colours = surface.colours.copy()
        colours[:-1][varied, 0] = kinds[varied]
        self._of_faces = planes, colours, bool(varied.any()), paints, levels
        self._attributes = (
            surface.vertices,
            surface.faces,
            surface.vertex_data,
            surface.face_texture,
        )
        self._make_picture(0, 0)

    def _make_picture(self, width: int, height: int) -> None:
        self._depth = _lined_up(height, _padded(width), np.float32, -np.inf)
        self._ids = _lined_up(height, _padded(width), np.int32, -1)
        tile = 1 << kernel_visibility.TILE_BITS
        tiles = np.empty((height // tile + 2, width // tile + 2), np.float32)
        self._room = *self._for_drawing, np.empty(_padded(width), np.float32), tiles
        self._normals = np.empty((3, width), np.float32)
        self._weighted = np.empty(width)
        self._paint = np.empty((3, width + 3), np.float32)
        self._run = np.empty((0, width), np.float32)
        self._drawn: Box = (0, 0, 0, 0)
        self._class_room: ClassRoom | None = None

    def _seen_from_outside(self) -> NDArray[np.bool_]:
        """(F,): the mesh's faces that others do not hide all around."""
        seen = np.zeros(len(self.mesh.faces), bool)
        for pose in _views_around(self.mesh):
            left, top, right, bottom = self._rasterise(pose)
            ids = self._ids[top:bottom, left:right]
            seen[self._surface.order[ids[ids >= 0]]] = True
        return seen

    def _run_for(self, channels: int) -> NDArray[np.float32]:
        """Room for a run of pixels with n ``channels``."""
        if len(self._run) < channels + 14:
            self._run = np.empty((channels + 14, self._run.shape[1]), np.float32)
        return self._run

    def clone(self) -> SoftwareRenderer:
        """Another renderer of the same mesh with buffers of its own, for another thread."""
        other = object.__new__(SoftwareRenderer)
        other.mesh, other.two_sided = self.mesh, self.two_sided
        other._near, other._surface = self._near, self._surface
        other._textures, other._texel_areas = self._textures, self._texel_areas
        other._allocate()
        return other

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre."""
        height, width = pose.camera.height, pose.camera.width
        box = self._rasterise(pose)
        reflectance = np.zeros((height, width, 3), np.float32)
        normals = np.zeros((height, width, 3), np.float32)
        self._shade(pose, box, reflectance, normals)
        face_ids = np.full((height, width), -1, np.int32)
        left, top, right, bottom = box
        surface, ids = self._surface, self._ids[top:bottom, left:right]
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
        pose = level_pose(pose, photo.factor)
        if photo.weights.shape != (pose.camera.height, pose.camera.width):
            raise ValueError("the pose's camera and the photo differ in size")
        if photo.structure is not None:
            return self._classes(pose, photo, photo.structure)
        box = self._rasterise(pose)
        n, region = photo.channels.shape[2], NO_REGION
        if not photo.clipped:
            sums = photo.region_sums
            region = True, sums.weight, sums.first, sums.second
        pixels, weight, mean, covariance = kernel_pose.sum_up(
            box,
            self._ids,
            self._of_faces,
            (self._attributes, self._camera, self._textures),
            GREY_WEIGHTS,
            (photo.planar, photo.weights),
            photo.origin,
            photo.model_channels,
            (self._normals, self._weighted, self._run_for(n), self._paint),
            region,
            pose.camera_from_model.rotation,
        )
        # They are ours alone: to freeze them here saves two copies for every pose.
        mean.flags.writeable = covariance.flags.writeable = False
        return Moments(pixels, weight, mean, covariance, n)

    def _classes(self, pose: Pose, photo: PhotoAttributes, structure: PhotoStructure) -> Moments:
        """The moments of classes, and the agreement of edges, from planes of the attributes."""
        box = self._rasterise(pose)
        fixed, room = photo.fixed_part, self._room_for(photo)
        pixels, mean, covariance, likeness, length = kernel_pose.compare(
            box,
            self._ids,
            self._of_faces,
            (self._attributes, self._camera, self._textures),
            GREY_WEIGHTS,
            (self._normals, self._weighted, self._run_for(0), self._paint),
            (room.spans, room.planes),
            (room.run, room.joint, room.second),
            (room.rows, room.across, fixed.edges),
            (photo.planar, structure.labels, photo.weights),
            (fixed.weight, fixed.mean, fixed.covariance),
            pose.camera_from_model.rotation,
            MODEL_NOISE,
            BLUR_TAPS,
        )
        mean.flags.writeable = covariance.flags.writeable = False
        cosine = likeness / length**0.5 if length > 0.0 else 0.0
        n = len(fixed.mean)
        return Moments(pixels, fixed.weight, mean, covariance, n, cosine, fixed.whitening)

    def _room_for(self, photo: PhotoAttributes) -> ClassRoom:
        height, width = photo.weights.shape
        size = photo.model_channels, photo.photo_channels
        room = self._class_room
        if room is None or room.planes.shape[1:] != (height + 2, width + 2) or room.size != size:
            room = self._class_room = ClassRoom(height, width, *size)
        return room

    def _shade(
        self,
        pose: Pose,
        box: Box,
        reflectance: NDArray[np.float32],
        normals: NDArray[np.float32],
    ) -> None:
        """Write what was rasterised last to pictures (height, width, 3)."""
        kernel_attributes.shade(
            box,
            self._ids,
            self._of_faces,
            pose.camera_from_model.rotation,
            (self._attributes, self._camera, self._textures),
            reflectance,
            normals,
        )

    def _rasterise(self, pose: Pose) -> Box:
        """Fill the id buffer; returns the box outside which it is empty."""
        self._look_from(pose)
        self._now += 1
        self._drawn = kernel_pose.rasterise(
            self._now,
            self._drawn,
            self._shape,
            self._camera,
            self._weighs(),
            self.two_sided,
            pose.camera.width,
            self._memory,
            self._room,
            (self._depth, self._ids),
        )
        return self._drawn

    def _look_from(self, pose: Pose) -> None:
        camera = pose.camera
        if self._ids.shape != (camera.height, _padded(camera.width)):
            self._make_picture(camera.width, camera.height)
        self._camera = _camera_numbers(pose, self._surface.centre, self._near)

    def _weighs(self) -> np.float32:
        """What a corner's depth value is multiplied by to weigh it: the distance of the centre.

        Negative in parallel projection, where all corners weigh the same.
        """
        distance, near = self._camera[11], self._camera[16]
        return np.float32(max(distance, near) if near > 0.0 else -1.0)


def _lined_up(height: int, width: int, kind: type, value: float) -> NDArray[Any]:
    """A buffer whose first entry starts a line of the processor's cache: so does each block."""
    size = height * width
    room = np.full(size + CACHE_LINE, value, kind)
    skip = -(room.ctypes.data // room.itemsize) % (CACHE_LINE // room.itemsize)
    return room[skip : skip + size].reshape(height, width)


def _padded(width: int) -> int:
    """The columns of a buffer whose rows are whole blocks."""
    return -(-width // kernel_blocks.BLOCK) * kernel_blocks.BLOCK


def _views_around(mesh: Mesh) -> Iterator[Pose]:
    """The model filling a small picture, from its corners and from its sides."""
    scale = 0.9 * VIEW_PX / max(mesh.diameter, 1e-300)
    camera = Parallel(scale, VIEW_PX / 2, VIEW_PX / 2, VIEW_PX, VIEW_PX)
    for x, y, z in product((-1.0, 0.0, 1.0), repeat=3):
        if (x, y, z) == (0.0, 0.0, 0.0):
            continue
        rotation = Rotation.align_vectors([(0.0, 0.0, 1.0)], [(x, y, z)])[0].as_matrix()
        yield Pose(camera, RigidTransform(rotation, -rotation @ mesh.centre))


def _camera_numbers(pose: Pose, centre: FloatArray, near: float) -> FloatArray:
    """(17,): the pose as the kernels take it, for vertices about ``centre``."""
    camera, transform = pose.camera, pose.camera_from_model
    numbers = np.empty(17)
    numbers[:9] = transform.rotation.ravel()
    numbers[9:12] = transform.rotation @ centre + transform.translation
    if isinstance(camera, Perspective):
        numbers[12:] = camera.fx, camera.fy, camera.cx, camera.cy, max(near, 1e-300)
    else:
        numbers[12:] = camera.scale, camera.scale, camera.cx, camera.cy, 0.0
    return numbers
