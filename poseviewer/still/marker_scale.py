"""Scale of cameras by markers whose side is known: few of them, or far off, tell lengths better
than where cameras stood.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import list_names
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.transform import RigidTransform
from poseviewer.still.markers import detector_of, find_markers, is_of_other_size
from poseviewer.still.pictures import Pictures, Placed, Placement, Tell

MAX_READ = 40
"""Pictures that are read for the scale, evenly spread."""
MIN_SPREAD_DEG = 2.0
"""Angle between the viewing rays of a corner without which nothing tells where it is."""
MAX_RESIDUAL = 0.05
"""Distance of a marker's corners from their viewing rays, in its side, from which it moved."""
NO_SCALE = "The scale stays unknown: no marker is seen from two sides, lying still and whole"


@dataclass(frozen=True, slots=True)
class _Rays:
    """Viewing rays of a marker's corners in one picture, in the world."""

    start: FloatArray
    """(3,), the camera."""
    along: FloatArray
    """(4, 3), unit vectors."""


def scale_by_markers(
    tell: Tell, placement: Placement, paths: Sequence[Path], family: str, marker_size: float
) -> Placement:
    """Scale the cameras of pictures so that markers have their side.

    Args:
        tell: takes lines on how far it is.
        placement: cameras whose scale is not known.
        paths: the pictures.
        family: of the markers, one of ``FAMILIES``.
        marker_size: side of the markers, black edge to black edge.

    Returns:
        The cameras in the unit of ``marker_size``; as they were, with a note, where no marker tells
        the scale.
    """
    rays, notes = defaultdict[int, list[_Rays]](list), [*placement.notes]
    order = sorted(placement.placed)
    some = np.unique(np.linspace(0, len(order) - 1, MAX_READ).astype(int))
    for count, at in enumerate(some):
        tell(f"markers in {count + 1} of {len(some)}")
        index = order[at]
        for number, own in _seen(paths[index], placement.placed[index], family).items():
            rays[number].append(own)
    sides = {number: side for number in sorted(rays) if (side := _side(rays[number])) is not None}
    if not sides:
        return replace(placement, notes=(*notes, f"{NO_SCALE}; print it flat, with a margin."))
    logs = np.log([*sides.values()])
    other = is_of_other_size(logs)
    usual = float(np.exp(np.median(logs[~other])))
    odd = [f"{number} ({sides[number] / usual:.2f} times)"
           for number, is_other in zip(sides, other, strict=True) if is_other]  # fmt: skip
    if odd:
        said = f"markers of another side than most: {list_names(odd)}"
        alike = "if all are printed alike, the cameras are off where they are seen"
        notes.append(f"{said}; the given size is taken for most; {alike}.")
    longer = marker_size / usual
    placed = {
        index: replace(own, camera_from_world=_longer(own.camera_from_world, longer))
        for index, own in placement.placed.items()
    }
    return replace(placement, placed=placed, unit_known=True, notes=tuple(notes))


def _longer(pose: RigidTransform, factor: float) -> RigidTransform:
    return RigidTransform(pose.rotation, factor * pose.translation)


def _seen(path: Path, own: Placed, family: str) -> dict[int, _Rays]:
    """Return the rays of each marker in a picture, by its number."""
    pictures, detector = Pictures([path], own.undistortion or own.camera), detector_of(family)
    grey = pictures.read(0)
    if grey is None:
        return {}
    back, found = own.camera_from_world.inverse(), dict[int, _Rays]()
    for number, corners in find_markers(grey, detector)[0].items():
        flat = own.camera.rays(pictures.straighten(corners)) @ back.rotation.T
        along = flat / np.linalg.norm(flat, axis=1, keepdims=True)
        found[number] = _Rays(back.translation, along)
    return found


def _side(rays: Sequence[_Rays]) -> float | None:
    """Return the side of a marker by where the rays of its corners meet; None: they do not."""
    along, starts = np.array([one.along for one in rays]), np.array([one.start for one in rays])
    facing = np.einsum("nci,mci->nmc", along, along).min()
    if facing > np.cos(np.radians(MIN_SPREAD_DEG)):
        return None
    across = np.eye(3) - along[..., :, None] * along[..., None, :]
    towards = np.einsum("ncij,nj->ci", across, starts)
    corners = np.linalg.solve(across.sum(axis=0), towards[..., None])[..., 0]
    side = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
    off = np.einsum("ncij,ncj->nci", across, corners - starts[:, None])
    return side if np.median(np.linalg.norm(off, axis=2)) < MAX_RESIDUAL * side else None
