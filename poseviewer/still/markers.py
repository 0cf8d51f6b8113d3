"""Cameras by ArUco and AprilTag markers that lie anywhere: the pictures tell their layout, too,
unless they are of a board that says it.

The world is the board's, or the frame of the marker that is seen most: its middle, x to its right,
y to its upper edge, z towards who looks at it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from poseviewer.errors import SettingsError, list_names
from poseviewer.files.marker_board import CORNERS, NO_BOARD, MarkerBoard
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.still.pictures import MIN_PICTURES, Grey, Pictures, Placed, Placement, Tell

FAMILIES = {
    "ArUco 4x4": cv2.aruco.DICT_4X4_1000, "ArUco 5x5": cv2.aruco.DICT_5X5_1000,
    "ArUco 6x6": cv2.aruco.DICT_6X6_1000, "ArUco 7x7": cv2.aruco.DICT_7X7_1000,
    "ArUco": cv2.aruco.DICT_ARUCO_ORIGINAL, "ArUco MIP 36h12": cv2.aruco.DICT_ARUCO_MIP_36H12,
    "AprilTag 16h5": cv2.aruco.DICT_APRILTAG_16H5, "AprilTag 25h9": cv2.aruco.DICT_APRILTAG_25H9,
    "AprilTag 36h10": cv2.aruco.DICT_APRILTAG_36H10,
    "AprilTag 36h11": cv2.aruco.DICT_APRILTAG_36H11,
}  # fmt: skip
"""Dictionaries of OpenCV's that contain the others."""
SURVEYED = 8
"""Pictures by which the family is told, and whether there are markers at all."""
PRINTED = 250
"""Markers of a family by which it is told: all of thousands take seconds a picture."""
MIN_SHARE = 0.6
"""Share of these pictures with two markers from which cameras are found by markers."""
BORDERS = (0, 2, 1)
"""Modules of a grid's black borders that are tried: Kalibr prints two; 0: no grid."""
GRID_THRESHOLD = 15.0
"""Levels by which black is darker than what is about it on a grid, on which squares that touch come
apart so; OpenCV's own is 7.
"""
REFINEMENTS = 3
"""Times that corners are refined, each from where they were then."""
MAX_SHIFT_PX = 3.0
"""Shift of a corner that is no refinement any more, px."""
GUESSES = (0.7, 1.0, 1.5, 2.2)
"""Focal lengths to begin with where none is known, in the picture's longer side."""
ROUNDS = 2
"""Times that markers and cameras are placed in turn before all are solved for at once."""
MAX_TOGETHER = 150
"""Pictures whose cameras are solved for at once; those between are placed by the layout."""
ROBUST_PX = 1.0
"""Residual beyond which an observation counts less, px."""
MAX_STEPS = 60
"""Evaluations of the solution for all."""
FEW_STEPS = 15
"""And to see whether a marker has moved."""
SIZE_RATIO = 1.05
"""Ratio of two markers' sides from which they differ."""
NEAR = 1e-9
"""Depth of a point, in sides, that is as good as in the camera."""
SIZE_SPREAD = 0.01
"""Spread of the sides, by which markers are of one size unless their corners say otherwise."""
GUESSING = 12
"""Pictures by which a guess of the focal length is chosen."""
MIN_RAYS = 3
"""Cameras that tell the size of a marker."""
MIN_PARALLAX = 0.01
"""Sine of the angle between their rays, at least."""
LARGEST = 10.0
"""Largest side of a marker in those of the others, or of the others in its."""
OTHER_SIZE_COSTS = 2.0
"""Residuals with a size of its own count so many times, as markers are mostly of one size."""
GOOD_PX = 0.3
"""Median residual that no marker has to be left out for, px."""
ODD_SHARE = 0.5
"""Share of the median residual that is left without a marker that moved."""
MAX_ODD = 12
"""Markers, those that are seen most, of which one may have moved."""
MISFIT = 0.01
"""Residual of the board's markers, in their side, from which it may be another: a print is truer.
"""
TRIED = 4
"""Markers whose poses are tried for a camera, and cameras for a marker's pose."""


@dataclass(frozen=True, slots=True)
class _Seen:
    """Markers seen in pictures: n times a marker in a picture."""

    views: NDArray[np.intp]
    """(n,) positions of pictures."""
    markers: NDArray[np.intp]
    """(n,) positions of markers."""
    pixels: FloatArray
    """(n, 4, 2): corners, pixel centres at i + 0.5."""

    def where(self, kept: NDArray[Any]) -> _Seen:
        """Return some of the rows."""
        return _Seen(self.views[kept], self.markers[kept], self.pixels[kept])


@dataclass(frozen=True, slots=True)
class _Solution:
    """Cameras and layout."""

    cameras: list[Perspective]
    bends: FloatArray
    """(m,): each camera's first radial coefficient."""
    views: FloatArray
    """(v, 6): rotation vector and translation, camera from world; nan: not placed."""
    markers: FloatArray
    """(k, 7): likewise, world from marker, and the logarithm of the marker's side."""


def survey_markers(paths: Sequence[Path]) -> tuple[str, float]:
    """Return the family of the markers in some of these pictures, "" without any, and the share of
    the pictures that show two of them or more.
    """
    names = list(FAMILIES)
    first = [_first_ids(number) for number in FAMILIES.values()]
    any_family = cv2.aruco.ArucoDetector(first)
    family, several = "", 0
    some = _some(paths)
    pictures = Pictures(some)
    for index in range(len(some)):
        grey = pictures.read(index)
        if grey is None:
            continue
        if family:
            ids = detector_of(family).detectMarkers(grey)[1]
        else:
            _, ids, _, families = any_family.detectMarkersMultiDict(grey)
            if ids is not None and len(ids):
                counts = np.bincount(np.ravel(families), minlength=len(names))
                family, ids = names[int(counts.argmax())], ids[families == counts.argmax()]
        several += ids is not None and len(ids) > 1
    return family, several / len(some)


def _some(paths: Sequence[Path]) -> list[Path]:
    at = np.linspace(0, len(paths) - 1, SURVEYED).astype(int)
    return [paths[index] for index in np.unique(at)]


def _first_ids(number: int) -> cv2.aruco.Dictionary:
    """Return a dictionary of the first markers, which those who print some begin with."""
    whole = cv2.aruco.getPredefinedDictionary(number)
    return cv2.aruco.Dictionary(
        whole.bytesList[:PRINTED], whole.markerSize, whole.maxCorrectionBits
    )


def detector_of(family: str, border: int = 0) -> cv2.aruco.ArucoDetector:
    """Return the detector of one of ``FAMILIES``; with the modules of a black border that of a
    grid, in which black squares between the markers touch their corners.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
    detector = cv2.aruco.ArucoDetector(dictionary)
    if border:
        parameters = detector.getDetectorParameters()
        parameters.markerBorderBits = border
        parameters.adaptiveThreshConstant = GRID_THRESHOLD
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        detector.setDetectorParameters(parameters)
    return detector


def find_markers(
    grey: Grey, detector: cv2.aruco.ArucoDetector
) -> tuple[dict[int, FloatArray], list[int]]:
    """Find the markers of a picture (height, width).

    Returns:
        Corners (4, 2) of each, OpenCV's pixels, by its number, and the numbers that are there more
        than once, whose markers are left out.
    """
    corners, ids, _ = detector.detectMarkers(grey)
    numbers = [int(number) for number in np.ravel(ids)] if ids is not None else []
    border = detector.getDetectorParameters().markerBorderBits
    share = 1.0 / (detector.getDictionary().markerSize + 2 * border)
    count = Counter(numbers)
    found = {
        number: refine_corners(grey, own[0].astype(float), share)
        for number, own in zip(numbers, corners, strict=True)
        if count[number] == 1
    }
    return found, [number for number in count if count[number] > 1]


def _detector_of_board(paths: Sequence[Path], family: str) -> cv2.aruco.ArucoDetector:
    """Return the detector by which most markers are found in some of the pictures."""
    pictures = Pictures(_some(paths))
    greys = [grey for i in range(len(pictures.paths)) if (grey := pictures.read(i)) is not None]
    detectors = [detector_of(family, border) for border in BORDERS]
    counts = [sum(len(one.detectMarkers(grey)[0]) for grey in greys) for one in detectors]
    return detectors[int(np.argmax(counts))]


def place_by_markers(
    tell: Tell, paths: Sequence[Path], known: Perspective | Undistortion | None, family: str,
    marker_size: float | None, board: MarkerBoard = NO_BOARD,
) -> Placement:  # fmt: skip
    """Find the cameras of pictures.

    Args:
        tell: takes lines on how far it is.
        paths: the pictures.
        known: their camera, with its lens; None: found with them.
        family: one of ``FAMILIES``.
        marker_size: side of the markers, black edge to black edge; None: lengths are in sides, or
            in the board's unit.
        board: places of some of the markers.

    Raises:
        SettingsError: too few pictures show markers.
    """
    pictures, notes = Pictures(paths, known), list[str]()
    found = dict[int, dict[int, FloatArray]]()
    twice = dict[int, list[str]]()
    detector = _detector_of_board(paths, family) if board.places else detector_of(family)
    for index, path in enumerate(paths):
        tell(f"markers {index + 1} of {len(paths)}")
        grey = pictures.read(index)
        if grey is None:
            continue
        corners, repeated = find_markers(grey, detector)
        for number in repeated:
            twice.setdefault(number, []).append(path.name)
        found[index] = {number: pictures.straighten(own) for number, own in corners.items()}
        if not found[index]:
            pictures.left_out[index] = f"no marker of {family} in it"
            del found[index]
    for number, names in twice.items():
        where = f"marker {number} is there twice in {list_names(names, 3)}"
        notes.append(f"{where} and is not used there; print each number once.")
    if len(found) < MIN_PICTURES:
        wanted = "wanted two or more: whole, unmirrored, with a white margin"
        raise SettingsError(f"{len(found)} of {len(paths)} pictures show markers; {wanted}.")
    layout = _MarkerLayout(tell, pictures, found, notes, _as_seen(board))
    return layout.placement(marker_size)


def _as_seen(board: MarkerBoard) -> MarkerBoard:
    """Return a board with its markers' frames as OpenCV has them, whose AprilTags lie on their
    heads.
    """
    if not board.family.startswith("AprilTag"):
        return board
    turn = RigidTransform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    return replace(board, places={number: at @ turn for number, at in board.places.items()})


Line = tuple[FloatArray, FloatArray]
"""A point (2,) of it, and its direction (2,)."""


def refine_corners(grey: Grey, corners: FloatArray, module_share: float) -> FloatArray:
    """Return where the lines along a marker's black sides meet, (4, 2) px as ``corners``.

    OpenCV's own corners are half a pixel off where a marker has some 30: its windows take in what
    is printed inside.

    Args:
        grey: picture (height, width).
        corners: (4, 2), OpenCV's pixels, off by a pixel or two.
        module_share: width of the black border in the marker's side.
    """
    for _ in range(REFINEMENTS):
        lines = [
            _side_line(grey, corners[side], corners[(side + 1) % 4], module_share)
            for side in range(4)
        ]
        found = np.array([_meeting(lines[side - 1], lines[side]) for side in range(4)])
        if not np.linalg.norm(found - corners, axis=1).max() < MAX_SHIFT_PX:
            return corners
        corners = found
    return corners


def _side_line(grey: Grey, start: FloatArray, end: FloatArray, module_share: float) -> Line:
    """Return the edge near a side, by its steepest places."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / max(length, 1e-9)
    outward = np.array([along[1], -along[0]])
    reach = float(np.clip(0.8 * module_share * length, 1.0, 4.0))
    shares = np.linspace(0.08, 0.92, int(np.clip(length, 8, 60)))
    middles = start + shares[:, None] * (end - start)
    offsets = np.arange(-reach, reach + 0.25, 0.5)
    at = (middles[:, None] + offsets[:, None] * outward).astype(np.float32)
    values = np.asarray(cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR), float)
    steps = np.maximum(np.diff(values, axis=1), 0.0) ** 2  # from black to white
    weights = steps.sum(axis=1)
    edge = steps @ (0.5 * (offsets[1:] + offsets[:-1])) / np.maximum(weights, 1e-9)
    off = np.abs(edge - np.median(edge))
    weights = np.where(off <= 3.0 * np.median(off) + 0.05, weights, 0.0)
    points = middles + edge[:, None] * outward
    middle = np.average(points, axis=0, weights=weights + 1e-9)
    spread = (points - middle) * np.sqrt(weights)[:, None]
    return middle, np.linalg.svd(spread)[2][0]


def _meeting(one: Line, other: Line) -> FloatArray:
    """Return the point (2,) where two lines meet; far away, if they do not."""
    directions = np.column_stack([one[1], -other[1]])
    if abs(np.linalg.det(directions)) < 1e-6:
        return np.full(2, np.inf)
    return one[0] + np.linalg.solve(directions, other[0] - one[0])[0] * one[1]


class _MarkerLayout:
    """The markers' places, solved from where pictures show them."""

    def __init__(
        self, tell: Tell, pictures: Pictures, found: Mapping[int, Mapping[int, FloatArray]],
        notes: list[str], board: MarkerBoard,
    ) -> None:  # fmt: skip
        self.tell, self.pictures, self.notes, self.board = tell, pictures, notes, board
        counts = Counter(number for own in found.values() for number in own)
        once = {number for number, count in counts.items() if count == 1} - board.places.keys()
        found = self._connected({
            index: {number: pixels for number, pixels in own.items() if number not in once}
            for index, own in found.items()
        })  # fmt: skip
        self.indices = list(found)
        counts = Counter(number for own in found.values() for number in own)
        self.numbers = [number for number, _ in counts.most_common()]
        at = {number: place for place, number in enumerate(self.numbers)}
        rows = [
            (view, at[number], pixels)
            for view, own in enumerate(found.values())
            for number, pixels in own.items()
        ]
        views, markers, pixels = zip(*rows, strict=True)
        self.seen = _Seen(np.array(views), np.array(markers), np.array(pixels))
        self.groups = np.array([pictures.camera_of[index] for index in self.indices])
        self.known = np.full((len(self.numbers), 7), np.nan)
        """(k, 7): markers of the board, as of ``_Solution``; nan: others."""
        self.side = float(np.median([*board.sides.values()])) if board.sides else 1.0
        """Length of the world's unit in the board's."""
        for number in at.keys() & board.places.keys():
            place, size = board.places[number], board.sides[number] / self.side
            pose = place.as_rotation_vector(), place.translation / self.side, [np.log(size)]
            self.known[at[number]] = np.concatenate(pose)
        self.is_known = ~np.isnan(self.known[:, 0])

    def _connected(
        self, found: Mapping[int, Mapping[int, FloatArray]]
    ) -> dict[int, Mapping[int, FloatArray]]:
        """Keep the most pictures that hang together by common markers."""
        alone = [index for index, own in found.items() if not own]
        self.pictures.left_out |= dict.fromkeys(alone, "its markers are in no other picture")
        indices = [index for index, own in found.items() if own]
        places = self.board.places
        # Markers of the board hang together: all are as the first.
        nodes = {
            index: {min(places) if number in places else number for number in found[index]}
            for index in indices
        }
        numbers = sorted(set[int]().union(*nodes.values()))
        if len(indices) < MIN_PICTURES:
            wanted = "wanted two pictures or more with a marker in common"
            raise SettingsError(f"{len(alone)} pictures show markers, no two the same; {wanted}.")
        links = [(i, numbers.index(n)) for i, index in enumerate(indices) for n in nodes[index]]
        rows, columns = np.array(links).T
        size = len(indices) + len(numbers)
        graph = coo_matrix((np.ones(len(links)), (rows, columns + len(indices))), (size, size))
        labels = connected_components(graph, directed=False)[1][: len(indices)]
        groups = [np.flatnonzero(labels == label) for label in dict.fromkeys(labels.tolist())]
        groups.sort(key=len, reverse=True)
        if places:
            with_board = [i for i, index in enumerate(indices) if min(places) in nodes[index]]
            if len(with_board) < MIN_PICTURES:
                wanted = "wanted two or more: is it this board?"
                raise SettingsError(f"{len(with_board)} pictures show the board; {wanted}")
            groups.sort(key=lambda group: labels[group[0]] != labels[with_board[0]])
        for group in groups[1:]:
            names = [self.pictures.paths[indices[i]].name for i in group]
            said = f"{len(groups[0])} pictures hang together, {len(group)} others among themselves"
            self.notes.append(f"{said}: {list_names(names, 4)}.")
            for i in group:
                self.pictures.left_out[indices[i]] = "it shares no marker with most pictures"
        return {indices[i]: found[indices[i]] for i in groups[0]}

    def placement(self, marker_size: float | None) -> Placement:
        """Solve, and say which markers have moved or are of other sizes."""
        step = -(-len(self.indices) // MAX_TOGETHER)
        part = self.seen.where(self.seen.views % step == 0)
        solution = self._solve(self._begin(part), part)
        solution, part = self._without_moved(solution, part)
        kept = self.seen.where(np.isin(self.seen.markers, part.markers))
        return self._placement(self._place_rest(solution, kept), kept, marker_size)

    def _begin(self, seen: _Seen) -> _Solution:
        """Place markers and cameras in turn, by the best guess of the focal lengths."""
        pinhole, own = self.pictures.pinhole, self.pictures.cameras
        guesses = [[pinhole] if pinhole is not None else own]
        if pinhole is None and not self.pictures.focals_px:
            guesses = [[_with_focal(one, factor) for one in own] for factor in GUESSES]
        if len(guesses) > 1:
            views = np.unique(seen.views)
            some = seen.where(np.isin(seen.views, views[:: -(-len(views) // GUESSING)]))
            costs = [self._cost(self._chain(guess, some), some) for guess in guesses]
            guesses = [guesses[int(np.argmin(costs))]]
        return self._chain(guesses[0], seen)

    def _cost(self, solution: _Solution, seen: _Seen, most_px: float = 50.0) -> float:
        residuals = self._residuals(solution, seen)
        return float(np.sum(np.minimum(np.nan_to_num(residuals, nan=most_px), most_px)))

    def _chain(self, cameras: list[Perspective], seen: _Seen) -> _Solution:
        """Place cameras by known markers and markers by known cameras, from the marker that is seen
        most on; then all again by all.
        """
        views, markers = np.full((len(self.indices), 6), np.nan), self.known.copy()
        if not self.is_known.any():
            markers[seen.markers.min()] = 0.0
        others = np.flatnonzero(np.isnan(markers[:, 0]))
        solution = _Solution(cameras, np.zeros(len(cameras)), views, markers)
        candidates = {row: self._candidates(solution, seen, row) for row in range(len(seen.views))}
        for _ in range(ROUNDS):
            todo = set(seen.views.tolist())
            while todo:
                known = ~np.isnan(markers[seen.markers, 0])
                counts = Counter(view for view in seen.views[known].tolist() if view in todo)
                if not counts:
                    break
                most = max(counts.values())
                for view in (view for view, number in counts.items() if number == most):
                    todo.discard(view)
                    rows = np.flatnonzero((seen.views == view) & known)
                    views[view] = self._camera_at(solution, seen, rows, candidates)
                for marker in np.unique(seen.markers[~known]):
                    self._place_marker(solution, seen, marker, candidates)
            for marker in others.tolist():
                self._place_marker(solution, seen, marker, candidates)
        return solution

    def _candidates(self, solution: _Solution, seen: _Seen, row: int) -> list[FloatArray]:
        """Both poses (6,), camera from marker, at which a marker looks about as it does."""
        matrix = _matrix(solution.cameras[self.groups[seen.views[row]]])
        how = cv2.SOLVEPNP_IPPE_SQUARE
        _, turns, moves, _ = cv2.solvePnPGeneric(CORNERS, seen.pixels[row], matrix, None, flags=how)
        return [_pose_of(*pose) for pose in zip(turns, moves, strict=True)]

    def _camera_at(
        self, solution: _Solution, seen: _Seen, rows: NDArray[np.intp],
        candidates: Mapping[int, Sequence[FloatArray]],
    ) -> FloatArray:  # fmt: skip
        """Return the pose (6,) of the camera in which some rows are, by their known markers."""
        view, some = seen.views[rows[0]], seen.where(rows)
        tried = [
            _joined(one, _inverse(solution.markers[seen.markers[row], :6]))
            for row in rows[:TRIED]
            for one in candidates[row]
        ]
        views = solution.views.copy()
        costs = list[float]()
        for views[view] in tried:
            costs.append(self._cost(replace(solution, views=views), some))
        start = tried[int(np.argmin(costs))]
        points = _corners(solution, seen.markers[rows]).reshape(-1, 3)
        matrix = _matrix(solution.cameras[self.groups[view]])
        pixels = seen.pixels[rows].reshape(-1, 2)
        turn, move = start[:3].copy(), start[3:].copy()
        return _pose_of(*cv2.solvePnPRefineLM(points, pixels, matrix, None, turn, move))

    def _place_marker(
        self, solution: _Solution, seen: _Seen, marker: int,
        candidates: Mapping[int, Sequence[FloatArray]],
    ) -> None:  # fmt: skip
        """Place a marker where all known cameras see it best, if any does; with a size of its own
        if that explains it much better.
        """
        rows = np.flatnonzero((seen.markers == marker) & ~np.isnan(solution.views[seen.views, 0]))
        if not len(rows):
            return
        own, markers = seen.where(rows), solution.markers.copy()
        best, least = solution.markers[marker].copy(), np.inf
        for row in rows[np.unique(np.linspace(0, len(rows) - 1, TRIED).astype(int))]:
            for one in candidates[row]:
                back = _inverse(solution.views[seen.views[row]])
                for size in (1.0, self._size_by_rays(solution, own, back, one[3:])):
                    place = _joined(back, np.concatenate([one[:3], size * one[3:]]))
                    markers[marker] = [*place, np.log(size)]
                    cost = self._cost(replace(solution, markers=markers), own)
                    cost *= 1.0 if size == 1.0 else OTHER_SIZE_COSTS
                    if cost < least:
                        best, least = markers[marker].copy(), cost
        solution.markers[marker] = best

    def _size_by_rays(
        self, solution: _Solution, own: _Seen, back: FloatArray, centre: FloatArray
    ) -> float:
        """Return the side of a marker with which its middle is where all cameras see it; 1 where
        they do not tell.

        Args:
            solution: known cameras.
            own: the marker in these.
            back: pose (6,), world from camera, of one of them.
            centre: (3,) of the marker in that camera, if its side is 1.
        """
        if len(own.views) < MIN_RAYS:
            return 1.0
        turns = _rotations(solution.views[own.views])
        starts = -np.einsum("nji,nj->ni", turns, solution.views[own.views, 3:])
        numbers = [solution.cameras[group] for group in self.groups[own.views]]
        flat = [c.rays(p.mean(axis=0)) for c, p in zip(numbers, own.pixels, strict=True)]
        rays = np.einsum("nji,nj->ni", turns, np.array(flat))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        along = cv2.Rodrigues(back[:3])[0] @ centre
        across = along - (rays @ along)[:, None] * rays
        if np.sum(across**2) < MIN_PARALLAX**2 * len(rays) * np.sum(along**2):
            return 1.0
        size = -float(np.sum(across * (back[3:] - starts)) / np.sum(across**2))
        return size if 1.0 / LARGEST < size < LARGEST else 1.0

    def _residuals(self, solution: _Solution, seen: _Seen) -> FloatArray:
        """(n, 4) px, of corners; nan where camera or marker is not placed."""
        return np.linalg.norm(self._shown(solution, seen) - seen.pixels, axis=2)

    def _shown(self, solution: _Solution, seen: _Seen) -> FloatArray:
        """Project the corners: (n, 4, 2), px, where cameras show them."""
        poses, groups = solution.views[seen.views], self.groups[seen.views]
        points = _corners(solution, seen.markers)
        points = np.einsum("nij,ncj->nci", _rotations(poses), points) + poses[:, None, 3:6]
        numbers = np.array([(one.fx, one.fy, one.cx, one.cy) for one in solution.cameras])[groups]
        depth = points[..., 2:]
        flat = points[..., :2] / np.where(np.abs(depth) < NEAR, NEAR, depth)
        bend = 1.0 + solution.bends[groups][:, None, None] * np.sum(flat**2, axis=2, keepdims=True)
        return flat * bend * numbers[:, None, :2] + numbers[:, None, 2:]

    def _solve(
        self, solution: _Solution, seen: _Seen, of_own_size: NDArray[np.bool_] | None = None,
        steps: int = MAX_STEPS,
    ) -> _Solution:  # fmt: skip
        """Solve for cameras, layout and, unless it is known, focal lengths and lenses at once; then
        again, with markers that have another size than most free to have it.
        """
        self.tell(f"solving for {len(np.unique(seen.views))} cameras")
        views, of_view = np.unique(seen.views, return_inverse=True)
        markers, of_marker = np.unique(seen.markers, return_inverse=True)
        tied = np.ones(len(markers)) if of_own_size is None else ~of_own_size
        is_free = self.pictures.pinhole is None
        of_lens = 2 * len(solution.cameras) if is_free else 0
        of_views = of_lens + 6 * len(views)
        free = np.ones((len(markers), 7), bool)
        free[self.is_known[markers]] = False
        if not self.is_known.any():  # the first is the world, of which the size alone is found
            free[0, :6] = False
        columns = np.where(free, of_views + np.cumsum(free).reshape(free.shape) - 1, -1)
        longest = np.array([max(one.width, one.height) for one in solution.cameras])

        def unpack(values: FloatArray) -> _Solution:
            cameras, bends = solution.cameras, solution.bends
            if is_free:
                focals = np.exp(values[:of_lens:2])
                cameras = [
                    _with_focal(one, float(focal))
                    for one, focal in zip(cameras, focals, strict=True)
                ]
                bends = values[1:of_lens:2]
            placed, layout = solution.views.copy(), solution.markers.copy()
            placed[views] = values[of_lens:of_views].reshape(-1, 6)
            own = layout[markers]
            own[free] = values[of_views:]
            layout[markers] = own
            return _Solution(cameras, bends, placed, layout)

        def residuals(values: FloatArray) -> FloatArray:
            now = unpack(values)
            off = (self._shown(now, seen) - seen.pixels).ravel()
            return np.concatenate([off, now.markers[markers, 6] * tied / SIZE_SPREAD])

        rows = np.arange(8 * len(seen.views)).reshape(-1, 8)
        depends = [of_lens + 6 * of_view[:, None] + np.arange(6), columns[of_marker]]
        if is_free:
            depends.append(2 * self.groups[seen.views][:, None] + np.arange(2))
        i, j = np.broadcast_arrays(rows[:, :, None], np.hstack(depends)[:, None])
        i = np.concatenate([i.ravel(), rows.size + np.arange(len(markers))])
        j = np.concatenate([j.ravel(), columns[:, 6]])
        i, j = i[j >= 0], j[j >= 0]
        shape = rows.size + len(markers), of_views + int(free.sum())
        focals = [one.fx / side for one, side in zip(solution.cameras, longest, strict=True)]
        intrinsics = np.column_stack([np.log(focals), solution.bends]) if is_free else np.zeros(0)
        begin = [intrinsics, solution.views[views], solution.markers[markers][free]]
        end = least_squares(
            residuals, np.concatenate([part.ravel() for part in begin]), loss="soft_l1",
            jac_sparsity=coo_matrix((np.ones(len(i)), (i, j)), shape), f_scale=ROBUST_PX,
            x_scale="jac", max_nfev=steps,
        )  # fmt: skip
        solution = unpack(end.x)
        other = is_of_other_size(solution.markers[markers, 6])
        if of_own_size is None and other.any():
            return self._solve(solution, seen, other, steps)
        return solution

    def _without_moved(self, solution: _Solution, seen: _Seen) -> tuple[_Solution, _Seen]:
        """Leave out markers without which the others fit better by far, and say so."""
        while True:
            markers = np.unique(seen.markers)
            others = markers[~self.is_known[markers]][:MAX_ODD]
            usual = float(np.median(self._residuals(solution, seen)))
            if usual < GOOD_PX or len(markers) <= 2 or not len(others):
                return solution, seen
            views = np.unique(seen.views)
            some = seen.where(np.isin(seen.views, views[:: -(-len(views) // GUESSING)]))
            left = dict[int, float]()
            for marker in others.tolist():
                rest = some.where(some.markers != marker)
                tried = self._solve(solution, rest, steps=FEW_STEPS)
                left[marker] = float(np.median(self._residuals(tried, rest)))
            odd = min(left, key=left.__getitem__)
            if left[odd] > ODD_SHARE * usual:
                return solution, seen
            found = f"marker {self.numbers[odd]} did not stay in its place, or is not flat"
            self.notes.append(f"{found}; it is not used.")
            seen = seen.where(seen.markers != odd)
            solution = self._solve(self._begin(seen), seen)

    def _place_rest(self, solution: _Solution, seen: _Seen) -> _Solution:
        """Place the cameras that are not yet, by the layout."""
        views = solution.views.copy()
        pixels = np.empty_like(seen.pixels)
        for number, (camera, bend) in enumerate(zip(solution.cameras, solution.bends, strict=True)):
            own = self.groups[seen.views] == number
            lens, matrix = np.array([bend, 0.0, 0.0, 0.0]), _matrix(camera)
            flat = cv2.undistortPoints(seen.pixels[own].reshape(-1, 1, 2), matrix, lens, P=matrix)
            pixels[own] = np.reshape(flat, (-1, 4, 2))
        flat, pinholes = replace(seen, pixels=pixels), replace(solution, bends=0.0 * solution.bends)
        rest = np.flatnonzero(np.isnan(views[:, 0]))
        for count, view in enumerate(rest):
            self.tell(f"placed {count + 1} of {len(rest)} between")
            rows = np.flatnonzero(seen.views == view)
            if len(rows):
                candidates = {r: self._candidates(pinholes, flat, r) for r in rows.tolist()}
                views[view] = self._camera_at(pinholes, flat, rows, candidates)
        return replace(solution, views=views)

    def _placement(self, solution: _Solution, seen: _Seen, marker_size: float | None) -> Placement:
        pictures, notes = self.pictures, self.notes
        markers = np.unique(seen.markers)
        sizes = solution.markers[markers, 6]
        other = is_of_other_size(sizes)
        usual = 1.0 if self.board.places else float(np.exp(np.mean(sizes[~other])))
        for marker, size in zip(markers[other], sizes[other], strict=True):
            if not self.board.places:
                ratio = float(np.exp(size)) / usual
                said = f"marker {self.numbers[marker]} has {ratio:.2f} times the side of most"
                notes.append(f"{said}, which the given size is taken for.")
        residuals = self._residuals(solution, seen)
        notes += self._misfit(residuals, seen)
        has_unit = self.board.unit is not None
        scale = self.side if has_unit else (marker_size or 1.0) / usual
        placed = dict[int, Placed]()
        for view, index in enumerate(self.indices):
            own, pose = residuals[seen.views == view], solution.views[view]
            if np.isnan(pose[0]):
                pictures.left_out[index] = "no marker in it that stayed in its place"
                continue
            place = RigidTransform.from_rotation_vector(pose[:3], scale * pose[3:])
            group = self.groups[view]
            camera, bend = solution.cameras[group], float(solution.bends[group])
            placed[index] = pictures.placed(camera, (bend,), place, float(np.median(own)))
        is_known = has_unit or marker_size is not None
        return Placement(
            placed, pictures.left_out, pictures.sha256s, pictures.focals_px, is_known, tuple(notes)
        )

    def _misfit(self, residuals: FloatArray, seen: _Seen) -> list[str]:
        """Say that the board does not fit what is seen of it."""
        own = self.is_known[seen.markers]
        sides = np.linalg.norm(seen.pixels[:, 0] - seen.pixels[:, 1], axis=1)
        share = float(np.nanmedian((residuals / sides[:, None])[own])) if own.any() else 0.0
        if share < MISFIT:
            return []
        found = f"the board's markers are {100.0 * share:.0f} % of their side beside where it says"
        return [f"{found}: are its numbers those of this print?"]


def is_of_other_size(sizes: FloatArray) -> NDArray[np.bool_]:
    """Tell which markers have another size than most; ``sizes``: logarithms of their sides."""
    alike = np.abs(sizes[:, None] - sizes) < np.log(SIZE_RATIO)
    return ~alike[int(alike.sum(axis=1).argmax())]


def _with_focal(camera: Perspective, factor: float) -> Perspective:
    """Return the camera with a focal length in its picture's longer sides."""
    focal = factor * max(camera.width, camera.height)
    return replace(camera, fx=focal, fy=focal)


def _matrix(camera: Perspective) -> FloatArray:
    """Return the matrix (3, 3), pixel centres at i + 0.5."""
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def _rotations(poses: FloatArray) -> FloatArray:
    """(n, 3, 3), of poses (n, 6)."""
    return Rotation.from_rotvec(np.nan_to_num(poses[:, :3])).as_matrix()


def _corners(solution: _Solution, markers: NDArray[np.intp]) -> FloatArray:
    """Corners (n, 4, 3) of markers, in the world."""
    own = solution.markers[markers]
    points = np.exp(own[:, 6])[:, None, None] * CORNERS
    return np.einsum("nij,ncj->nci", _rotations(own), points) + own[:, None, 3:6]


def _pose_of(turn: Any, move: Any) -> FloatArray:
    """Return the pose (6,) of OpenCV's rotation vector and translation."""
    return np.concatenate([np.ravel(turn), np.ravel(move)])


def _joined(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the pose (6,) that is ``first`` after ``second``."""
    return _pose_of(*cv2.composeRT(second[:3], second[3:], first[:3], first[3:])[:2])


def _inverse(pose: FloatArray) -> FloatArray:
    return np.concatenate([-pose[:3], -cv2.Rodrigues(pose[:3])[0].T @ pose[3:]])
