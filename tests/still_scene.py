"""A still scene, drawn: printed boxes on a table in a room, and markers, seen by known cameras."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.files.photo import save_image
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from tests.lenses import as_taken

CAMERA = Perspective(300.0, 300.0, 160.0, 120.0, 320, 240)
SUPERSAMPLING = 3
TEXEL_M = 0.002
"""Side of a texel of the prints, m: about a pixel."""
MARKER = 0.08
"""Side of a marker, m."""
MARGIN = 0.25
"""White about a marker, in its side."""


@dataclass(frozen=True)
class Sheet:
    """A printed rectangle."""

    corners: FloatArray
    """(4, 3) m: upper left, upper right, lower right, lower left of the print, seen from in front.
    """
    print_: NDArray[np.uint8]
    """(h, w, 3) RGB."""

    def moved(self, by: RigidTransform) -> "Sheet":
        return Sheet(by.apply(self.corners), self.print_)


Solid = tuple[Sheet, ...]
"""Sheets of which none hides another that is seen from in front."""


def noise(width_m: float, height_m: float, seed: int, contrast: float = 1.0) -> NDArray[np.uint8]:
    """Return a print of blobs of all sizes."""
    random = np.random.default_rng(seed)
    size = max(8, round(width_m / TEXEL_M)), max(8, round(height_m / TEXEL_M))
    total = np.zeros((size[1], size[0], 3), np.float32)
    for blob in (4, 8, 16, 32):
        shape = -(-size[1] // blob) + 1, -(-size[0] // blob) + 1, 3
        coarse = random.normal(size=shape).astype(np.float32)
        total += cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    return np.clip(128.0 + 40.0 * contrast * total, 0.0, 255.0).astype(np.uint8)


def sheet(centre: ArrayLike, right: ArrayLike, up: ArrayLike, print_: NDArray) -> Sheet:
    """Return a sheet whose half sides are ``right`` and ``up``."""
    middle, x, y = (np.array(one, float) for one in (centre, right, up))
    corners = np.array([middle - x + y, middle + x + y, middle + x - y, middle - x - y])
    return Sheet(corners, print_)


def box(centre: ArrayLike, size: Sequence[float], seed: int) -> Solid:
    """Return a printed box."""
    sheets = []
    for axis in range(3):
        for side in (1.0, -1.0):
            out, right, up = np.zeros(3), np.zeros(3), np.zeros(3)
            out[axis] = side * size[axis] / 2.0
            x, y = (axis + 1) % 3, (axis + 2) % 3
            right[x], up[y] = side * size[x] / 2.0, size[y] / 2.0
            print_ = noise(size[x], size[y], 10 * seed + 2 * axis + (side > 0.0))
            sheets.append(sheet(np.add(centre, out), right, up, print_))
    return tuple(sheets)


def marker(
    number: int, x: float, y: float, side: float = MARKER, turn_deg: float = 0.0,
    family: int = cv2.aruco.DICT_APRILTAG_36H11, mirrored: bool = False, border: int = 1,
    margin: float = MARGIN, corners: int = 255,
) -> Solid:  # fmt: skip
    """Return a marker that lies on the table, with its margin, whose ``corners`` are so bright."""
    dictionary = cv2.aruco.getPredefinedDictionary(family)
    drawn = np.asarray(cv2.aruco.generateImageMarker(dictionary, number, 160, borderBits=border))
    edge = round(160 * margin)
    drawn = np.pad(drawn, edge, constant_values=255)
    drawn[np.ix_(*[[*range(edge), *range(160 + edge, 160 + 2 * edge)]] * 2)] = corners
    drawn = drawn[:, ::-1] if mirrored else drawn
    half, turn = side * (0.5 + margin), np.radians(turn_deg)
    right = half * np.array([np.cos(turn), np.sin(turn), 0.0])
    up = half * np.array([-np.sin(turn), np.cos(turn), 0.0])
    return (sheet((x, y, 0.001), right, up, np.repeat(drawn[..., None], 3, axis=2)),)


@cache
def room(seed: int = 0, contrast: float = 1.0) -> Solid:
    """Return a wall behind a table."""
    wall, top = noise(3.2, 1.8, seed, contrast), noise(1.6, 1.2, seed + 1, contrast)
    return (
        sheet((0.0, 0.9, 0.4), (1.6, 0.0, 0.0), (0.0, 0.0, 0.9), wall),
        sheet((0.0, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 0.6, 0.0), top),
    )


BOXES = (
    box((-0.15, 0.05, 0.06), (0.16, 0.1, 0.12), 3),
    box((0.14, 0.12, 0.09), (0.12, 0.12, 0.18), 4),
    box((0.05, -0.12, 0.04), (0.2, 0.08, 0.08), 5),
)
PLACES = ((-0.3, -0.2), (0.3, -0.2), (0.0, 0.0), (-0.3, 0.25), (0.3, 0.3))
MARKERS = tuple(marker(n, x, y, turn_deg=40.0 * n) for n, (x, y) in enumerate(PLACES))


def look_at(turn_deg: float, height: float = 0.55, distance: float = 0.85) -> RigidTransform:
    """Return ``camera_from_world`` of a camera on an arc about the table, which it looks at."""
    turn = np.radians(turn_deg)
    eye = np.array([distance * np.sin(turn), -distance * np.cos(turn), height])
    ahead = np.array([0.0, 0.05, 0.05]) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    return RigidTransform(rotation, -rotation @ eye)


def arc(count: int, degrees: float = 50.0) -> list[RigidTransform]:
    """Return cameras on an arc, which rises and falls."""
    shares = np.linspace(0.0, 1.0, count)
    return [
        look_at(degrees * (share - 0.5), 0.55 + 0.08 * np.sin(6.0 * share), 0.85 + 0.06 * share)
        for share in shares
    ]


def spin(count: int, degrees: float = 30.0) -> list[RigidTransform]:
    """Return cameras that turn on the spot."""
    first = look_at(0.0)
    angles = np.radians(np.linspace(-degrees / 2.0, degrees / 2.0, count))
    return [RigidTransform.from_rotation_vector([0.0, a, 0.0], np.zeros(3)) @ first for a in angles]


def draw(
    solids: Sequence[Solid], camera_from_world: RigidTransform, camera: Perspective = CAMERA,
    seed: int = 0,
) -> NDArray[np.uint8]:  # fmt: skip
    """Draw solids, later ones over earlier ones; noise is the sensor's, a seed each picture."""
    fine = camera.rescale(SUPERSAMPLING)
    picture = np.full((fine.height, fine.width, 3), 60, np.uint8)
    for solid in solids:
        for one in solid:
            corners = camera_from_world.apply(one.corners)
            across = np.cross(corners[1] - corners[0], corners[3] - corners[0])
            if across @ corners[0] <= 0.0:  # seen from behind
                continue
            assert corners[:, 2].min() > 0.0
            height, width = one.print_.shape[:2]
            own = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32) - 0.5
            shown = (fine.project(corners) - 0.5).astype(np.float32)
            matrix, size = cv2.getPerspectiveTransform(own, shown), (fine.width, fine.height)
            drawn = cv2.warpPerspective(
                one.print_, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            inside = np.zeros(picture.shape[:2], np.uint8)
            cv2.fillConvexPoly(inside, np.rint(16.0 * shown).astype(np.int32), 1, shift=4)
            cv2.copyTo(drawn, inside, picture)
    size = camera.width, camera.height
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(float)
    grain = np.random.default_rng(seed).normal(0.0, 1.5, small.shape)
    return np.clip(np.rint(small + grain), 0.0, 255.0).astype(np.uint8)


def in_order(camera_from_world: RigidTransform, solids: Sequence[Solid]) -> list[Solid]:
    """Sort solids by their distance, the farthest first."""

    def away(solid: Solid) -> float:
        corners = np.concatenate([one.corners for one in solid])
        return -float(np.linalg.norm(camera_from_world.apply(corners.mean(axis=0))))

    return sorted(solids, key=away)


def write_pictures(
    folder: Path, cameras: Sequence[RigidTransform], markers: Sequence[Solid] = (),
    boxes: Sequence[Solid] = BOXES, camera: Perspective = CAMERA, contrast: float = 1.0,
    change: Callable[[int, list[Solid]], list[Solid]] = lambda _, solids: solids,
    lens: Undistortion | None = None,
) -> list[Path]:  # fmt: skip
    """Write the pictures that cameras take.

    Args:
        folder: where they are written, as PNG.
        cameras: ``camera_from_world``.
        markers: on the table.
        boxes: on it, too.
        camera: of all pictures.
        contrast: of room and table.
        change: what else is there in a picture, by its index.
        lens: of the camera.
    """
    folder.mkdir(exist_ok=True)
    paths = []
    for index, place in enumerate(cameras):
        solids = [room(contrast=contrast), *markers, *in_order(place, boxes)]
        paths.append(folder / f"{index:04d}.png")
        drawn = draw(change(index, solids), place, camera, index)
        save_image(paths[-1], drawn if lens is None else as_taken(lens, drawn))
    return paths


def errors(
    found: Sequence[RigidTransform], true: Sequence[RigidTransform], scale: float | None = None
) -> tuple[float, float]:
    """Return the largest errors of camera motions: degrees, and % of the distance to the table.

    Both worlds are laid onto one another at the middle picture; a scale that is not known is that
    of the cameras' places.
    """
    at = len(true) // 2
    moved = [place @ found[at].inverse() for place in found]
    wanted = [place @ true[at].inverse() for place in true]
    mine, theirs = (np.array([p.inverse().translation for p in ps]) for ps in (moved, wanted))
    if scale is None:
        scale = float(np.sum(mine * theirs) / np.sum(mine * mine))
    turned = [rotation_angle(a.rotation, b.rotation) for a, b in zip(moved, wanted, strict=True)]
    off = np.linalg.norm(scale * mine - theirs, axis=1).max() / np.linalg.norm(true[at].translation)
    return float(np.degrees(max(turned))), 100.0 * float(off)
