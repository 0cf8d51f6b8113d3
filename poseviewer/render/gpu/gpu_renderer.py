"""The software renderer's moments on the GPU, many poses at once.

Threads that ask at the same time are served in one batch: one of them submits all poses to the GPU,
and the others wait for it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.attributes import Moments, PhotoAttributes
from poseviewer.render.gpu.device import GROUPS, gpu_device
from poseviewer.render.software.rasterise import GUARD_PX
from poseviewer.render.software.software_renderer import SoftwareRenderer, camera_entries
from poseviewer.render.structure import MARGIN_PX

CALLERS = 128
"""Threads that may ask at once, and so the number of poses in a batch."""

_log = logging.getLogger(__name__)
MAX_PIXELS = 1 << 23
"""Pixels in the boxes of a submission, at most; each takes 16 bytes of the GPU's memory."""
POSE = np.dtype(
    [("camera", np.float32, 17), ("weighs", np.float32), ("box", np.int32, 4), ("at", np.uint32)]
)
"""The shader's ``Pose``; the box is left, top, width, height."""
MODEL = slice(3, 9)
"""M (R, G, B, grey times normal) among a pixel's 10 values, between F and a constant 1."""
RECORD_ENDS = np.cumsum([6, 100, 1, 16 * 7])
"""Ends of a record's parts: M's origin, products, pixels, sums by class; then two of edges."""


@dataclass(slots=True, eq=False)
class MomentsRequest:
    """Moments that a thread waits for."""

    pose: Pose
    photo: PhotoAttributes
    result: Moments | None = None


class GpuRenderer(SoftwareRenderer):
    """The software renderer, with moments from the GPU.

    The software renderer still draws pictures, evaluates poses whose box reaches behind the near
    plane, and all poses once the GPU has failed.
    """

    def __init__(self, mesh: Mesh) -> None:
        """Upload the model.

        Raises:
            RendererUnavailableError: there is no GPU.
        """
        self.device = gpu_device()
        super().__init__(mesh)
        self._buffers = () if self.device.lost else self._upload_model()
        self._corners = np.array(list(product(*np.transpose(mesh.bounds))))
        self._requests: list[MomentsRequest] = []
        self._batch_lock = threading.Lock()

    def clone(self) -> GpuRenderer:
        """Make a renderer for another thread that shares the GPU's memory."""
        other = super().clone()
        assert isinstance(other, GpuRenderer)
        other.device = self.device
        other._buffers = self._buffers
        other._corners = self._corners
        other._requests, other._batch_lock = [], threading.Lock()
        return other

    def cull(self, pose: Pose) -> GpuRenderer:
        """Clone: uploading another model takes longer than drawing hidden faces."""
        del pose
        return self.clone()

    def cull_unseen(self, poses: Iterable[Pose]) -> GpuRenderer:
        """Clone, as ``cull`` does."""
        del poses
        return self.clone()

    @property
    def callers(self) -> int:
        """Number of threads that may ask for moments at once; 0 if the GPU has failed."""
        return 0 if self.device.lost else CALLERS

    def level_moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Compute the joint moments, in a batch with those of other threads."""
        own = MomentsRequest(pose, photo)
        self._requests.append(own)
        with self._batch_lock:
            if own.result is None:
                waiting = [one for one in tuple(self._requests) if one.photo is photo]
                batch = {own, *waiting}
                for request in waiting:
                    self._requests.remove(request)
                moments = self.moments_at([request.pose for request in batch], photo)
                for request, result in zip(batch, moments, strict=True):
                    request.result = result
        assert own.result is not None
        return own.result

    def moments_at(self, poses: Sequence[Pose], photo: PhotoAttributes) -> list[Moments]:
        """Compute the joint moments at each pose on the photo's own pyramid level."""
        device, by_pose = self.device, {}
        if not device.lost and not photo.colour_reflectance:
            try:
                by_pose = self._on_device(poses, photo)
            except device.errors as error:
                device.lost = True
                _log.warning(
                    "The GPU %s failed (%s); poseviewer goes on without it, on the processor.",
                    device.name,
                    " ".join(str(error).split())[:200],
                )
        return [
            by_pose[i] if i in by_pose else super(GpuRenderer, self).level_moments(pose, photo)
            for i, pose in enumerate(poses)
        ]

    def _on_device(self, poses: Sequence[Pose], photo: PhotoAttributes) -> dict[int, Moments]:
        """Moments of the poses that the GPU can evaluate, by their index."""
        margin = 0 if photo.structure is None else MARGIN_PX
        boxes = self._boxes(poses, margin)
        by_pose: dict[int, Moments] = {}
        pixels = self.device.photo(photo, lambda: photo_pixels(photo))
        levels, width = self._textures.table.shape[1], photo.weights.shape[1]
        parameters = len(self._surface.faces), levels, width, photo.structure is not None
        for indices in _batches(boxes):
            batch = np.zeros(len(indices), POSE)
            batch["box"] = boxes[indices]
            batch["camera"] = [
                camera_entries(poses[i], self._surface.centre, self._near) for i in indices
            ]
            batch["weighs"] = np.where(batch["camera"][:, 16] > 0.0, 1.0, -1.0)
            areas = batch["box"][:, 2].astype(np.int64) * batch["box"][:, 3]
            batch["at"] = np.cumsum(areas) - areas
            inputs = *self._buffers, pixels
            raw = self.device.sums(parameters, inputs, batch, max(int(areas.sum()), 1))
            rotations = np.stack([poses[i].linear for i in indices])
            by_pose.update(zip(indices, moments_of_sums(photo, raw, rotations), strict=True))
        return by_pose

    def _boxes(self, poses: Sequence[Pose], margin: int) -> NDArray[np.int64]:
        """(poses, 4): left, top, width, height of the model, px; -1 for a pose too near."""
        linear = np.stack([pose.linear for pose in poses])
        translations = np.stack([pose.camera_from_model.translation for pose in poses])
        corners = np.einsum("pij,cj->pci", linear, self._corners) + translations[:, None]
        boxes = np.full((len(poses), 4), -1)
        for box, pose, points in zip(boxes, poses, corners, strict=True):
            camera = pose.camera
            if isinstance(camera, Perspective) and points[:, 2].min() <= 2.0 * self._near:
                continue
            corners_px = camera.project(points)
            if np.abs(corners_px).max() < 0.5 * GUARD_PX:
                size = np.array([camera.width, camera.height])
                low = np.clip(np.floor(corners_px.min(axis=0)) - 1 - margin, 0, size)
                high = np.clip(np.ceil(corners_px.max(axis=0)) + 1 + margin, low, size)
                box[:2], box[2:] = low, high - low
        return boxes

    def _upload_model(self) -> tuple[Any, ...]:
        """Upload vertices, faces, texels and their table."""
        mesh = self.mesh
        order = self._surface.order
        (texels, table) = self._textures
        areas = self._texel_areas[order].astype(np.float32).view(np.int32)
        faces = np.column_stack([mesh.faces[order], mesh.face_texture[order], areas])
        corners = mesh.vertices - mesh.centre, mesh.normals, mesh.colours, mesh.uvs
        return (
            self.device.upload(np.column_stack(corners).astype(np.float32)),
            self.device.upload(faces.astype(np.int32)),
            self.device.upload(texels.astype(np.float32)),
            self.device.upload(table.astype(np.uint32)),
        )


def _batches(boxes: NDArray[np.int64]) -> Iterator[list[int]]:
    """Indices of the poses that have a box, in batches of one submission each."""
    batch, pixels = [], 0
    for i, (_, _, width, height) in enumerate(boxes.tolist()):
        if width < 0:
            continue
        if batch and pixels + width * height > MAX_PIXELS:
            yield batch
            batch, pixels = [], 0
        batch.append(i)
        pixels += width * height
    if batch:
        yield batch


def photo_pixels(photo: PhotoAttributes) -> NDArray[np.float32]:
    """(height, width, 7): F (grey repeated three times), weight, class and edges."""
    weights, pixels = photo.weights, np.zeros((*photo.weights.shape, 7), np.float32)
    origin = photo.origin[: photo.channels.shape[2]].astype(np.float32)
    pixels[..., :3] = np.where(weights[..., None] > 0.0, photo.channels - origin, np.float32(0.0))
    pixels[..., 3] = weights
    if photo.structure is not None:
        pixels[..., 4] = photo.structure.labels
        pixels[..., 5:] = np.moveaxis(photo.edge_target, 0, 2)
    return pixels


def moments_of_sums(
    photo: PhotoAttributes, raw: NDArray[np.float32], rotations: FloatArray
) -> list[Moments]:
    """Combine sums (poses, groups, record) of workgroups into moments, with normals rotated."""
    poses = len(raw)
    channels = photo.channels.shape[2]
    n = photo.photo_channels
    size = n + photo.model_channels
    origin, products, pixels, of_classes, edges = np.split(raw.astype(float), RECORD_ENDS, axis=-1)
    # The group's values are about an origin of its own: shift them to 0.
    shift = np.tile(np.eye(10), (poses, GROUPS, 1, 1))
    shift[..., MODEL, 9] = origin
    shift[..., 6:9, :] = rotations[:, None] @ shift[..., 6:9, :]
    second = shift @ products.reshape(poses, GROUPS, 10, 10) @ np.swapaxes(shift, -1, -2)
    total = second.sum(axis=1)
    model = np.eye(10)[3:9]
    if photo.structure is None:
        model = np.vstack([np.r_[np.zeros(3), GREY_WEIGHTS, np.zeros(4)], model[3:]])
    if not photo.clipped:
        model = np.vstack([model, np.eye(10)[9]])
    mean, covariance = np.zeros((poses, size)), np.zeros((poses, size, size))
    weight = total[:, 9, 9]
    mean[:, :channels], mean[:, n:] = total[:, 9, :channels], total[:, 9] @ model.T
    covariance[:, :channels, :channels] = total[:, :channels, :channels]
    covariance[:, :channels, n:] = total[:, :channels] @ model.T
    covariance[:, n:, n:] = model @ total @ model.T
    cosines, whitening = [None] * poses, None
    if photo.structure is not None:
        whitening = photo.photo_moments.photo_whitening
        by_class = of_classes.reshape(poses, GROUPS, 16, 7) @ np.swapaxes(
            shift[..., 3:, 3:], -1, -2
        )
        covariance[:, channels:n, n:] = by_class.sum(axis=1)[:, : n - channels]
        dots, squares = edges.sum(axis=1).T
        cosines = [d / s**0.5 if s > 0.0 else 0.0 for d, s in zip(dots, squares, strict=True)]
    if not photo.clipped:
        whole, mean[:, :n], covariance[:, :n, :n] = photo.photo_sums
        weight = np.full(poses, whole)
    covariance[:, n:, :n] = np.swapaxes(covariance[:, :n, n:], 1, 2)
    share = np.divide(1.0, weight, where=weight > 0.0, out=np.zeros(poses))
    mean *= share[:, None]
    covariance = share[:, None, None] * covariance - mean[:, :, None] * mean[:, None]
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    mean[:, :n] += (weight > 0.0)[:, None] * photo.origin
    mean.flags.writeable = covariance.flags.writeable = False
    counts = pixels.sum(axis=(1, 2)).astype(int).tolist()
    of_poses = zip(counts, weight.tolist(), mean, covariance, cosines, strict=True)
    return [Moments(*one[:4], n, one[4], whitening) for one in of_poses]
