"""The bundled car in any number of triangles, in a photo of any size, covering any share of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree

from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import crease_normals, find_adjacency, weld, winding_to_flip
from poseviewer.geometry.photo import Photo
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_registration

MOST_TOO_MANY = 1.1
"""A simplified model with more than this many times the triangles wanted is not taken."""


def in_triangles(mesh: Mesh, triangles: int) -> Mesh:
    """The mesh in about ``triangles`` triangles: simplified, or subdivided on the same surface.

    A model of a hundred parts cannot be simplified to a thousand triangles; its hull then stands
    for it.
    """
    if len(mesh.faces) <= triangles:
        return subdivide(mesh, triangles)
    smaller = simplify(mesh, triangles)
    if len(smaller.faces) <= MOST_TOO_MANY * triangles:
        return smaller
    return subdivide(simplify(_convex_hull(mesh), triangles), triangles)


def _convex_hull(mesh: Mesh) -> Mesh:
    """In the colours of the mesh's nearest vertices."""
    hull = ConvexHull(mesh.vertices)
    places = np.full(len(mesh.vertices), -1)
    places[hull.vertices] = np.arange(len(hull.vertices))
    points, faces = mesh.vertices[hull.vertices], places[hull.simplices]
    flip = winding_to_flip(points, faces)
    faces[flip] = faces[flip][:, ::-1]
    source, faces, normals = crease_normals(points, faces)
    nearest = KDTree(mesh.vertices).query(points[source])[1]
    return replace(
        mesh,
        vertices=points[source],
        faces=faces,
        normals=normals,
        colours=mesh.colours[nearest],
        uvs=mesh.uvs[nearest],
        face_texture=np.full(len(faces), -1),
        face_part=np.zeros(len(faces), np.int32),
    )


def subdivide(mesh: Mesh, faces: int) -> Mesh:
    """The mesh in ``faces`` triangles, or one or two more, by cutting the longest edges in half.

    Surface, reflectance and normals stay what they are. An edge is cut only where it is the longest
    of all its faces, together with all of them: no vertex comes to lie on another face's edge, and
    triangles keep their shape (Rivara, 1984). A mesh that has as many faces is returned as it is.
    """
    while len(mesh.faces) < faces:
        mesh = _cut(mesh, *_edges_to_cut(mesh, faces - len(mesh.faces)))
    return mesh


def _edges_to_cut(mesh: Mesh, wanted: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The longest of the edges that are the longest of their faces, to add ``wanted`` faces.

    Each as its two half-edges (N,), the second -1 where there is none; ``3 f + i`` runs from corner
    i of face f.
    """
    rank, other = _half_edges(mesh)
    longest = 3 * np.arange(len(mesh.faces)) + np.argmax(rank.reshape(-1, 3), axis=1)
    is_longest = np.zeros(len(rank), bool)
    is_longest[longest] = True
    partner = other[longest]
    # Each edge once: by the lower of its two half-edges.
    kept = (partner < 0) | (is_longest[partner] & (longest < partner))
    first, second = longest[kept], partner[kept]
    order = np.argsort(-rank[first])
    adds = np.cumsum(1 + (second[order] >= 0))
    count = min(int(np.searchsorted(adds, wanted)) + 1, len(order))
    return first[order[:count]], second[order[:count]]


def _half_edges(mesh: Mesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(3 F,): rank by length, the same for both halves of an edge, and the other half, or -1."""
    places = weld(mesh.vertices)
    faces = places[mesh.faces]
    points = np.empty((int(places.max()) + 1, 3))
    points[places] = mesh.vertices
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    lengths = np.sum((points[high] - points[low]) ** 2, axis=1)
    # Equal lengths must have an order too, the same in all faces, or no edge might be the longest.
    rank = np.empty(len(lengths), np.int64)
    order = np.lexsort((high, low, lengths))
    changes = np.any(np.diff(np.stack([low, high])[:, order], axis=1) != 0, axis=0)
    rank[order] = np.concatenate([[0], np.cumsum(changes)])
    other = np.full(len(lengths), -1)
    adjacency = find_adjacency(faces)
    other[adjacency.first], other[adjacency.second] = adjacency.second, adjacency.first
    return rank, other


def _cut(mesh: Mesh, first: NDArray[np.int64], second: NDArray[np.int64]) -> Mesh:
    """Both faces of each edge in two; where normals differ across an edge, each side gets a vertex
    of its own.
    """
    half = np.concatenate([first, second[second >= 0]])
    face, at = half // 3, half % 3
    a, b, c = (mesh.faces[face, (at + i) % 3] for i in range(3))
    ends, middle = np.unique(np.sort(np.stack([a, b], axis=1)), axis=0, return_inverse=True)
    middle = len(mesh.vertices) + middle.ravel()
    kept = np.array(mesh.faces)
    kept[face] = np.stack([a, middle, c], axis=1)

    def with_means(values: NDArray) -> NDArray:
        return np.concatenate([values, 0.5 * (values[ends[:, 0]] + values[ends[:, 1]])])

    normals = with_means(mesh.normals)
    made = normals[len(mesh.normals) :]
    length = np.linalg.norm(made, axis=1, keepdims=True)
    # Opposite normals have no mean: the first is taken.
    made[:] = np.where(length > 1e-9, made / np.maximum(length, 1e-9), mesh.normals[ends[:, 0]])
    return replace(
        mesh,
        vertices=with_means(mesh.vertices),
        faces=np.concatenate([kept, np.stack([middle, b, c], axis=1)]),
        normals=normals,
        colours=with_means(mesh.colours),
        uvs=with_means(mesh.uvs),
        face_texture=np.concatenate([mesh.face_texture, mesh.face_texture[face]]),
        face_part=np.concatenate([mesh.face_part, mesh.face_part[face]]),
    )


Size = tuple[int, int]
"""Width and height of a photo, px."""
USUAL_SHARE = 48_600 / (640 * 480)
"""Share of the photo that the model covers, unless another one is asked for."""
POSES = 8
JITTER = 0.01
"""Measured poses lie about the true one, within this share of each parameter's scale."""


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """The bundled demo, with its true pose and how large it is in its photo."""

    registration: Registration
    truth: Pose
    middle: FloatArray
    """(2,): centre of the model's bounding box in the photo, px."""
    covered_px: int


class Model(NamedTuple):
    """The car in some number of triangles; mesh and renderer go with photos of any size."""

    triangles: int
    """As asked for; the mesh may have a few more or less."""
    mesh: Mesh
    renderer: SoftwareRenderer


@dataclass(frozen=True, slots=True, eq=False)
class Workload:
    """One model before one photo, and the poses that are evaluated."""

    model: Model
    poses: tuple[Pose, ...]
    parameters: tuple[FloatArray, ...]
    """The same poses in the problems' chart."""
    paper: FitProblem
    """The paper's loss: grey, over the pixels that the model covers."""
    usual: FitProblem
    """Lit colours over the whole photo, see ``lit_problem``."""
    covered_px: int
    """At the true pose."""

    @property
    def width(self) -> int:
        """Of the photo, px."""
        return self.poses[0].camera.width

    @property
    def height(self) -> int:
        """Of the photo, px."""
        return self.poses[0].camera.height


def load_demo() -> Demo:
    """Read the demo's files, and look where its model is."""
    files = demo_case()
    registration = load_registration(files.photo, files.model, files.start)
    photo = registration.photo
    truth = load_pose(files.truth, photo.width, photo.height).pose
    covered = SoftwareRenderer(registration.mesh).covers(truth)
    rows, columns = np.nonzero(covered)
    middle = 0.5 + np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2.0
    return Demo(registration, truth, middle, int(covered.sum()))


def make_model(demo: Demo, triangles: int) -> Model:
    """The demo's car in about ``triangles`` triangles."""
    mesh = in_triangles(demo.registration.mesh, triangles)
    return Model(triangles, mesh, SoftwareRenderer(mesh))


def make_workload(demo: Demo, model: Model, size: Size, share: float = USUAL_SHARE) -> Workload:
    """The model at the demo's true pose, covering a ``share`` of a photo of this size.

    The photo is the demo's, enlarged and cut to match. What it shows does not matter for the time,
    but it makes the losses those of a real search.
    """
    width, height = size
    zoom = math.sqrt(share * width * height / demo.covered_px)
    camera = demo.truth.camera
    assert isinstance(camera, Perspective)
    # Zoomed about the model's middle, which comes to the middle of the photo.
    cx, cy = zoom * (np.array([camera.cx, camera.cy]) - demo.middle) + [width / 2, height / 2]
    zoomed = Perspective(zoom * camera.fx, zoom * camera.fy, float(cx), float(cy), width, height)
    truth = Pose(zoomed, demo.truth.camera_from_model)
    photo = demo.registration.photo
    registration = replace(
        demo.registration,
        photo=replace(photo, pixels=_zoomed(photo, demo.middle, zoom, size)),
        mesh=model.mesh,
        start=truth,
    )
    usual = lit_problem(registration)
    paper = make_problem(registration, FitSettings(grey=True, pixels="clip"))[0]
    offsets = np.random.default_rng(0).uniform(-JITTER, JITTER, (POSES, len(usual.start)))
    parameters = tuple(usual.start + offset * usual.chart.scales(usual.start) for offset in offsets)
    poses = tuple(usual.chart.to_pose(at) for at in parameters)
    covered_px = int(model.renderer.covers(truth).sum())
    return Workload(model, poses, parameters, paper, usual, covered_px)


def lit_problem(registration: Registration, limits: Limits | None = None) -> FitProblem:
    """Lit colours over the whole photo: what all paths can compute, the plain ones too."""
    settings = FitSettings(pixels="clip", limits=limits or Limits())
    problem = make_problem(registration, settings)[0]
    return replace(problem, photo=replace(problem.photo, clipped=False))


def _zoomed(
    photo: Photo, middle: FloatArray, zoom: float, size: Size
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """(height, width, 3): the photo zoomed about ``middle``; its border goes on beyond it."""
    columns, rows = (
        np.clip((np.arange(n) + 0.5 - n / 2) / zoom + at, 0, last - 1).astype(int)
        for n, at, last in zip(size, middle, (photo.width, photo.height), strict=True)
    )
    pixels = photo.pixels[rows[:, None], columns]
    pixels.flags.writeable = False
    return pixels
