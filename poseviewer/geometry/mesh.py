"""The model: a triangle surface with unit normals and a reflectance; its convex hull and axes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from poseviewer.errors import SettingsError, list_names
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Pose

MIN_HULL_VERTICES = 100
"""Models of fewer vertices are taken for their own convex hull."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles whose corners carry a normal and a reflectance; made once, never changed.

    Reflectance is the interpolated vertex colour, times the texture where the face has one. Its
    encoding is the photo's (display-encoded, 0 to 1). Vertices on sharp edges or seams stand in the
    list once for each normal or UV.
    """

    vertices: FloatArray
    """(V, 3) in the model's unit."""
    faces: NDArray[np.int32]
    """(F, 3) indices into ``vertices``."""
    normals: FloatArray
    """(V, 3) unit normals, on the side from which the face runs counter-clockwise."""
    colours: NDArray[np.float32]
    """(V, 3) RGB reflectance in [0, 1]."""
    uvs: NDArray[np.float32]
    """(V, 2) texture coordinates, v upwards as in OBJ, wrapped around; zeros where unused."""
    face_texture: NDArray[np.int32]
    """(F,) index into ``textures``, -1 where the face has none."""
    face_part: NDArray[np.int32]
    """(F,) index into ``part_names``."""
    textures: tuple[NDArray[np.uint8], ...] = ()
    """Each (h, w, 3) RGB."""
    part_names: tuple[str, ...] = ("",)
    has_reflectance: bool = False
    """Whether the file said anything about colour; if not, ``colours`` are constant."""
    unit: str | None = None
    """The length unit, where the file says it."""
    y_up: bool = False
    """Whether its format has y upwards and the front at +z, as glTF."""
    notes: tuple[str, ...] = field(default=())
    """Notes for the user on what was mended on loading."""
    left_out: tuple[str, ...] = ()
    """Names of the parts of ``whole`` that are left out here."""
    complete: Mesh | None = field(default=None, repr=False)
    """The model with all its parts; None: this one."""

    def __post_init__(self) -> None:
        shapes = {
            "vertices": ((-1, 3), np.float64),
            "faces": ((-1, 3), np.int32),
            "normals": ((-1, 3), np.float64),
            "colours": ((-1, 3), np.float32),
            "uvs": ((-1, 2), np.float32),
            "face_texture": ((-1,), np.int32),
            "face_part": ((-1,), np.int32),
        }
        for name, (shape, dtype) in shapes.items():
            object.__setattr__(self, name, freeze_array(getattr(self, name), shape, dtype))
        textures = tuple(freeze_array(t, (-1, -1, 3), np.uint8) for t in self.textures)
        object.__setattr__(self, "textures", textures)

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3): the least and the greatest corner of the bounding box."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def centre(self) -> FloatArray:
        """(3,): the middle of the bounding box."""
        return self.bounds.mean(axis=0)

    @property
    def diameter(self) -> float:
        """The diagonal of the bounding box, in the model's unit."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def whole(self) -> Mesh:
        """The model with all its parts."""
        return self.complete or self

    def without(self, names: Collection[str]) -> Mesh:
        """The ``whole`` model without parts; ``SettingsError``: one is unknown, or none is left."""
        whole, wanted, parts = self.whole, set(names), self.whole.part_names
        if wanted == set(self.left_out):
            return self
        if not wanted:
            return whole
        known = list_names([part or "(unnamed)" for part in parts])
        if unknown := [name for name in names if name not in parts]:
            raise SettingsError(f"the model has no part {unknown[0]!r}; it has {known}.")
        if wanted >= set(parts):
            raise SettingsError(
                f"nothing would be left of the model, whose parts are {known}; "
                "leave one of them in."
            )
        stays = np.array([name not in wanted for name in parts])
        left = whole.of_faces(stays[whole.face_part])
        return replace(
            left,
            face_part=(np.cumsum(stays) - 1)[left.face_part],
            part_names=tuple(compress(parts, stays)),
            left_out=tuple(compress(parts, ~stays)),
            complete=whole,
        )

    def of_faces(self, which: NDArray | slice) -> Mesh:
        """The mesh of some of its faces, by their numbers or by a mask, and of their vertices."""
        used, faces = np.unique(self.faces[which], return_inverse=True)
        own = replace(self, face_texture=self.face_texture[which], face_part=self.face_part[which])
        return own.with_vertices(used, faces.reshape(-1, 3))

    def with_vertices(self, source: NDArray, faces: NDArray) -> Mesh:
        """The mesh with copies of its vertices of numbers ``source`` (N,), and (F, 3) ``faces``."""
        names = "vertices", "normals", "colours", "uvs"
        return replace(self, faces=faces, **{name: getattr(self, name)[source] for name in names})

    def part_vertices(self, name: str) -> FloatArray:
        """(N, 3): the vertices of the parts called ``name``."""
        wanted = [i for i, part in enumerate(self.part_names) if part == name]
        return self.vertices[np.unique(self.faces[np.isin(self.face_part, wanted)])]


@lru_cache(maxsize=16)
def hull_points(mesh: Mesh) -> FloatArray:
    """(k, 3): the vertices of the convex hull, with the model's box in any photo, cached."""
    if len(mesh.vertices) < MIN_HULL_VERTICES:
        return mesh.vertices
    try:
        corners = ConvexHull(mesh.vertices).vertices
    except QhullError:
        return mesh.vertices
    return freeze_array(mesh.vertices[corners], (-1, 3))


def hull_in_photo(mesh: Mesh, pose: Pose) -> FloatArray:
    """(n, 2): vertices of the convex hull in the photo, px, without those behind the camera."""
    points = pose.project(hull_points(mesh))
    return points[np.isfinite(points).all(axis=1)]


def principal_axes(mesh: Mesh) -> FloatArray:
    """(3, 3): unit axes in the model's frame, a row each, by its hull's scatter, shortest first."""
    points = hull_points(mesh)
    return np.linalg.eigh(np.cov(points.T))[1].T
