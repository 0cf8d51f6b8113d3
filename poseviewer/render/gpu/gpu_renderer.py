"""The software renderer's moments on the GPU, many poses at once.

Threads that ask meanwhile wait for one of them, which asks the GPU for all: so descents and losses
over several photos are judged in batches.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.gpu.device import GROUPS, gpu_device
from poseviewer.render.software.rasterise import GUARD_PX
from poseviewer.render.software.software_renderer import SoftwareRenderer, camera_entries
from poseviewer.render.structure import MARGIN_PX
from poseviewer.render.types import Moments, PhotoAttributes

CALLERS = 128
"""Threads that ask at once, and so poses that are judged together."""

_log = logging.getLogger(__name__)
MAX_PIXELS = 1 << 23
"""Largest number of pixels in the boxes of a submission, 16 bytes of the GPU's memory each."""
POSE = np.dtype(
    [
        ("camera", np.float32, 17),
        ("weighs", np.float32),
        ("box", np.int32, 4),
        ("at", np.uint32),
    ]
)
"""The shader's ``Pose``; the box is left, top, width, height."""
MODEL = slice(3, 9)
"""M (R, G, B, grey times normal) among a pixel's values; F stands before it, 1 after it."""
PARTS = np.cumsum([6, 100, 1, 16 * 7])
"""Ends of a record's parts: M's origin, products, pixels, sums by class; two of edges are left."""


@dataclass(slots=True, eq=False)
class Question:
    """Moments that a thread asks for."""

    pose: Pose
    photo: PhotoAttributes
    answer: Moments | None = None


class GpuRenderer(SoftwareRenderer):
    """The software renderer, whose moments come from the GPU; pictures are its own.

    Poses whose box reaches behind the near plane are the software renderer's, too; and all are,
    once the GPU has failed.
    """

    def __init__(self, mesh: Mesh) -> None:
        """Upload the model; raises ``RendererUnavailableError`` where there is no GPU."""
        self.device = gpu_device()
        super().__init__(mesh)
        self._buffers = () if self.device.lost else self._uploaded()
        self._corners = np.array(list(product(*np.transpose(mesh.bounds))))
        self._questions: list[Question] = []
        self._answering = threading.Lock()

    def clone(self) -> GpuRenderer:
        """Another one for another thread, by the same memory of the GPU."""
        other = super().clone()
        assert isinstance(other, GpuRenderer)
        other.device = self.device
        other._buffers = self._buffers
        other._corners = self._corners
        other._questions, other._answering = [], threading.Lock()
        return other

    def cull(self, pose: Pose) -> GpuRenderer:
        """Clone: to upload another model takes longer than to draw hidden faces."""
        del pose
        return self.clone()

    @property
    def callers(self) -> int:
        """Number of threads that may ask for moments at once; 0 where the GPU has failed."""
        return 0 if self.device.lost else CALLERS

    def level_moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Joint moments, computed together with those that other threads ask for meanwhile."""
        question = Question(pose, photo)
        self._questions.append(question)
        with self._answering:
            if question.answer is None:
                others = [q for q in tuple(self._questions) if q.photo is photo]
                same = {question, *others}
                for one in others:
                    self._questions.remove(one)
                answers = self.moments_at([one.pose for one in same], photo)
                for one, answer in zip(same, answers, strict=True):
                    one.answer = answer
        assert question.answer is not None
        return question.answer

    def moments_at(self, poses: Sequence[Pose], photo: PhotoAttributes) -> list[Moments]:
        """The joint moments at each pose on the photo's own pyramid level."""
        device, found = self.device, {}
        if not device.lost and not photo.colour_reflectance:
            try:
                found = self._on_device(poses, photo)
            except device.errors as error:
                device.lost = True
                _log.warning(
                    "The GPU %s failed (%s); poseviewer goes on without it, on the processor.",
                    device.name,
                    " ".join(str(error).split())[:200],
                )
        return [
            found[i] if i in found else super(GpuRenderer, self).level_moments(pose, photo)
            for i, pose in enumerate(poses)
        ]

    def _on_device(self, poses: Sequence[Pose], photo: PhotoAttributes) -> dict[int, Moments]:
        """The moments of those poses, by their number, that the GPU can do."""
        margin = 0 if photo.structure is None else MARGIN_PX
        boxes = self._boxes(poses, margin)
        found: dict[int, Moments] = {}
        pixels = self.device.photo(photo, lambda: photo_pixels(photo))
        levels, width = self._textures.table.shape[1], photo.weights.shape[1]
        parameters = len(self._surface.faces), levels, width, photo.structure is not None
        for numbers in _batches(boxes):
            given = np.zeros(len(numbers), POSE)
            given["box"] = boxes[numbers]
            given["camera"] = [
                camera_entries(poses[i], self._surface.centre, self._near) for i in numbers
            ]
            given["weighs"] = np.where(given["camera"][:, 16] > 0.0, 1.0, -1.0)
            areas = given["box"][:, 2].astype(np.int64) * given["box"][:, 3]
            given["at"] = np.cumsum(areas) - areas
            inputs = *self._buffers, pixels
            raw = self.device.sums(parameters, inputs, given, max(int(areas.sum()), 1))
            rotations = np.stack([poses[i].camera_from_model.rotation for i in numbers])
            found.update(zip(numbers, moments_of_sums(photo, raw, rotations), strict=True))
        return found

    def _boxes(self, poses: Sequence[Pose], margin: int) -> NDArray[np.int64]:
        """(poses, 4): left, top, width, height of the model, px; -1 where it is too near."""
        rotations = np.stack([pose.camera_from_model.rotation for pose in poses])
        shifts = np.stack([pose.camera_from_model.translation for pose in poses])
        corners = np.einsum("pij,cj->pci", rotations, self._corners) + shifts[:, None]
        boxes = np.full((len(poses), 4), -1)
        for box, pose, points in zip(boxes, poses, corners, strict=True):
            camera = pose.camera
            if isinstance(camera, Perspective) and points[:, 2].min() <= 2.0 * self._near:
                continue
            seen = camera.project(points)
            if np.abs(seen).max() < 0.5 * GUARD_PX:
                size = np.array([camera.width, camera.height])
                low = np.clip(np.floor(seen.min(axis=0)) - 1 - margin, 0, size)
                high = np.clip(np.ceil(seen.max(axis=0)) + 1 + margin, low, size)
                box[:2], box[2:] = low, high - low
        return boxes

    def _uploaded(self) -> tuple[Any, ...]:
        """Vertices, faces, texels and their table in the GPU's memory."""
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
    """Numbers of the poses that have a box, as many together as a submission takes."""
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
    """(height, width, 7): F (a grey one three times), weight, class and edges."""
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
    """Moments from the groups' sums (poses, groups, record), normals turned by ``rotations``."""
    poses = len(raw)
    channels = photo.channels.shape[2]
    n = photo.photo_channels
    size = n + photo.model_channels
    origin, products, pixels, of_classes, edges = np.split(raw.astype(float), PARTS, axis=-1)
    # From values about the group's own origin to those about 0.
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
