"""The software renderer's moments on the GPU, many poses at once.

Each caller waits in a greenlet of its own until all have asked: so descents and losses over several
photos are judged in batches, without a thread for each.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose, level_pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.gpu.device import GROUPS, gpu_device
from poseviewer.render.software.rasterise import GUARD_PX
from poseviewer.render.software.software_renderer import SoftwareRenderer, camera_numbers
from poseviewer.render.structure import MARGIN_PX, MODEL_NOISE
from poseviewer.render.types import Moments, PhotoAttributes

Item = TypeVar("Item")
Result = TypeVar("Result")
BATCH = 512
"""Items that are judged together."""


def ask(renderer: GpuRenderer, pose: Pose, photo: PhotoAttributes) -> Moments:
    """The moments at a pose, alone or, within ``run_together``, with those of the others."""
    from greenlet import getcurrent

    mine: Any = getcurrent()
    if getattr(mine, "asks", False):
        return mine.parent.switch((renderer, photo, pose))
    return renderer.moments_at([pose], photo)[0]


def run_together(
    function: Callable[[Any, Item], Result], renderer: Any, items: Sequence[Item]
) -> Iterator[Result]:
    """Yield ``function(renderer, item)`` of all items in their order, ``BATCH`` at a time."""
    for begin in range(0, len(items), BATCH):
        results: dict[int, Result] = {}

        def work(i: int, item: Item, results: dict[int, Result] = results) -> None:
            results[i] = function(renderer, item)

        batch = list(enumerate(items[begin : begin + BATCH]))
        waiting = _gone_on((_asker(work), item) for item in batch)
        while waiting:
            waiting = _gone_on(_answered(waiting))
        yield from (results[i] for i, _ in batch)


def _asker(work: Callable[..., None]) -> Any:
    from greenlet import greenlet

    asker: Any = greenlet(work)
    asker.asks = True
    return asker


def _gone_on(answers: Iterator[tuple[Any, tuple[Any, ...]]]) -> list[tuple[Any, Any]]:
    """Let each asker go on with its answer; those that ask again, with what they ask."""
    asked = [(asker, asker.switch(*answer)) for asker, answer in answers]
    return [(asker, question) for asker, question in asked if not asker.dead]


def _answered(waiting: Sequence[tuple[Any, Any]]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    questions: dict[Any, list[tuple[Any, Pose]]] = defaultdict(list)
    for asker, (renderer, photo, pose) in waiting:
        questions[renderer, photo].append((asker, pose))
    for (renderer, photo), asked in questions.items():
        found = renderer.moments_at([pose for _, pose in asked], photo)
        for (asker, _), moments in zip(asked, found, strict=True):
            yield asker, (moments,)


_log = logging.getLogger(__name__)
MOST_PIXELS = 1 << 23
"""Of the boxes of one submission: it takes 16 bytes of the GPU's memory for each."""
POSE = np.dtype(
    [
        ("camera", np.float32, 17),
        ("weighs", np.float32),
        ("box", np.int32, 4),
        ("at", np.uint32),
    ]
)
"""The shader's ``Pose``; the box is left, top, width, height."""
ONE, ATTRIBUTE = 9, 3
"""Slots of a pixel's values in the shader, from 0 on F: the 1 on the model, and M."""
ANY_CLASS, COUNT = 255, 254
"""In the place of a term's class: all pixels; the number of pixels, whatever they weigh."""


class GpuRenderer(SoftwareRenderer):
    """The software renderer, whose moments come from the GPU; pictures are its own.

    Poses whose box reaches behind the near plane are the software renderer's, too; and all are,
    once the GPU has failed.
    """

    def __init__(self, mesh: Mesh, two_sided: bool = True) -> None:
        """Upload the model; raises ``RendererUnavailableError`` where there is no GPU."""
        self.device = gpu_device()
        super().__init__(mesh, two_sided)
        self._buffers = self._uploaded()
        self._corners = np.array(list(product(*np.transpose(mesh.bounds))))

    def clone(self) -> GpuRenderer:
        """Another one for another thread, by the same memory of the GPU."""
        other = super().clone()
        assert isinstance(other, GpuRenderer)
        other.device, other._buffers, other._corners = self.device, self._buffers, self._corners
        return other

    @property
    def _kind(self) -> type[SoftwareRenderer]:
        return SoftwareRenderer if self.device.lost else GpuRenderer

    def culled(self, pose: Pose) -> GpuRenderer:
        """As ``clone``: to upload another model takes longer than to draw hidden faces."""
        del pose
        return self.clone()

    @property
    def together(self) -> Callable[..., Iterator[Any]] | None:
        """How a pool has many poses judged: at once; None where the GPU has failed."""
        return None if self.device.lost else run_together

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Joint moments, computed together with those that are asked for meanwhile."""
        return ask(self, pose, photo)

    def moments_at(self, poses: Sequence[Pose], photo: PhotoAttributes) -> list[Moments]:
        """The joint moments at each pose."""
        on_level = [level_pose(pose, photo.factor) for pose in poses]
        if any(photo.weights.shape != (p.camera.height, p.camera.width) for p in on_level):
            raise ValueError("the pose's camera and the photo differ in size")
        device, found = self.device, {}
        if not device.lost and not photo.colour_reflectance:
            try:
                found = self._on_device(on_level, photo)
            except device.errors as error:
                device.lost = True
                _log.warning(
                    "The GPU %s failed (%s); poseviewer goes on without it, on the processor.",
                    device.name,
                    " ".join(str(error).split())[:200],
                )
        return [
            found[i] if i in found else super(GpuRenderer, self).moments(pose, photo)
            for i, pose in enumerate(poses)
        ]

    def _on_device(self, poses: Sequence[Pose], photo: PhotoAttributes) -> dict[int, Moments]:
        """The moments of those poses, by their number, that the GPU can do."""
        sums = Sums.of(photo)
        margin = 0 if photo.structure is None else MARGIN_PX
        boxes = self._boxes(poses, margin)
        found: dict[int, Moments] = {}
        pixels = self.device.photo(photo, lambda: photo_pixels(photo))
        inputs = *self._buffers, pixels, self.device.upload(sums.terms)
        parameters = {
            "faces": len(self._surface.faces),
            "two_sided": int(self.two_sided),
            "levels": self._textures[1].shape[1],
            "photo_width": photo.weights.shape[1],
            "stride": photo.channels.shape[2] + (1 if photo.structure is None else 4),
            "channels": photo.channels.shape[2],
            "attributes": sums.attributes,
            "terms": len(sums.terms),
            "record": sums.attributes + len(sums.terms) + 2,
            "has_edges": int(photo.structure is not None),
            "noise": 64.0 * MODEL_NOISE**2,
        }
        for numbers in _batches(boxes):
            given = np.zeros(len(numbers), POSE)
            given["box"] = boxes[numbers]
            given["camera"] = [
                camera_numbers(poses[i], self._surface.centre, self._near) for i in numbers
            ]
            given["weighs"] = np.where(given["camera"][:, 16] > 0.0, 1.0, -1.0)
            areas = given["box"][:, 2].astype(np.int64) * given["box"][:, 3]
            given["at"] = np.cumsum(areas) - areas
            raw = self.device.sums(parameters, inputs, given, max(int(areas.sum()), 1))
            rotations = np.stack([poses[i].camera_from_model.rotation for i in numbers])
            found.update(zip(numbers, sums.moments(raw, rotations), strict=True))
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
        mesh, order, (texels, table) = self.mesh, self._surface.order, self._textures
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
        if batch and pixels + width * height > MOST_PIXELS:
            yield batch
            batch, pixels = [], 0
        batch.append(i)
        pixels += width * height
    if batch:
        yield batch


def photo_pixels(photo: PhotoAttributes) -> NDArray[np.float32]:
    """(height, width, stride): F about its origin and the weight, or F, weight, class and edges."""
    weights, channels = photo.weights[..., None], photo.channels
    if photo.structure is None:
        channels = channels - photo.origin.astype(np.float32)
    columns = [np.where(weights > 0.0, channels, np.float32(0.0)), weights]
    if photo.structure is not None:
        edges = np.moveaxis(photo.photo_moments.edges, 0, 2)
        columns += [photo.structure.labels[..., None], edges]
    return np.concatenate(columns, axis=2, dtype=np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """Which sums over the pixels the GPU gives, and the moments from them."""

    photo: PhotoAttributes
    attributes: int
    """Number of the model's attributes, but the last one that is 1 on it: 4, with a structure 6."""
    terms: NDArray[np.uint32]
    """(t, 3): two slots of a pixel's values whose product is summed, and of which class; first the
    number of pixels, then products of 1, M and F, then by class those of 1 and M.
    """
    pairs: NDArray[np.intp]
    """(2, s): which two of (1, M, F) the products are of."""

    @classmethod
    def of(cls, photo: PhotoAttributes) -> Sums:
        """Those that a photo needs."""
        attributes, channels = 4 if photo.structure is None else 6, photo.channels.shape[2]
        slots = [ONE, *(ATTRIBUTE + k for k in range(attributes)), *range(channels)]
        of_model = 1 + attributes
        pairs = [
            (i, j)
            for i, j in combinations_with_replacement(range(len(slots)), 2)
            if photo.clipped or min(i, j) < of_model
        ]
        terms = [(ONE, ONE, COUNT), *((slots[i], slots[j], ANY_CLASS) for i, j in pairs)]
        if photo.structure is not None:
            classes = range(len(photo.structure.shares))
            terms += [(ONE, slot, one) for one in classes for slot in slots[:of_model]]
        return cls(photo, attributes, np.array(terms, np.uint32), np.array(pairs).T)

    def moments(self, raw: NDArray[np.float32], rotations: FloatArray) -> list[Moments]:
        """Moments from the groups' sums (poses, groups, record), turned by ``rotations``."""
        photo, m, poses = self.photo, self.attributes, len(raw)
        numbers: FloatArray = np.asarray(raw, np.float64)
        origin, sums = numbers[..., :m], numbers[..., m : m + len(self.terms)]
        products, of_classes = np.split(sums[..., 1:], [self.pairs.shape[1]], axis=-1)
        size = 1 + m + photo.channels.shape[2]
        second = np.zeros((poses, GROUPS, size, size))
        second[..., self.pairs[0], self.pairs[1]] = products
        second[..., self.pairs[1], self.pairs[0]] = products
        # From 1, M and F about the group's own origin to those about 0, normals turned.
        shift = np.tile(np.eye(size), (poses, GROUPS, 1, 1))
        shift[..., 1 : 1 + m, 0] = origin
        shift[..., m - 2 : m + 1, :] = rotations[:, None] @ shift[..., m - 2 : m + 1, :]
        total = (shift @ second @ np.swapaxes(shift, -1, -2)).sum(axis=1)
        of_model = np.arange(1, 1 + m) if photo.clipped else np.r_[1 : 1 + m, 0]
        joint, weight, mean_of_photo = total[:, 1 + m :, of_model], total[:, 0, 0], photo.origin
        first_of_photo, second_of_photo = total[:, 0, 1 + m :], total[:, 1 + m :, 1 + m :]
        cosines, whitening = [None] * poses, None
        if photo.structure is not None:
            by_class = of_classes.reshape(poses, GROUPS, -1, 1 + m)
            by_class = (by_class @ np.swapaxes(shift[..., : 1 + m, : 1 + m], -1, -2)).sum(axis=1)
            joint = np.concatenate([joint, by_class[..., of_model]], axis=1)
            mean_of_photo = np.zeros(joint.shape[1])
            whitening = photo.photo_moments.whitening
            dots, squares = numbers[..., -2:].sum(axis=1).T
            cosines = [d / s**0.5 if s > 0.0 else 0.0 for d, s in zip(dots, squares, strict=True)]
        if not photo.clipped:
            whole, first_of_photo, second_of_photo = photo.photo_sums
            weight = np.full(poses, whole)
        n = joint.shape[1]
        mean = np.empty((poses, n + len(of_model)))
        covariance = np.empty((poses, *[n + len(of_model)] * 2))
        mean[:, :n], mean[:, n:] = first_of_photo, total[:, 0, of_model]
        covariance[:, :n, :n], covariance[:, :n, n:] = second_of_photo, joint
        covariance[:, n:, :n] = np.swapaxes(joint, 1, 2)
        covariance[:, n:, n:] = total[:, of_model[:, None], of_model]
        share = np.divide(1.0, weight, where=weight > 0.0, out=np.zeros(poses))
        mean *= share[:, None]
        covariance = share[:, None, None] * covariance - mean[:, :, None] * mean[:, None]
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        mean[:, :n] += (weight > 0.0)[:, None] * mean_of_photo
        mean.flags.writeable = covariance.flags.writeable = False
        pixels = sums[..., 0].sum(axis=1).astype(int).tolist()
        of_poses = zip(pixels, weight.tolist(), mean, covariance, cosines, strict=True)
        return [
            Moments(count, total_weight, first, second, n, cosine, whitening)
            for count, total_weight, first, second, cosine in of_poses
        ]
