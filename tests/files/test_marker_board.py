"""Layouts of boards of markers: read, or refused in a sentence."""

import cv2
import numpy as np
import pytest

from poseviewer.errors import CalibrationFileError
from poseviewer.files.marker_board import CORNERS, load_board
from tests.writing import write

GRID = {"target_type": "aprilgrid", "tagCols": 6, "tagRows": 5, "tagSize": 0.088, "tagSpacing": 0.3}
SQUARE = [[0, 1, 0.5], [1, 1, 0.5], [1, 0, 0.5], [0, 0, 0.5]]

CROSSED = [SQUARE[index] for index in (0, 2, 1, 3)]


def test_an_aprilgrid_counts_from_the_lower_left(tmp_path):
    lines = "".join(f"{key}: {value}  # m\n" for key, value in GRID.items())
    board = load_board(write(tmp_path / "grid.yaml", lines))
    assert len(board.places) == 30
    assert (board.family, board.unit) == ("AprilTag 36h11", "m")
    corners = board.places[7].apply(board.sides[7] * CORNERS)  # Kalibr's rows and columns from 0
    lower_left = np.array([1.3 * 0.088, 1.3 * 0.088, 0.0])
    np.testing.assert_allclose(corners[3], lower_left, atol=1e-12)
    np.testing.assert_allclose(corners[1], lower_left + 0.088 * np.array([1, 1, 0]), atol=1e-12)
    without = {key: value for key, value in GRID.items() if key != "target_type"}
    assert load_board(write(tmp_path / "basalt.json", without)).places.keys() == board.places.keys()


def test_a_marker_map_is_read_as_opencv_writes_it(tmp_path):
    path = tmp_path / "map.yml"
    storage = cv2.FileStorage(str(path), cv2.FileStorage_WRITE)
    storage.write("aruco_bc_dict", "ARUCO_MIP_36h12")
    storage.write("aruco_bc_mInfoType", 1)
    storage.startWriteStruct("aruco_bc_markers", cv2.FileNode_SEQ)
    standing = np.array([(0, 0, 2), (1, 0, 2), (1, 0, 1), (0, 0, 1)])
    for number, corners in ((0, np.array(SQUARE)), (17, standing)):
        storage.startWriteStruct("", cv2.FileNode_MAP | cv2.FileNode_FLOW)
        storage.write("id", number)
        storage.startWriteStruct("corners", cv2.FileNode_SEQ | cv2.FileNode_FLOW)
        for corner in corners:
            storage.startWriteStruct("", cv2.FileNode_SEQ | cv2.FileNode_FLOW)
            for value in corner:
                storage.write("", float(value))
            storage.endWriteStruct()
        storage.endWriteStruct()
        storage.endWriteStruct()
    storage.endWriteStruct()
    storage.release()
    board = load_board(path)
    assert (board.family, board.unit) == ("ArUco MIP 36h12", "m")
    for number, corners in ((0, SQUARE), (17, standing)):
        shown = board.places[number].apply(board.sides[number] * CORNERS)
        np.testing.assert_allclose(shown, corners, atol=1e-9)


def markers(*entries: object) -> dict[str, object]:
    return {"aruco_bc_markers": list(entries)}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"target_type": "checkerboard"}, "target_type checkerboard; wanted Kalibr's aprilgrid"),
        ({"fx": 1.0}, "no board of markers; wanted Kalibr's aprilgrid"),
        ({**GRID, "tagCols": 0}, "0 tags; wanted 1 to 587"),
        ({**GRID, "tagSize": None}, "tagSize is missing"),
        ({**GRID, "tagSpacing": -0.3}, "tagSpacing is -0.3"),
        ({**GRID, "tagCols": 50, "tagRows": 50}, "2500 tags"),
        ({**GRID, "startId": 30}, "an aprilgrid with startId; wanted tagCols"),
        (markers(), "no marker in it"),
        (markers({"corners": SQUARE}), "id is missing"),
        (markers({"id": 3, "corners": SQUARE[:3]}), "corners of marker 3 has 9 numbers"),
        (markers({"id": 3, "corners": [SQUARE[0]] * 4}), "marker 3 has no size"),
        (
            markers({"id": 3, "corners": [SQUARE[i] for i in (0, 2, 1, 3)]}),
            "no square; .* clockwise",
        ),
        (markers({"id": 3, "corners": [*SQUARE[:3], [0, 0.1, 0.5]]}), "marker 3 is no square"),
        (markers(*[{"id": 3, "corners": SQUARE}] * 2), "marker 3 is there twice"),
        (
            {**markers({"id": 3, "corners": SQUARE}), "aruco_bc_mInfoType": 2},
            "InfoType is 2; wanted",
        ),
        ([1, 2], "its content is a list of 2"),
        ("not: [a board", "not YAML"),
    ],
)
def test_what_is_no_board_is_refused(tmp_path, content, said):
    path = write(tmp_path / ("board.json" if not isinstance(content, str) else "b.yml"), content)
    with pytest.raises(CalibrationFileError, match=said):
        load_board(path)
