"""What the faces of a vehicle are made of, by the names of its parts; and its paint."""

from __future__ import annotations

import re
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.files.mesh.load import linear_from_srgb
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas

Finish = Literal["paint", "plastic", "rubber", "metal", "glass"]
FINISHES: tuple[Finish, ...] = get_args(Finish)
NAMED: tuple[tuple[Finish, str], ...] = (
    ("rubber", r"tyre|tire|rubber"),
    ("plastic", r"trim|edge|liner|bezel|wiper"),
    ("metal", r"rim\b|wheel|chrome|mirror glass|exhaust|badge|lamp (projector|left|right)"),
    ("glass", r"glass|window|windscreen|windshield"),
)
"""The first that a part's name holds."""
SHADES = 24
"""Steps per channel within which colours count as the same paint."""


def find_finishes(mesh: Mesh) -> NDArray[np.int32]:
    """(F,) indices into ``FINISHES``. Paint is the colour of most of the surface whose part has no
    telling name; of the rest, what has another colour is plastic.
    """
    of_part = [_by_name(name) for name in mesh.part_names]
    finishes = np.array(of_part, np.int32)[mesh.face_part]
    is_open = finishes < 0
    _, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    shades = np.rint(mesh.colours[mesh.faces].mean(axis=1) * SHADES).astype(np.int64)
    codes = shades @ [(SHADES + 1) ** 2, SHADES + 1, 1]
    if is_open.any():
        kinds, which = np.unique(codes[is_open], return_inverse=True)
        paint = kinds[np.argmax(np.bincount(which, areas[is_open]))]
        finishes[is_open & (codes == paint)] = FINISHES.index("paint")
    finishes[finishes < 0] = FINISHES.index("plastic")
    return finishes


def corner_colours(
    mesh: Mesh, finishes: NDArray[np.int32], paint: ArrayLike | None
) -> NDArray[np.float32]:
    """(F, 3, 3) linear RGB of the faces' corners; ``paint``: display-encoded RGB of a new coat."""
    colours = np.array(mesh.colours[mesh.faces], np.float32)
    if paint is not None:
        colours[finishes == FINISHES.index("paint")] = np.asarray(paint, np.float32)
    return linear_from_srgb(colours).astype(np.float32)


def _by_name(name: str) -> int:
    for finish, pattern in NAMED:
        if re.search(pattern, name.lower()):
            return FINISHES.index(finish)
    return -1
