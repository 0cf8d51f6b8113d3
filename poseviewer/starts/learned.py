"""Rectangles that may hold the model, anywhere in a photo, by a network's features.

Patches of the photo and of a view of the model that are each other's nearest, by the features of a
DINOv2 backbone, vote for the place and size of a rectangle. Unlike the registration, this start
stands on training.
"""

import hashlib
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import cv2
import numpy as np
import platformdirs
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import hull_points
from poseviewer.geometry.rectangle import Rectangle, non_maximum_suppression
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import Renderer
from poseviewer.render.renderers import make_renderer
from poseviewer.starts.dino_features import PATCH_PX, PatchEncoder, unit
from poseviewer.starts.start import StartInputs
from poseviewer.starts.views import ground_views, look_along

MAX_RECTANGLES = 6
"""Rectangles to search, 1 s each: later ones are hardly ever right."""
VIEW_PATCHES = 10
"""Side of the picture of a view, patches: as many as most objects have in a photo."""
VIEW_PX = VIEW_PATCHES * PATCH_PX
"""Side of that picture, px."""
VIEW_CAMERA = Perspective(4000.0, 4000.0, 0.0, 0.0, 1, 1)
"""Camera of views, four diameters from the model, before it is cut to the outline."""
MAX_SQUARE_PX = 10_000
"""Largest side of a square of the photo that is compared."""
FILLED = 0.82
"""Share of a view's picture that the longer side of the model takes."""
PHOTO_PATCHES = (37, 52)
"""Longer sides of the photo, patches; in the larger one a window has more of them."""
MIN_WINDOW_PATCHES = 7.0
"""Smallest side of a window for which the smaller photo does, patches."""
WINDOW_SIDES = 0.05 * 1.25 ** np.arange(13)
"""Sides of windows, made square, as shares of the photo's longer side."""
TOUCHED = 0.3
"""Share of a patch that the model covers from which it is in the box of the view's outline."""
COVERED = 0.5
"""Share of a patch that the model covers from which it is matched."""
SIGMA = 0.1
"""Standard deviation of the votes' kernel, as a share of the window's side."""
MIN_SIGMA = 0.7
"""Smallest standard deviation of that kernel, patches."""
PEAKS = 5
"""Windows of each view and size that are kept."""
MAX_OVERLAP = 0.5
"""Largest intersection over union of two rectangles."""


class _ViewFeatures(NamedTuple):
    """Features of a view of a model: of its n patches that the model covers."""

    vectors: NDArray[np.float32]
    """(n, d): unit vectors."""
    offsets: FloatArray
    """(n, 2): x and y from the middle of the outline's box, in sides of the box, made square."""
    shape: FloatArray
    """(2,): width and height of the box, in the same unit."""


class _Window(NamedTuple):
    """A window of the photo, in shares of its longer side, and the votes for it."""

    box: Rectangle
    votes: float


def propose_rectangles(
    inputs: StartInputs, encoder: PatchEncoder, watch: Callable[[], object] = lambda: None
) -> list[Rectangle]:
    """Find up to ``MAX_RECTANGLES`` rectangles that may hold the model, the likeliest first.

    Args:
        inputs: photo and model.
        encoder: network that gives features of patches.
        watch: called between steps; it may raise to stop.
    """
    found = list[_Window]()
    views = _view_features(inputs, encoder, watch)
    is_large = WINDOW_SIDES * PHOTO_PATCHES[0] >= MIN_WINDOW_PATCHES
    for pieces, (patches, sides) in enumerate(
        zip(PHOTO_PATCHES, (WINDOW_SIDES[is_large], WINDOW_SIDES[~is_large]), strict=True), 1
    ):
        picture = _scale_photo(inputs, patches)
        height, width = (side // PATCH_PX for side in picture.shape[:2])
        corners = list(product(_pieces(height, pieces), _pieces(width, pieces)))
        tiles = [picture[_in_pixels(rows), _in_pixels(columns)] for rows, columns in corners]
        parts = encoder.encode_all(tiles, watch)
        grid = np.zeros((height, width, parts[0].shape[2]), np.float32)
        for corner, part in zip(corners, parts, strict=True):
            grid[corner] = part
        for view in views:
            watch()
            found += _vote(grid, view, sides)
    scale = max(inputs.photo.width, inputs.photo.height)

    def overlap(a: _Window, b: _Window) -> bool:
        common = a.box.intersection(b.box).area
        return common > MAX_OVERLAP * (a.box.area + b.box.area - common)

    best_first = sorted(found, key=lambda window: -window.votes)
    best = non_maximum_suppression(best_first, overlap, MAX_RECTANGLES)
    return [Rectangle(*(scale * side for side in window.box)) for window in best]


def _vote(grid: NDArray[np.float32], view: _ViewFeatures, sides: NDArray[Any]) -> Iterator[_Window]:
    """Yield windows of each size that most mutual matches of a view's patches agree on.

    A match votes, with its cosine, for the middle of the window. The votes' density is weighted by
    the width of the kernel: windows that are larger have more patches, farther from each other.
    """
    height, width, length = grid.shape
    cosines = grid.reshape(-1, length) @ view.vectors.T
    matches, back = cosines.argmax(axis=1), cosines.argmax(axis=0)
    patches = np.flatnonzero(back[matches] == np.arange(len(matches)))
    weights, offsets = cosines.max(axis=1)[patches], view.offsets[matches[patches]]
    middles = np.column_stack([patches % width, patches // width]) + 0.5
    longer = max(height, width)
    for side in sides * longer:
        x, y = (middles - side * offsets).T
        w, h = side * view.shape
        is_inside = (x >= 0.0) & (y >= 0.0) & (x < width) & (y < height)
        if w > width or h > height:
            continue
        at = width * y[is_inside].astype(int) + x[is_inside].astype(int)
        votes = np.bincount(at, weights[is_inside], height * width).astype(float)
        sigma = max(MIN_SIGMA, SIGMA * side)
        votes = sigma * cv2.GaussianBlur(votes.reshape(height, width), (0, 0), sigma).ravel()
        for peak in np.argpartition(votes, -PEAKS)[-PEAKS:]:
            corner = peak % width + 0.5 - w / 2.0, peak // width + 0.5 - h / 2.0
            box = Rectangle(*(float(number) / longer for number in (*corner, w, h)))
            yield _Window(box, float(votes[peak]))


def compare_with_photo(
    inputs: StartInputs,
    encoder: PatchEncoder,
    poses: Sequence[Pose],
    watch: Callable[[], object] = lambda: None,
) -> list[float]:
    """Return how much the model looks like the photo at poses: -1 to 1, above 0.5 where it is.

    Each is the mean cosine of features of the photo and of the drawn model, over the patches that
    the model covers in a square about its outline.

    Args:
        inputs: photo and model.
        encoder: network that gives features of patches.
        poses: poses to compare.
        watch: called between steps; it may raise to stop.
    """
    photo, cosines = _mask_photo(inputs), list[float]()
    renderer, points = make_renderer(inputs.mesh), hull_points(inputs.mesh)
    for pose in poses:
        near, box = _close_up(pose, points)
        view, share = _draw(renderer, near)
        inside = box.intersection(Rectangle(0, 0, photo.shape[1], photo.shape[0]))
        square = np.full((int(box.height), int(box.width), 3), 128, np.uint8)
        if inside.area > 0.0:
            square[_slices(inside, box)] = photo[_slices(inside, Rectangle(0, 0, 0, 0))]
        pair = encoder.encode_all([view, _resize(square, (VIEW_PX, VIEW_PX))], watch)
        covered = (pair[0] * pair[1]).sum(axis=2)[share > COVERED]
        cosines.append(float(covered.mean()) if len(covered) else -1.0)
    return cosines


def _slices(piece: Rectangle, origin: Rectangle) -> tuple[slice, slice]:
    """Return the rows and columns of a rectangle in a picture with another one's corner."""
    left, top = int(piece.left - origin.left), int(piece.top - origin.top)
    return slice(top, top + int(piece.height)), slice(left, left + int(piece.width))


def _mask_photo(inputs: StartInputs) -> NDArray[np.uint8]:
    """Return the photo, grey where it does not count."""
    photo = inputs.photo
    picture = photo.as_rgb8(photo.width, photo.height)
    if inputs.mask is None:
        return picture
    return np.where(inputs.mask.weights[..., None] > 0.0, picture, np.uint8(128))


def _scale_photo(inputs: StartInputs, patches: int) -> NDArray[np.uint8]:
    """Return the photo, grey where it does not count, with so many patches on its longer side."""
    picture = _mask_photo(inputs)
    scale = patches / max(picture.shape)
    width, height = (PATCH_PX * max(1, round(scale * side)) for side in picture.shape[1::-1])
    return _resize(picture, (width, height))


def _resize(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    how = cv2.INTER_AREA if size[0] < picture.shape[1] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.uint8)


def _pieces(side: int, count: int) -> list[slice]:
    """Divide a side into pieces that overlap by some patches where there are several."""
    length = min(side, -(-(side + 3 * (count - 1)) // count))
    return [slice(int(a), int(a) + length) for a in np.linspace(0, side - length, count)]


def _in_pixels(patches: slice) -> slice:
    return slice(PATCH_PX * patches.start, PATCH_PX * patches.stop)


def _view_features(
    inputs: StartInputs, encoder: PatchEncoder, watch: Callable[[], object]
) -> list[_ViewFeatures]:
    """Return the features of the model's views, kept on disk by pictures and weights."""
    pictures, shares = _render_views(inputs)
    digest = hashlib.sha256(pictures.tobytes() + encoder.digest).hexdigest()
    folder = platformdirs.user_cache_path("poseviewer", appauthor=False) / "views"
    path, grids = folder / f"{digest[:32]}.npy", None
    with suppress(OSError, ValueError):  # none, or damaged
        grids = np.load(path, allow_pickle=False)
    if grids is None:
        grids = np.array(encoder.encode_all(list(pictures), watch), np.float16)
        with suppress(OSError):  # a disk that is full, or a folder that is not ours
            folder.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(f".{os.getpid()}")
            with part.open("wb") as opened:
                np.save(opened, grids)
            part.replace(path)
    views = list[_ViewFeatures]()
    for grid, share in zip(grids, shares, strict=True):
        patches = np.argwhere(share > COVERED)
        if not len(patches):  # a wire, say
            continue
        box = np.argwhere(share > TOUCHED)[:, ::-1]
        low, high = box.min(axis=0), box.max(axis=0) + 1.0
        side = math.sqrt(np.prod(high - low))
        vectors = unit(grid[*patches.T].astype(np.float32))
        offsets = (patches[:, ::-1] + 0.5 - (low + high) / 2.0) / side
        views.append(_ViewFeatures(vectors, offsets, (high - low) / side))
    return views


def _render_views(inputs: StartInputs) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return pictures (n, side, side, 3) of views, and how far patches (n, 10, 10) are covered."""
    mesh, keypoints = inputs.mesh, inputs.keypoints
    renderer, points = make_renderer(mesh), hull_points(mesh)
    if keypoints is None:
        rotations = [look_along(forward, np.array([0.0, 0.0, 1.0])) for forward in _directions()]
    else:
        rotations = list(ground_views(keypoints)[::6])
    pictures, shares = list[NDArray[np.uint8]](), list[NDArray[np.float32]]()
    for rotation in rotations:
        translation = np.array([0.0, 0.0, 4.0 * mesh.diameter]) - rotation @ mesh.centre
        pose = Pose(VIEW_CAMERA, RigidTransform(rotation, translation))
        picture, share = _draw(renderer, _close_up(pose, points)[0])
        pictures.append(picture)
        shares.append(share)
    return np.array(pictures), np.array(shares)


def _close_up(pose: Pose, points: FloatArray) -> tuple[Pose, Rectangle]:
    """Return a pose in a picture of a view, and the square about the outline that it shows."""
    outline = pose.project(points)
    low, high = outline.min(axis=0), outline.max(axis=0)
    side = max(1, round(min(max(high - low) / FILLED, MAX_SQUARE_PX)))
    left, top = map(round, (low + high - side) / 2.0)
    camera = pose.camera.crop(left, top, (side, side)).rescale(2.0 * VIEW_PX / side)
    return replace(pose, camera=camera), Rectangle(left, top, side, side)


def _draw(renderer: Renderer, pose: Pose) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Draw the model lit from the camera at half the size; return how far patches are covered."""
    image = renderer.render(pose)
    lit = image.reflectance * (0.5 + 0.5 * np.abs(image.normals[..., 2:]))
    picture = np.where(image.mask[..., None], np.clip(lit, 0.0, 1.0), 0.5)
    half = _resize((255.0 * picture).round().astype(np.uint8), (VIEW_PX, VIEW_PX))
    share = cv2.resize(image.mask.astype(np.float32), (VIEW_PATCHES, VIEW_PATCHES),
                       interpolation=cv2.INTER_AREA)  # fmt: skip
    return half, np.asarray(share, np.float32)


def _directions() -> FloatArray:
    """Return (42, 3): an icosahedron's vertices and the middles of its edges, none along z."""
    a, b = 1.0, (1.0 + 5.0**0.5) / 2.0
    corners = [(s * a, t * b, 0.0) for s in (-1, 1) for t in (-1, 1)]
    corners = np.array([np.roll(corner, turn) for corner in corners for turn in range(3)])
    first, second = np.triu_indices(len(corners), 1)
    is_edge = np.linalg.norm(corners[first] - corners[second], axis=1) < 2.1 * a
    middles = (corners[first] + corners[second])[is_edge] / 2.0
    directions = np.concatenate([corners, middles]) + 1e-3
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
