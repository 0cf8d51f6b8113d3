"""A model painted from photos: finer faces with colours, and which of them are painted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas


@dataclass(frozen=True, eq=False)
class Painting:
    """A painted model in the frame and unit of the model, and what it was painted from."""

    bare: Mesh
    """The model as it was."""
    mesh: Mesh
    """Its surface in finer faces, with reflectance in vertex colours; what is not painted has the
    mean colour of what is."""
    contrast: Mesh
    """``mesh`` with the brightness of each colour by that of its surroundings, which leaves the
    print and no light, as searches compare it."""
    is_painted: NDArray[np.bool_]
    """(F,): the faces of ``mesh`` that a photo shows."""
    photos: tuple[str, ...]
    """Names of the photos."""

    @property
    def share(self) -> float:
        """Share of the surface that is painted, in [0, 1]."""
        areas = face_normals_and_areas(self.mesh.vertices, self.mesh.faces)[1]
        return float(areas[self.is_painted].sum() / max(areas.sum(), 1e-300))
