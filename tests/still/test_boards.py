"""Cameras by a board whose layout a file says, as Kalibr and ArUco write it."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.marker_board import load_board
from poseviewer.geometry.camera import Perspective
from poseviewer.still.pictures import Placement
from poseviewer.still.still_cameras import find_cameras, place_pictures
from tests.still_scene import (
    CAMERA,
    MARKER,
    MARKERS,
    PLACES,
    Solid,
    arc,
    errors,
    marker,
    sheet,
    write_pictures,
)
from tests.writing import write

LARGE = CAMERA.rescale(2.0)
COLUMNS, ROWS, SIDE, SPACING = 4, 3, 0.09, 0.3
ORIGIN = np.array([-0.25, -0.15, 0.001])
"""Lower left corner of the grid on the table, m."""
GRID = f"target_type: 'aprilgrid'\ntagCols: {COLUMNS}\ntagRows: {ROWS}\ntagSize: {SIDE}\n"
ARC = arc(4, 40.0)


def april_grid(border: int) -> list[Solid]:
    """A grid as Kalibr prints it: black squares between the tags, tag 0 at the lower left."""
    tags = []
    for number in range(COLUMNS * ROWS):
        row, column = divmod(number, COLUMNS)
        x, y = ORIGIN[:2] + SIDE * (0.5 + (1.0 + SPACING) * np.array([column, row]))
        # OpenCV draws AprilTags on their heads.
        tags.append(marker(number, x, y, SIDE, 180.0, border=border, margin=SPACING / 2, corners=0))
    return tags


def marker_map(spread: float = 1.0, unit: float = 1.0, **more: object) -> dict[str, Any]:
    """``MARKERS`` as ArUco has them: their places times ``spread``, lengths in ``unit`` m."""
    entries = []
    for number, place in enumerate(PLACES):
        turn = np.radians(40.0 * number + 180.0)
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        corners = MARKER / 2.0 * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]) @ turned.T
        flat = np.column_stack([corners + spread * np.array(place), np.full(4, 0.001)]) / unit
        entries.append({"id": number, "corners": flat.tolist()})
    about = {"aruco_bc_dict": "TAG36h11", "aruco_bc_nmarkers": 5, "aruco_bc_mInfoType": 1}
    return {**about, "aruco_bc_markers": entries, **more}


def place(
    paths: list[Path], board: Path, folder: Path, camera: Perspective | None = CAMERA,
    marker_size: float | None = None,
) -> Placement:  # fmt: skip
    given = paths, "auto", camera, marker_size, folder, load_board(board)
    return place_pictures(lambda _: None, *given).placement  # pyright: ignore[reportArgumentType]


def off_m(found: Placement, origin: Any = (0.0, 0.0, 0.0)) -> float:
    """Largest error of a camera's place in the frame of the board."""
    placed = {i: own.camera_from_world.inverse().translation for i, own in found.placed.items()}
    true = {index: ARC[index].inverse().translation - origin for index in placed}
    return max(float(np.linalg.norm(placed[index] - true[index])) for index in placed)


def test_a_tag_is_drawn_as_kalibr_has_it():
    (tag,) = marker(0, 0.0, 0.0, 0.1, turn_deg=180.0)
    assert tag.corners[0, 0] > 0.0 > tag.corners[0, 1]  # OpenCV's upper left is at the lower right
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    drawn = np.asarray(cv2.aruco.generateImageMarker(dictionary, 0, 8))
    bits = np.rot90(drawn[1:-1, 1:-1] > 0, 2)
    assert int("".join(str(int(bit)) for bit in bits.ravel()), 2) == 0xD5D628584  # Kalibr's code


@pytest.mark.slow
@pytest.mark.parametrize(("border", "least"), [(2, 4), (1, 3)])
def test_an_aprilgrid_tells_cameras_and_focal_length_in_its_frame(tmp_path, border, least):
    paths = write_pictures(tmp_path / "m", ARC, april_grid(border), boxes=(), camera=LARGE)
    board = write(tmp_path / "aprilgrid.yaml", f"{GRID}tagSpacing: {SPACING}\n")
    found = place(paths, board, tmp_path, camera=None)
    assert len(found.placed) >= least  # tags of a narrow border are seen in part
    assert off_m(found, ORIGIN) < 0.005
    assert found.placed[0].camera.fx == pytest.approx(LARGE.fx, rel=0.005)
    assert found.unit_known
    assert not found.notes


@pytest.mark.slow
def test_pictures_that_share_no_marker_hang_together_by_the_board(tmp_path):
    def apart(index: int, solids: list[Solid]) -> list[Solid]:
        return [solids[0], *MARKERS[index : index + 2]]

    paths = write_pictures(tmp_path / "m", ARC[:3:2], boxes=(), change=lambda i, s: apart(2 * i, s))
    board = write(tmp_path / "map.json", marker_map())
    (found,) = [step for step in find_cameras(paths, camera=CAMERA, board=load_board(board))
                if not isinstance(step, str)]  # fmt: skip
    assert (len(found.views), found.unit, found.is_scale_known) == (2, "m", True)
    true = [ARC[index].inverse().translation for index in (0, 2)]
    places = [view.camera_from_world.inverse().translation for view in found.views]
    np.testing.assert_allclose(places, true, atol=0.01)


@pytest.mark.slow
def test_markers_beside_the_board_are_used_too(tmp_path):
    def beside(index: int, solids: list[Solid]) -> list[Solid]:
        return [solids[0], *(MARKERS if index < 3 else MARKERS[2:])]

    paths = write_pictures(tmp_path / "m", ARC, boxes=(), change=beside)
    known = marker_map()
    known["aruco_bc_markers"] = known["aruco_bc_markers"][:2]
    found = place(paths, write(tmp_path / "map.json", known), tmp_path)
    assert sorted(found.placed) == [0, 1, 2, 3]
    assert off_m(found) < 0.01


def test_a_map_in_pixels_has_its_scale_by_the_size_of_its_markers(tmp_path):
    paths = write_pictures(tmp_path / "m", ARC[:2], MARKERS, boxes=())
    board = write(tmp_path / "map.json", marker_map(unit=MARKER / 100.0, aruco_bc_mInfoType=0))
    found = place(paths, board, tmp_path, marker_size=MARKER)
    assert found.unit_known
    assert off_m(found) < 0.01
    turned = marker_map(unit=MARKER / 100.0, aruco_bc_mInfoType=0, aruco_bc_dict="own")
    for entry in turned["aruco_bc_markers"]:  # as OpenCV has them
        entry["corners"] = entry["corners"][2:] + entry["corners"][:2]
    found = place(paths, write(tmp_path / "own.json", turned), tmp_path)
    assert not found.unit_known
    assert not found.notes


def test_a_board_that_does_not_fit_is_said_and_one_that_is_not_there_refused(tmp_path):
    paths = write_pictures(tmp_path / "m", ARC[:2], MARKERS, boxes=())
    (note,) = place(paths, write(tmp_path / "wide.json", marker_map(1.2)), tmp_path).notes
    assert "% of their side beside where it says" in note
    other = marker_map()
    for entry in other["aruco_bc_markers"]:
        entry["id"] += 50
    with pytest.raises(SettingsError, match="0 pictures show the board"):
        place(paths, write(tmp_path / "other.json", other), tmp_path)


def test_a_board_goes_with_no_features_and_no_size_of_its_own(tmp_path):
    board = load_board(write(tmp_path / "map.json", marker_map()))
    paths = [tmp_path / "a.png", tmp_path / "b.png"]
    with pytest.raises(SettingsError, match="with features"):
        next(iter(find_cameras(paths, "features", board=board)))
    with pytest.raises(SettingsError, match="board that says it"):
        next(iter(find_cameras(paths, marker_size=0.1, board=board)))


@pytest.mark.slow
@pytest.mark.long
def test_a_charuco_board_needs_no_layout(tmp_path):
    squares, square, side, cameras = (7, 5), 0.06, 0.045, arc(6)
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    drawn = cv2.aruco.CharucoBoard(squares, square, side, family).generateImage((560, 400))
    print_ = np.repeat(np.pad(drawn, 40, constant_values=255)[..., None], 3, axis=2)
    right, up = np.diag([*(0.5 * square * (np.array(squares) + 1.0)), 0.0])[:2]
    board: Solid = (sheet((0.0, -0.05, 0.001), right, up, print_),)
    paths = write_pictures(tmp_path / "c", cameras, (board,), boxes=(), camera=LARGE)
    given = paths, "auto", None, side, tmp_path
    found = place_pictures(lambda _: None, *given).placement  # pyright: ignore[reportArgumentType]
    places = [found.placed[index].camera_from_world for index in range(len(cameras))]
    degrees, percent = errors(places, cameras, 1.0)
    assert degrees < 0.1
    assert percent < 0.2
    assert not found.notes
