"""Paint a model from photos at known poses: the reflectance that they show of its surface.

Faces are divided until they are about as fine as the photos' pixels. Each vertex takes the colour
where a photo shows it, lighting divided out. Of several photos those that show it larger and less
obliquely count more, and colours far from the median do not count: a highlight, a hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.fit.lighting import render_relit
from poseviewer.fit.problem import make_problem, occlusions
from poseviewer.fit.propagation import OF_KEY
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose, level_pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.painted_model import Painting
from poseviewer.geometry.subdivision import halve_edges
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.sequence import key_indices, show_frame
from poseviewer.scene.types import Scene

EDGE_PX = 3.0
"""Edges of painted faces, at most: finer ones show no more of a photo."""
MAX_FACES = 400_000
"""Faces up to which a model is divided: memory, and time to draw."""
MAX_PHOTOS = 16
"""Photos that a model is painted from: memory grows with them; of more, every second or so."""
MARGIN_PX = 2
"""Distance from outlines, what stands in front and the photo's border up to which nothing is
painted: lens, sensor and errors of the pose mix colours across them."""
MIN_COSINE = 0.25
"""Cosine between a surface's normal and the direction to the camera from which it is painted."""
DEPTH_ERROR = 2e-3
"""Depth, in the model's diameters, by which a vertex may lie behind what is drawn."""
MEAN_CONTRAST = 0.4
"""Mean brightness of what is compared, in [0, 1], so that twice the mean is kept."""
MIN_SURROUNDINGS = 1e-3
"""Share of a pixel's surroundings that must count."""
MIN_LIGHT = 0.2
"""Light, as a share of the mean, that colours are divided by at least: shadows hold noise."""
HAZE = 0.05
"""Value that is added to colours whose ratio is taken, in [0, 1]: dark ones hold noise."""
ALIKE = 0.1
"""Distance from the median, in [0, 1], up to which a photo's colour counts."""
PRINT_SIZE = 0.15
"""Standard deviation, by the root of the model's pixels, of the surroundings whose mean brightness
is divided out of what is compared: light, shades and what else is wide."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class PosedPhoto:
    """A photo that shows a model at a pose."""

    name: str
    pixels: NDArray[np.float32]
    """(height, width, 3): RGB in [0, 1]."""
    counts: NDArray[np.bool_]
    """(height, width): pixels that may show the model, and nothing in front of it."""
    pose: Pose
    """Pose by the camera of ``pixels``."""


def paint_object(scene: Scene, object_index: int) -> Painting:
    """Paint an object's model from the keys of a sequence, or from all photos that show it.

    Raises:
        SettingsError: none shows enough of it, or the settings do not go with one.
        PhotoFileError: a photo cannot be read.
    """
    scene = scene.with_object(object_index, painting=None)
    item = scene.objects[object_index]
    keys = key_indices(scene, item.id) if scene.frames else []
    if scene.frames and not keys:
        raise SettingsError(f"{item.label} has no key to paint it from; place it in a frame.")
    shown = [show_frame(scene, key) for key in keys] or [scene]
    return paint_mesh(
        item.mesh, [photo for one in shown for photo in posed_photos(one, object_index)]
    )


def posed_photos(scene: Scene, object_index: int) -> list[PosedPhoto]:
    """Return the photos of a scene at the pose of an object, those of the shown frame alone.

    Raises:
        SettingsError: the settings do not go with a photo.
    """
    frame, item = scene.frame, scene.objects[object_index]
    for index, other in enumerate(scene.objects if frame else ()):
        known = frame.poses.get(other.id) if frame else None
        if known and known.source == "key" and known.result is None:
            scene = scene.with_object(index, result=OF_KEY)
    own = []
    for index in range(len(scene.views)):
        mask = scene.occluders(object_index, index)
        own.append(replace(scene.in_view(object_index, index), occluders=mask))
    settings = replace(item.settings, free_focal=False, free_principal_point=False)
    scene = scene.with_object(object_index, in_views=tuple(own), result=None, settings=settings)
    occluded = occlusions(scene, object_index, is_of_all=True)
    problem, _ = make_problem(scene, object_index, occluded=occluded)
    photos = []
    for view, pose in zip(problem.views, problem.poses(problem.start), strict=True):
        photo = view.fine_photo or view.photo
        pixels = np.broadcast_to(photo.channels, (*photo.weights.shape, 3))
        pose = level_pose(pose, photo.factor)
        name = scene.views[view.view_index].name
        photos.append(PosedPhoto(name, pixels, photo.weights > 0.0, pose))
    return photos


def paint_mesh(mesh: Mesh, photos: Sequence[PosedPhoto]) -> Painting:
    """Paint a model from photos of it.

    Raises:
        SettingsError: they show none of it.
    """
    # Imported here, since numba takes a quarter of a second.
    from poseviewer.render.software.software_renderer import SoftwareRenderer

    bare = _without_colours(mesh)
    depths = [SoftwareRenderer(bare).depth(photo.pose) for photo in photos]
    inner = [_inner(photo, depth) for photo, depth in zip(photos, depths, strict=True)]
    order = sorted(range(len(photos)), key=lambda index: -np.count_nonzero(inner[index]))
    fine = _divide(bare, photos)
    colours = np.zeros((len(photos), len(fine.vertices), 3), np.float32)
    contrasts, weights = colours.copy(), np.zeros(colours.shape[:2], np.float32)
    painted = fine
    for rank, index in enumerate(order):
        photo = replace(photos[index], counts=inner[index])
        if not photo.counts.any():
            continue
        reflectance = _reflectance(painted, photo, is_first=not weights.any())
        weights[rank] = _weights(fine, photo, depths[index])
        places = photo.pose.project(fine.vertices)
        colours[rank], contrasts[rank] = _at(reflectance, places), _at(_contrast(photo), places)
        painted = _coloured(fine, *_blend(colours[: rank + 1], weights[: rank + 1]))
    known = np.asarray(weights.sum(axis=0) > 0.0)
    is_painted = np.asarray(np.all(known[fine.faces], axis=1), bool)
    if not is_painted.any():
        raise SettingsError(
            "no photo shows enough of the model to paint it: bring it onto the photo, hide less of "
            "it, or take a larger photo."
        )
    contrast = _coloured(fine, *_blend(contrasts, weights))
    names = tuple(photo.name for photo in photos)
    return Painting(mesh, painted, contrast, is_painted, names)


def _without_colours(mesh: Mesh) -> Mesh:
    """The surface in one grey."""
    return replace(
        mesh,
        colours=np.full((len(mesh.vertices), 3), 0.5),
        face_texture=np.full(len(mesh.faces), -1),
        textures=(),
    )


def _inner(photo: PosedPhoto, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(height, width): pixels that count, not near others that do not."""
    counts = (photo.counts & np.isfinite(depth)).astype(np.uint8)
    square = np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.erode(counts, square, borderValue=0), bool)  # pyright: ignore


def _divide(mesh: Mesh, photos: Sequence[PosedPhoto]) -> Mesh:
    """Divide the faces that photos show until they are as fine as their pixels."""
    shown = []
    for photo in photos:
        ids = make_renderer(mesh).render(photo.pose).face_ids[photo.counts]
        shown.append(np.zeros(len(mesh.faces), bool))
        shown[-1][ids[ids >= 0]] = True

    def lengths(start: FloatArray, end: FloatArray, face: NDArray[np.int64]) -> FloatArray:
        longest = np.zeros(len(face))
        for photo, is_shown in zip(photos, shown, strict=True):
            chosen = np.flatnonzero(is_shown[face])
            ends = (photo.pose.project(points[chosen]) for points in (start, end))
            px = np.linalg.norm(np.subtract(*ends), axis=1)
            longest[chosen] = np.fmax(longest[chosen], px)  # of ends behind the camera none
        return longest / EDGE_PX

    return halve_edges(mesh, lengths, MAX_FACES)[0]


def _reflectance(mesh: Mesh, photo: PosedPhoto, is_first: bool) -> NDArray[np.float32]:
    """(height, width, 3): a photo's colours by the light that explains it on the model.

    On a bare model (``is_first``) grey light about its mean is divided out, and the photo's colours
    stay; on a painted one what differs from its paint, so that photos of other exposure agree.
    """
    renderer = make_renderer(mesh)
    image = renderer.render(photo.pose)
    counts = photo.counts.astype(np.float32)
    pixels = (photo.pixels @ GREY_WEIGHTS)[..., None] if is_first else photo.pixels
    relit = render_relit(PhotoAttributes(pixels, counts), renderer, photo.pose, image)
    if is_first:
        light = relit / max(float(relit[photo.counts].mean()), 1e-6)
        return (photo.pixels / np.maximum(light, MIN_LIGHT)).astype(np.float32)
    ratio = (photo.pixels + HAZE) / np.maximum(relit + HAZE, HAZE)
    return ((image.reflectance + HAZE) * ratio - HAZE).astype(np.float32)


def _contrast(photo: PosedPhoto) -> NDArray[np.float32]:
    """(height, width, 3): a photo's colours by the mean brightness of their surroundings on the
    model.
    """
    grey, counts = (photo.pixels @ GREY_WEIGHTS).astype(np.float32), photo.counts.astype(np.float32)
    size = PRINT_SIZE * float(np.sqrt(counts.sum()))
    sums, total = (cv2.GaussianBlur(own, (0, 0), size) for own in (grey * counts, counts))
    mean = sums / np.maximum(total, MIN_SURROUNDINGS)
    share = MEAN_CONTRAST / np.maximum(mean, HAZE)
    return (photo.pixels * share[..., None]).astype(np.float32)


def _weights(mesh: Mesh, photo: PosedPhoto, depth: NDArray[np.float32]) -> FloatArray:
    """(V,): pixels per area in which a photo shows each vertex; 0 where it does not."""
    place, camera = photo.pose.camera_from_model, photo.pose.camera
    points, normals = place.apply(mesh.vertices), mesh.normals @ place.rotation.T
    if isinstance(camera, Parallel):
        scale, cosine = np.full(len(points), camera.scale), -normals[:, 2]
    else:
        scale = camera.fx / np.maximum(points[:, 2], 1e-9)
        towards = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-300)
        cosine = -np.einsum("vi,vi->v", normals, towards)
    cosine = np.clip(cosine, 0.0, 1.0)
    # What is drawn near a vertex in front of its own slope hides it.
    square = np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)
    nearest = cv2.erode(depth, square)
    slope = np.sqrt(1.0 - cosine**2) / np.maximum(cosine, MIN_COSINE)
    allowed = (MARGIN_PX + 1) * np.sqrt(2.0) * slope / scale + DEPTH_ERROR * mesh.diameter
    pixels = photo.pose.project(mesh.vertices)
    column, row = (np.floor(np.nan_to_num(pixels, nan=-1.0)).clip(-1, 2**30).astype(int)).T
    height, width = depth.shape
    weights = np.zeros(len(points))
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    at = np.flatnonzero(inside & (cosine > MIN_COSINE))
    is_front = points[at, 2] - nearest[row[at], column[at]] <= allowed[at]
    at = at[is_front & photo.counts[row[at], column[at]]]
    weights[at] = cosine[at] * scale[at] ** 2
    return weights


def _at(picture: NDArray[np.float32], pixels: FloatArray) -> FloatArray:
    """(n, 3): a picture's colours in [0, 1] at points (n, 2), pixel centres at i + 0.5."""
    x, y = (np.nan_to_num(pixels).clip(-1.0, 2**14) - 0.5).astype(np.float32).T
    values = np.empty((len(x), 3))
    for start in range(0, len(x), CHUNK):
        part = slice(start, start + CHUNK)
        values[part] = cv2.remap(
            picture, x[part, None], y[part, None], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
        )[:, 0]
    return np.clip(values, 0.0, 1.0)


CHUNK = 30_000
"""Points that ``cv2.remap`` takes at once: its pictures end at 32,767 rows."""


def _blend(colours: NDArray, weights: NDArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Blend the colours (P, V, 3) of photos by weights (P, V); also return where any counts."""
    order = np.argsort(colours, axis=0)
    own = np.take_along_axis(np.broadcast_to(weights[..., None], colours.shape), order, axis=0)
    half = np.argmax(np.cumsum(own, axis=0) >= 0.5 * own.sum(axis=0), axis=0)
    median = np.take_along_axis(np.take_along_axis(colours, order, axis=0), half[None], axis=0)[0]
    counted = weights * (np.abs(colours - median).max(axis=2) <= ALIKE)
    total = counted.sum(axis=0)
    mean = np.einsum("pv,pvc->vc", counted, colours) / np.maximum(total, 1e-30)[:, None]
    # Channels may have their medians in different photos, and all three none.
    return np.where(total[:, None] > 0.0, mean, median), weights.sum(axis=0) > 0.0


def _coloured(mesh: Mesh, colours: FloatArray, known: NDArray[np.bool_]) -> Mesh:
    """Give vertices their colours, and unknown ones the mean."""
    if not known.any():
        return mesh
    colours = np.where(known[:, None], colours, colours[known].mean(axis=0))
    return replace(mesh, colours=np.clip(colours, 0.0, 1.0), has_reflectance=True)
