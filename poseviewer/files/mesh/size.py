"""Words on a model's size, its origin, and the unit that both make likely."""

import numpy as np

from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh

METRES = {"km": 1000.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
MAX_SIZE_IN_METRES = 20.0
"""Longest side of what is likely in metres: cars and machines have fewer; in mm, a button more."""
IN_THE_MIDDLE = 0.02
"""Distance of the origin from the middle, in the model's diagonal, that is none."""
MIN_SIZE_PX = 6.0
"""Size of a model in the photo, in px, that tells nothing."""


def size_words(mesh: Mesh) -> str:
    """Say the sides of a model's box, where its origin lies, and what a translation means."""
    sides = np.ptp(mesh.bounds, axis=0)
    guess = "m" if sides.max() < MAX_SIZE_IN_METRES else "mm"
    unit = mesh.unit or f"a unit that is not said (likely {guess})"
    away = float(np.linalg.norm(mesh.centre)) / mesh.diameter
    origin = "in its middle" if away < IN_THE_MIDDLE else f"{away:.2g} of its size from its middle"
    return (
        f"{' x '.join(f'{side:.4g}' for side in sides)} in {unit}; its origin lies {origin}, and a "
        f"pose's translation is where that origin is before the camera, in {mesh.unit or guess}"
    )


def distance_notes(mesh: Mesh, pose: Pose) -> tuple[str, ...]:
    """A note where a pose has the model too near or too far, as other units do; or none."""
    distance = float(pose.camera_from_model.apply(mesh.centre)[2])
    if not isinstance(pose.camera, Perspective):
        return ()
    in_px = pose.camera.fx * mesh.diameter / max(abs(distance), 1e-9)
    if abs(distance) > 0.5 * mesh.diameter and in_px > MIN_SIZE_PX:
        return ()
    return (
        f"The pose has the model's middle at a distance of {distance:.3g}, and the model's size is "
        f"{mesh.diameter:.3g}: are the pose and the model in one unit?",
    )
