"""Attributes of photo and model, their moments, and the interface of renderers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.geometry.linear_algebra import canonical_correlations_squared, whiten
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.structure import PhotoStructure


class PhotoSums(NamedTuple):
    """Sums of the photo's attributes over the whole region, about the photo's ``origin``."""

    weight: float
    first: FloatArray
    """(n,): sum of ``w (F - origin)``."""
    second: FloatArray
    """(n, n): sum of ``w (F - origin)(F - origin)^T``."""


@dataclass(frozen=True, eq=False)
class PhotoAttributes:
    """Attributes F of a photo, and the pixels P over which they are compared."""

    channels: NDArray[np.float32]
    """(height, width, n): F, grey (n = 1) or RGB (n = 3)."""
    weights: NDArray[np.float32]
    """(height, width): weight of each pixel, 0 outside the region."""
    clipped: bool = True
    """Whether P is the part of the region that the model covers. If not, P is the whole region: the
    model's attributes are 0 beside it, and one more attribute is 1 on the model."""
    colour_reflectance: bool = False
    """Whether the model's attributes are k and k n for each of R, G and B (12). If not, they are k
    and k n of grey (4), or with a ``structure`` the three colours and k n of grey (6)."""
    structure: PhotoStructure | None = None
    """Classes and edges: F has the memberships in K classes beside ``channels``, and edges are
    compared, over the whole region (not clipped). None: colours alone."""
    factor: int = 1
    """Factor by which ``channels`` are reduced from the photo of the poses."""

    def __post_init__(self) -> None:
        # Planar in memory, as the kernels read them.
        planar = np.moveaxis(np.asarray(self.channels), -1, 0)
        planar = freeze_array(planar, (-1, -1, -1), np.float32)
        _, height, width = planar.shape
        object.__setattr__(self, "channels", np.moveaxis(planar, 0, 2))
        object.__setattr__(self, "weights", freeze_array(self.weights, (height, width), np.float32))

    @cached_property
    def planar(self) -> NDArray[np.float32]:
        """(n, height, width): F, contiguous in memory."""
        return np.moveaxis(self.channels, 2, 0)

    @cached_property
    def origin(self) -> FloatArray:
        """(n,): point about which sums are taken: the mean of F, or 0 with a ``structure``."""
        if self.structure is not None:
            return np.zeros(self.photo_channels)
        total = float(self.weights.sum(dtype=float))
        sums = np.einsum("vu,vun->n", self.weights, self.channels, dtype=float)
        return sums / total if total > 0.0 else np.zeros_like(sums)

    @cached_property
    def photo_sums(self) -> PhotoSums:
        """Sums of F over the whole region."""
        if self.structure is not None:
            sums = self.structure.sums(self.channels, self.weights)
            return PhotoSums(float(self.structure.class_weights.sum()), *sums)
        first, n = [], self.channels.shape[2]
        second = np.zeros((n, n))
        for weights, rows in zip(self.weights, self.channels, strict=True):
            centred = rows.astype(float) - self.origin
            weighted = weights[:, None] * centred
            first.append(weighted.sum(axis=0))
            second += weighted.T @ centred
        return PhotoSums(float(self.weights.sum(dtype=float)), np.sum(first, axis=0), second)

    @cached_property
    def photo_moments(self) -> Moments:
        """Moments of F alone, the same for all poses with a ``structure``."""
        weight, first, second = self.photo_sums
        share = 1.0 / weight if weight > 0.0 else 0.0
        mean = share * first
        covariance = share * second - np.outer(mean, mean)
        whitening = whiten(covariance, mean)
        return Moments(0, weight, mean, covariance, len(mean), photo_whitening=whitening)

    @cached_property
    def edge_target(self) -> NDArray[np.float32]:
        """(2, height, width): the photo's orientation field times the weights."""
        assert self.structure is not None
        weighted = self.weights[..., None] * self.structure.field
        return np.ascontiguousarray(np.moveaxis(weighted, 2, 0))

    @property
    def photo_channels(self) -> int:
        """n, the number of attributes of the photo."""
        classes = 0 if self.structure is None else len(self.structure.class_weights)
        return self.channels.shape[2] + classes

    @property
    def model_channels(self) -> int:
        """m, the number of attributes of the model: 4, 6 or 12, and 1 more if not clipped."""
        grey = 4 if self.structure is None else 6
        return (12 if self.colour_reflectance else grey) + (not self.clipped)

    @property
    def correlations(self) -> int:
        """min(n, m), the number of canonical correlations of F and M."""
        return min(self.photo_channels, self.model_channels)


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """First and second moments of the attributes (F, M) over the pixels P."""

    pixels: int
    """Number of pixels of weight > 0 that the model covers."""
    weight: float
    """Sum of the weights over P."""
    mean: FloatArray
    """(n + m,): weighted means, F first."""
    covariance: FloatArray
    """(n + m, n + m): weighted covariances, normalised by ``weight``; symmetric."""
    photo_channels: int
    """n, the number of attributes F."""
    edge_cosine: float | None = None
    """Cosine between the edge fields of model and photo; None if edges are not compared."""
    photo_whitening: FloatArray | None = None
    """(rank, n): whitening of F, if it is the same for all poses; None: not known."""

    def __post_init__(self) -> None:
        size = np.shape(self.mean)[0]
        object.__setattr__(self, "mean", freeze_array(self.mean, (size,)))
        object.__setattr__(self, "covariance", freeze_array(self.covariance, (size, size)))

    @property
    def correlations(self) -> int:
        """min(n, m), the number of canonical correlations of F and M."""
        return min(self.photo_channels, len(self.mean) - self.photo_channels)

    def squared_correlations(self, colours: int | None = None) -> FloatArray:
        """(min(n, m),): squared canonical correlations of M and F, or its first ``colours``."""
        n = self.photo_channels
        mean = self.mean
        covariance = self.covariance
        if colours is None:
            return canonical_correlations_squared(mean, covariance, n, self.photo_whitening)
        kept = np.r_[:colours, n : len(mean)]
        return canonical_correlations_squared(mean[kept], covariance[np.ix_(kept, kept)], colours)


@dataclass(frozen=True, slots=True, eq=False)
class AttributeImage:
    """Picture of the model's attributes at a pose, without light."""

    face_ids: NDArray[np.int32]
    """(height, width): index of the face at each pixel centre; -1 beside the model."""
    reflectance: NDArray[np.float32]
    """(height, width, 3): RGB in [0, 1]; 0 beside the model."""
    normals: NDArray[np.float32]
    """(height, width, 3): unit, in the camera frame, towards the camera; 0 beside the model."""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(height, width): pixels that show the model."""
        return self.face_ids >= 0

    def at(self, pixels: NDArray[np.intp]) -> AttributeImage:
        """Return arrays (N,) and (N, 3) of N flat indices of ``pixels``."""
        images = self.reflectance, self.normals
        values = (image.reshape(-1, 3).take(pixels, axis=0) for image in images)
        return AttributeImage(self.face_ids.ravel()[pixels], *values)


class Renderer:
    """Renderer of a mesh at any pose, for one thread at a time."""

    mesh: Mesh

    @property
    def callers(self) -> int:
        """Preferred number of threads that call ``moments`` at once; 0: a single one."""
        return 0

    def clone(self) -> Renderer | None:
        """Make a renderer of the mesh for another thread; None: only this thread may draw."""
        return None

    def decimate(self, faces: int) -> Renderer:
        """Make a renderer of the mesh decimated to ``faces`` triangles, if that is supported."""
        del faces
        return self

    def cull(self, pose: Pose) -> Renderer:
        """Make a renderer for poses near ``pose``, which may leave out faces hidden there."""
        del pose
        return self

    def cull_unseen(self, poses: Iterable[Pose]) -> Renderer:
        """Make a renderer for poses among ``poses``, which may leave out faces that none shows."""
        del poses
        return self

    def render(self, pose: Pose) -> AttributeImage:
        """Draw face indices, reflectance and normals (camera frame) at every pixel centre."""
        raise NotImplementedError

    def render_mask(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): draw the pixels that show the model."""
        return self.render(pose).mask

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Compute the joint moments of F and M at a pose on the photo at its own size."""
        pose = level_pose(pose, photo.factor)
        if photo.weights.shape != (pose.camera.height, pose.camera.width):
            raise ValueError("the pose's camera and the photo differ in size")
        return self.level_moments(pose, photo)

    def level_moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Compute ``moments`` at a pose on the pyramid level of ``photo``."""
        raise NotImplementedError
