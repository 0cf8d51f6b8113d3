"""Rectangles that may hold the model, anywhere in a photo, by a network's features.

A DINOv2 backbone (M. Oquab et al., TMLR 2024) gives a vector for each patch of 14 px. Patches of
the photo and of a view of the model that are each other's nearest vote for the place and size of a
rectangle. Unlike the registration, this start stands on training.
"""

import hashlib
import math
import os
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import platformdirs
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.files.checks import InputFile
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import hull_points
from poseviewer.geometry.rectangle import Rectangle, non_maximum_suppression
from poseviewer.geometry.transform import RigidTransform
from poseviewer.processes import call_in_subprocess
from poseviewer.render.renderers import make_renderer
from poseviewer.starts.loading import StartInputs
from poseviewer.starts.views import ground_views, look_along

MAX_RECTANGLES = 4
"""Rectangles to search: each takes 2 to 4 s."""
MAX_FILE_BYTES = 400_000_000
"""Largest file of a network: DINOv2's base has 350 MB."""
MAX_SECONDS = 300.0
"""Longest time of a process that runs the network on some pictures."""
MAX_MEMORY_BYTES = 8 << 30
"""Largest memory of that process."""
LAYER_OUTPUT = rb"[\w./]*(?:layer|blocks)[./]8/Add_1_output_0"
"""Name of the ninth block's output as PyTorch exports it: it was better than the last's."""
WANTED = "wanted DINOv2's small or base backbone for pictures (1, 3, height, width) of any size"
"""Demand of errors."""
PATCH_PX = 14
"""Side of a patch that has a feature vector."""
VIEW_PATCHES = 16
"""Side of the picture of a view, patches."""
FILLED = 0.82
"""Share of a view's picture that the longer side of the model takes."""
PICTURES_PER_CALL = 32
"""Pictures that a process takes at a time: stopping waits for them."""
PHOTO_PATCHES = (37, 74)
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
MEAN = np.array([0.485, 0.456, 0.406], np.float32)
"""Mean RGB of the pictures that the network was trained on: ImageNet's."""
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
"""Standard deviation of RGB in these."""


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
    inputs: StartInputs, network: Path, watch: Callable[[], object] = lambda: None
) -> list[Rectangle]:
    """Find up to ``MAX_RECTANGLES`` rectangles that may hold the model, the likeliest first.

    Args:
        inputs: photo and model.
        network: ONNX file of a DINOv2 backbone.
        watch: called between steps; it may raise to stop.

    Raises:
        SettingsError: the file cannot be used.
    """
    views, found = _view_features(inputs, network, watch), list[_Window]()
    is_large = WINDOW_SIDES * PHOTO_PATCHES[0] >= MIN_WINDOW_PATCHES
    for pieces, (patches, sides) in enumerate(
        zip(PHOTO_PATCHES, (WINDOW_SIDES[is_large], WINDOW_SIDES[~is_large]), strict=True), 1
    ):
        picture = _scale_photo(inputs, patches)
        height, width = (side // PATCH_PX for side in picture.shape[:2])
        corners = list(product(_pieces(height, pieces), _pieces(width, pieces)))
        tiles = [picture[_in_pixels(rows), _in_pixels(columns)] for rows, columns in corners]
        parts = _features(network, tiles, watch)
        grid = np.zeros((height, width, parts[0].shape[2]), np.float32)
        for corner, features in zip(corners, parts, strict=True):
            grid[corner] = _unit(features)
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
        votes = np.bincount(at, weights[is_inside], height * width).reshape(height, width)
        sigma = max(MIN_SIGMA, SIGMA * side)
        votes = sigma * cv2.GaussianBlur(votes, (0, 0), sigma).ravel()
        for peak in np.argpartition(votes, -PEAKS)[-PEAKS:]:
            corner = peak % width + 0.5 - w / 2.0, peak // width + 0.5 - h / 2.0
            box = Rectangle(*(float(number) / longer for number in (*corner, w, h)))
            yield _Window(box, float(votes[peak]))


def _scale_photo(inputs: StartInputs, patches: int) -> NDArray[np.uint8]:
    """Return the photo, grey where it does not count, with so many patches on its longer side."""
    photo = inputs.photo
    picture = photo.as_rgb8(photo.width, photo.height)
    if inputs.mask is not None:
        picture = np.where(inputs.mask.weights[..., None] > 0.0, picture, np.uint8(128))
    scale = patches / max(picture.shape)
    size = [PATCH_PX * max(1, round(scale * side)) for side in picture.shape[1::-1]]
    shrinks = size[0] < photo.width
    how = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.uint8)


def _pieces(side: int, count: int) -> list[slice]:
    """Divide a side into pieces that overlap by some patches where there are several."""
    length = min(side, -(-(side + 3 * (count - 1)) // count))
    return [slice(int(a), int(a) + length) for a in np.linspace(0, side - length, count)]


def _in_pixels(patches: slice) -> slice:
    return slice(PATCH_PX * patches.start, PATCH_PX * patches.stop)


def _unit(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-6), np.float32)


def _view_features(
    inputs: StartInputs, network: Path, watch: Callable[[], object]
) -> list[_ViewFeatures]:
    """Return the features of the model's views, kept on disk by pictures and network."""
    pictures, shares = _render_views(inputs)
    digest = hashlib.sha256(pictures.tobytes() + _read(network)).hexdigest()
    folder = platformdirs.user_cache_path("poseviewer", appauthor=False) / "views"
    path, grids = folder / f"{digest[:32]}.npy", None
    with suppress(OSError, ValueError):  # none, or damaged
        grids = np.load(path, allow_pickle=False)
    if grids is None:
        grids = np.array(_features(network, list(pictures), watch), np.float16)
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
        vectors = _unit(grid[*patches.T].astype(np.float32))
        offsets = (patches[:, ::-1] + 0.5 - (low + high) / 2.0) / side
        views.append(_ViewFeatures(vectors, offsets, (high - low) / side))
    return views


def _render_views(inputs: StartInputs) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return pictures (n, side, side, 3) of views, and how far patches (n, 16, 16) are covered."""
    mesh, keypoints = inputs.mesh, inputs.keypoints
    renderer, points = make_renderer(mesh), hull_points(mesh)
    if keypoints is None:
        up, turns = np.array([0.0, 0.0, 1.0]), range(4)
        rotations = [look_along(forward, up) for forward in _directions()]
    else:
        rotations, turns = list(ground_views(keypoints)[::6]), range(1)
    pictures, shares = list[NDArray[np.uint8]](), list[NDArray[np.float32]]()
    side = 2 * PATCH_PX * VIEW_PATCHES
    for rotation in rotations:
        translation = np.array([0.0, 0.0, 4.0 * mesh.diameter]) - rotation @ mesh.centre
        flat = points @ rotation.T + translation
        flat = flat[:, :2] / flat[:, 2:]
        focal = FILLED * side / np.ptp(flat, axis=0).max()
        centre = side / 2 - focal * (flat.min(axis=0) + flat.max(axis=0)) / 2.0
        cx, cy = map(float, centre)
        camera = Perspective(focal, focal, cx, cy, side, side)
        image = renderer.render(Pose(camera, RigidTransform(rotation, translation)))
        lit = image.reflectance * (0.5 + 0.5 * np.abs(image.normals[..., 2:]))
        picture = np.where(image.mask[..., None], np.clip(lit, 0.0, 1.0), 0.5)
        half = cv2.resize(np.asarray(255.0 * picture, np.float32), (side // 2, side // 2),
                          interpolation=cv2.INTER_AREA)  # fmt: skip
        share = cv2.resize(image.mask.astype(np.float32), (VIEW_PATCHES, VIEW_PATCHES),
                           interpolation=cv2.INTER_AREA)  # fmt: skip
        pictures += [np.rot90(half, turn).round().astype(np.uint8) for turn in turns]
        shares += [np.rot90(share, turn) for turn in turns]
    return np.array(pictures), np.array(shares, np.float32)


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


def _read(network: Path) -> bytes:
    file = InputFile(network, [], SettingsError, "network (ONNX)", MAX_FILE_BYTES)
    with file.naming_errors(), file.open() as opened:
        return opened.read()


def _features(
    network: Path, pictures: Sequence[NDArray[np.uint8]], watch: Callable[[], object]
) -> list[NDArray[np.float32]]:
    """Return grids of vectors (height, width, d) of pictures, in patches, by other processes."""
    grids = list[NDArray[np.float32]]()
    for start in range(0, len(pictures), PICTURES_PER_CALL):
        watch()
        some = pictures[start : start + PICTURES_PER_CALL]
        try:
            grids += call_in_subprocess(
                _run, network, some, seconds=MAX_SECONDS, memory=MAX_MEMORY_BYTES
            )
        except subprocess.SubprocessError:
            found = f"the network ended without a result, or was stopped after {MAX_SECONDS:.0f} s"
            raise SettingsError(f"{network.name}: {found}; {WANTED}.") from None
    return grids


def _run(network: Path, pictures: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.float32]]:
    data = _read(network)
    names = set(re.findall(LAYER_OUTPUT, data))
    if len(names) != 1:
        raise SettingsError(f"{network.name}: no ONNX file with one ninth block; {WANTED}.")
    try:
        data = np.frombuffer(data + _output(names.pop()), np.uint8)
        loaded = cv2.dnn.readNetFromONNX(data, engine=cv2.dnn.ENGINE_NEW)
        outputs, grids = loaded.getUnconnectedOutLayersNames(), []
        for picture in pictures:
            rows, columns = (side // PATCH_PX for side in picture.shape[:2])
            blob = (picture / np.float32(255.0) - MEAN) / DEVIATION
            loaded.setInput(np.ascontiguousarray(blob.transpose(2, 0, 1)[None]))
            tokens = loaded.forward(outputs)[-1][0, -rows * columns :]
            grids.append(np.asarray(tokens.reshape(rows, columns, -1), np.float32))
    except (cv2.error, ValueError, IndexError):
        raise SettingsError(f"{network.name}: OpenCV cannot run the network; {WANTED}.") from None
    return grids


def _output(name: bytes) -> bytes:
    """Return bytes that, after those of an ONNX file, make an inner result an output of its graph.

    Messages of protocol buffers that follow each other are merged.
    """

    def field(number: int, content: bytes) -> bytes:
        assert len(content) < 128  # one byte tells the length
        return bytes([number << 3 | 2, len(content)]) + content

    shape = field(2, b"".join(field(1, field(2, axis)) for axis in (b"b", b"n", b"d")))
    tensor = field(2, field(1, b"\x08\x01" + shape))  # of 32-bit floats
    return field(7, field(12, field(1, name) + tensor))
