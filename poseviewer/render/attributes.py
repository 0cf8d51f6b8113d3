"""What a renderer gives, and the protocol that every renderer follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose
from poseviewer.render.moments import Moments, PhotoAttributes


@dataclass(frozen=True, slots=True, eq=False)
class AttributeImage:
    """The model as one pose shows it, before any light falls on it."""

    face_ids: NDArray[np.int32]
    """(height, width): the visible face of each pixel centre, -1 where the model is not."""
    reflectance: NDArray[np.float32]
    """(height, width, 3): RGB in [0, 1]; 0 where the model is not."""
    normals: NDArray[np.float32]
    """(height, width, 3): unit, in the camera frame, on the side that is seen; 0 elsewhere."""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(height, width): where the model is."""
        return self.face_ids >= 0


class Renderer(Protocol):
    """A mesh, ready to be seen from any pose; the picture's size is the camera's."""

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre."""
        ...

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen; ``render(pose).mask``, sooner."""
        ...

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments of the photo's and the model's attributes."""
        ...
