"""Models: triangle surfaces with unit normals and reflectance; their convex hulls and axes."""

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
"""Number of vertices of a model below which all stand for its convex hull."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles whose corners carry a normal and a reflectance; made once, never changed.

    Reflectance is the interpolated vertex colour, times the texture where the face has one,
    display-encoded as photos are, in [0, 1]. A vertex on a sharp edge or seam is listed once for
    each normal or UV.
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
        """(2, 3): the lower and the upper corner of the bounding box."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def centre(self) -> FloatArray:
        """(3,): middle of the bounding box."""
        return self.bounds.mean(axis=0)

    @property
    def diameter(self) -> float:
        """Diagonal of the bounding box, in the model's unit."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def whole(self) -> Mesh:
        """Model with all its parts."""
        return self.complete or self

    def without(self, names: Collection[str]) -> Mesh:
        """Return the ``whole`` model without the parts of these names.

        Raises:
            SettingsError: there is no such part, or none would be left.
        """
        whole, wanted = self.whole, set(names)
        parts = whole.part_names
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
        is_kept = np.array([name not in wanted for name in parts])
        rest = whole.of_faces(is_kept[whole.face_part])
        return replace(
            rest,
            face_part=(np.cumsum(is_kept) - 1)[rest.face_part],
            part_names=tuple(compress(parts, is_kept)),
            left_out=tuple(compress(parts, ~is_kept)),
            complete=whole,
        )

    def of_faces(self, which: NDArray | slice) -> Mesh:
        """Return the mesh of some faces, by indices or by a mask, and of their vertices."""
        used, faces = np.unique(self.faces[which], return_inverse=True)
        part = replace(self, face_texture=self.face_texture[which], face_part=self.face_part[which])
        return part.with_vertices(used, faces.reshape(-1, 3))

    def with_vertices(self, source: NDArray, faces: NDArray) -> Mesh:
        """Return the mesh with copies of the vertices ``source`` (N,), and ``faces`` (F, 3)."""
        names = "vertices", "normals", "colours", "uvs"
        return replace(self, faces=faces, **{name: getattr(self, name)[source] for name in names})

    def part_vertices(self, name: str) -> FloatArray:
        """Return (N, 3): the vertices of the parts called ``name``."""
        wanted = [i for i, part in enumerate(self.part_names) if part == name]
        return self.vertices[np.unique(self.faces[np.isin(self.face_part, wanted)])]


@lru_cache(maxsize=16)
def hull_points(mesh: Mesh) -> FloatArray:
    """Return (k, 3): the convex hull's vertices, with the model's box in any photo; cached."""
    if len(mesh.vertices) < MIN_HULL_VERTICES:
        return mesh.vertices
    try:
        corners = ConvexHull(mesh.vertices).vertices
    except QhullError:
        return mesh.vertices
    return freeze_array(mesh.vertices[corners], (-1, 3))


def hull_in_photo(mesh: Mesh, pose: Pose) -> FloatArray:
    """Return (n, 2): the convex hull's vertices in the photo, px, but those behind the camera."""
    points = pose.project(hull_points(mesh))
    return points[np.isfinite(points).all(axis=1)]


def principal_axes(mesh: Mesh) -> FloatArray:
    """Return (3, 3): principal axes of the hull's vertices, a row each, the shortest first."""
    points = hull_points(mesh)
    return np.linalg.eigh(np.cov(points.T))[1].T
