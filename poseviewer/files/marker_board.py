"""Boards of markers at known places, as Kalibr and ArUco write them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import CalibrationFileError, list_names
from poseviewer.files.camera_trees import load_tree
from poseviewer.files.checks import InputFile
from poseviewer.geometry.transform import RigidTransform, nearest_rotation

OF_ARUCO = {
    "ARUCO": "ArUco", "ARUCO_MIP_36h12": "ArUco MIP 36h12", "TAG16h5": "AprilTag 16h5",
    "TAG25h9": "AprilTag 25h9", "TAG36h10": "AprilTag 36h10", "TAG36h11": "AprilTag 36h11",
}  # fmt: skip
"""Families of ``still.markers`` by ArUco's names."""
OF_GRID = ("tagCols", "tagRows", "tagSize", "tagSpacing")
MAX_TAGS = 587
"""Markers of the family AprilTag 36h11, of which grids are."""
SQUARE = 0.02
"""Distance of a corner from the square, in its side, beyond which four are none."""
WANTED = (
    "wanted Kalibr's aprilgrid (tagCols, tagRows, tagSize, tagSpacing) or a marker map of ArUco "
    "(aruco_bc_markers)"
)
CORNERS = np.array([(-0.5, 0.5, 0.0), (0.5, 0.5, 0.0), (0.5, -0.5, 0.0), (-0.5, -0.5, 0.0)])
"""Corners of a marker of side 1, clockwise from the upper left one, as OpenCV has them."""


@dataclass(frozen=True, slots=True)
class MarkerBoard:
    """Markers at known places."""

    places: Mapping[int, RigidTransform]
    """Board from marker: a marker's middle, x to its right, y to its upper edge, by its number."""
    sides: Mapping[int, float]
    """Sides of their black squares."""
    family: str
    """One of ``still.markers``; "": the file does not say it."""
    unit: str | None
    """Unit of the lengths; None: they are in proportion alone."""


NO_BOARD = MarkerBoard({}, {}, "", None)
"""Stands for none."""


def load_board(path: Path) -> MarkerBoard:
    """Load the layout of a board from YAML or JSON: an aprilgrid of Kalibr's, of which marker 0 is
    at the lower left, or a marker map of ArUco's, MarkerMapper's or UcoSLAM's.

    Raises:
        CalibrationFileError: it is neither, or not whole.
    """
    file = InputFile(path, [], CalibrationFileError, "board of markers", numbers_as_text=True)
    with file.naming_errors():
        tree = file.object(load_tree(file), "its content")
        if "aruco_bc_markers" in tree:
            return _marker_map(file, tree)
        kind = str(tree.get("target_type", "aprilgrid"))
        if kind != "aprilgrid" or not tree.keys() & {*OF_GRID}:
            kind = f"target_type {kind}" if "target_type" in tree else "no board of markers"
            raise file.error(kind, WANTED)
        return _aprilgrid(file, tree)


def _aprilgrid(file: InputFile, tree: dict[str, Any]) -> MarkerBoard:
    others = sorted(tree.keys() - {"target_type", *OF_GRID})
    if others:
        raise file.error(f"an aprilgrid with {list_names(others)}", f"wanted {', '.join(OF_GRID)}")
    columns, rows = (_whole(file, tree.get(key), key) for key in OF_GRID[:2])
    side, spacing = (file.positive(tree.get(key), key) for key in OF_GRID[2:])
    if not 0 < columns * rows <= MAX_TAGS:
        raise file.error(f"{columns * rows} tags", f"wanted 1 to {MAX_TAGS}, as the family has")
    places = dict[int, RigidTransform]()
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        middle = side * (0.5 + (1.0 + spacing) * np.array([column, row]))
        places[number] = RigidTransform(np.eye(3), np.append(middle, 0.0))
    return MarkerBoard(places, dict.fromkeys(places, side), OF_ARUCO["TAG36h11"], "m")


def _marker_map(file: InputFile, tree: dict[str, Any]) -> MarkerBoard:
    places, sides = dict[int, RigidTransform](), dict[int, float]()
    for entry in file.decode(tree["aruco_bc_markers"], list[dict[str, Any]], "aruco_bc_markers"):
        number = _whole(file, entry.get("id"), "id")
        what = f"marker {number}"
        if number in places:
            raise file.error(f"{what} is there twice", "wanted each once")
        numbers = file.flat_numbers(entry.get("corners"), f"corners of {what}", 12)
        corners = np.reshape(numbers, (4, 3))
        middle = corners.mean(axis=0)
        right = (corners[1] + corners[2] - corners[0] - corners[3]) / 2.0
        up = (corners[0] + corners[1] - corners[2] - corners[3]) / 2.0
        side = float(np.linalg.norm(right) + np.linalg.norm(up)) / 2.0
        if not side > 0.0:
            raise file.error(f"{what} has no size", "wanted its four corners")
        axes = np.column_stack([right, up, np.cross(right, up) / side]) / side
        rotation = nearest_rotation(axes)
        square = middle + side * CORNERS @ rotation.T
        if np.abs(square - corners).max() > SQUARE * side:
            raise file.error(f"{what} is no square", "wanted its corners clockwise from upper left")
        places[number], sides[number] = RigidTransform(rotation, middle), side
    if not places:
        raise file.error("no marker in it", WANTED)
    kind = _whole(file, tree.get("aruco_bc_mInfoType", 1), "aruco_bc_mInfoType")
    if kind > 1:
        raise file.error(f"aruco_bc_mInfoType is {kind}", "wanted 0, in pixels, or 1, in metres")
    family = OF_ARUCO.get(file.text(tree.get("aruco_bc_dict"), "aruco_bc_dict"), "")
    return MarkerBoard(places, sides, family, "m" if kind == 1 else None)


def _whole(file: InputFile, value: Any, what: str) -> int:
    number = file.number(value, what)
    if number < 0.0 or not number.is_integer():
        raise file.error(f"{what} is {number:g}", "wanted a whole number of 0 or more")
    return int(number)
