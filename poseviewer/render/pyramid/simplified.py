"""Decimated models for coarse pictures, with averaged attributes, textures included."""

from dataclasses import dataclass, replace
from functools import partial

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import crease_normals, face_normals_and_areas, weld
from poseviewer.processes import call_in_subprocess
from poseviewer.render.texture import TexturePyramid, mip_levels

MIN_TRIANGLES = 200
"""Triangles of a decimated model, at least: fewer lose its shape."""
MAX_TRIANGLES_IN_PROCESS = 200_000
"""Triangles up to which decimation runs in this process, whose threads it stops for a second."""
MAX_SURFACE_SAMPLES = 300_000
"""Samples on the original surface, at most, beside one for each of its faces."""
NEIGHBOURS = 24
"""Nearest samples from which a vertex takes its attributes: within reach there are fewer."""
REACH = 0.5
"""Distance from a vertex up to which samples count, in the mean edge of the new faces."""
GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps of the evenly spread sequence R2 (M. Roberts, 2018), the golden ratio of the plane."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """N points, evenly distributed over a surface."""

    tree: KDTree
    """Tree of the positions (N, 3)."""
    parts: NDArray[np.int32]
    """(N,): part of the mesh at each point."""
    areas: FloatArray
    """(N,): area of each point; 0 on faces without area."""
    colours: FloatArray
    """(N, 3): reflectance, textures included."""
    normals: FloatArray
    """(N, 3): unit shading normals."""
    flat_normals: FloatArray
    """(N, 3): unit normals of the faces."""


def simplify(mesh: Mesh, faces: int) -> Mesh:
    """Decimate a surface to about ``faces`` triangles, its reflectance in vertex colours.

    Edges between welded vertices collapse after Garland and Heckbert (1997), so that no gap opens.
    New vertices get the mean reflectance and normal of their own part and side of the surface:
    colours end at parts, and sharp edges stay. Small meshes are returned as they are.
    """
    faces = max(faces, MIN_TRIANGLES)
    if len(mesh.faces) <= faces:
        return mesh
    vertices, triangles = _decimate(mesh, faces)
    if not 0 < len(triangles) < len(mesh.faces):
        return mesh
    area = face_normals_and_areas(vertices, triangles)[1].mean()
    edge = float(np.sqrt(4.0 * area / np.sqrt(3.0)))  # of equilateral faces of this area
    samples = _sample_surface(mesh, area)
    parts = _nearest_parts(samples, vertices, triangles)
    source, corners, normals = _copy_for_parts(*crease_normals(vertices, triangles), parts)
    owners = np.zeros(len(source), np.int32)
    owners[corners.reshape(-1)] = np.repeat(parts, 3)
    colours, normals = _mean_attributes(samples, vertices[source], normals, owners, REACH * edge)
    return replace(
        mesh,
        vertices=vertices[source],
        faces=corners,
        normals=normals,
        colours=colours,
        uvs=np.zeros((len(source), 2)),
        face_texture=np.full(len(corners), -1),
        face_part=parts,
        textures=(),
    )


def _decimate(mesh: Mesh, faces: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """Vertices (V, 3) and triangles (F, 3) with three different corners and an area."""
    welded = weld(mesh.vertices)
    points = np.zeros((int(welded.max()) + 1, 3))
    points[welded] = mesh.vertices
    triangles = _with_area(points, welded[mesh.faces])
    if len(triangles) <= faces:
        return points, triangles
    is_large = len(triangles) > MAX_TRIANGLES_IN_PROCESS
    collapse = partial(call_in_subprocess, _collapse_edges) if is_large else _collapse_edges
    vertices, triangles = collapse(points, triangles, faces)
    return vertices, _with_area(vertices, triangles)


def _collapse_edges(
    points: FloatArray, triangles: NDArray, faces: int
) -> tuple[FloatArray, NDArray]:
    """Vertices and triangles of a decimated surface; holds the interpreter's lock."""
    return fast_simplification.simplify(points, triangles, target_count=faces)[:2]


def _with_area(vertices: FloatArray, triangles: NDArray) -> NDArray[np.int32]:
    triangles = triangles.astype(np.int32)
    return triangles[face_normals_and_areas(vertices, triangles)[1] > 0.0]


def _sample_surface(mesh: Mesh, new_area: float) -> SurfaceSamples:
    """Samples of a mesh whose new faces have the mean area ``new_area``."""
    flat, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    count = min(max(2 * len(mesh.faces), 20_000), MAX_SURFACE_SAMPLES)
    each = np.maximum(np.ceil(areas * (count / areas.sum())), 1.0).astype(np.int64)
    faces = np.repeat(np.arange(len(each)), each)
    step = np.arange(len(faces)) - np.repeat(np.cumsum(each) - each, each)
    u, v = np.moveaxis((1.0 / 3.0 + step[:, None] * GOLDEN) % 1.0, -1, 0)
    beyond = u + v > 1.0  # the other half of the square, folded over
    u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
    shares, corners = np.stack([u, v, 1.0 - u - v], axis=-1), mesh.faces[faces]
    points = _blend(shares, mesh.vertices[corners])
    normals = _blend(shares, mesh.normals[corners])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-9, normals / np.maximum(length, 1e-9), flat[faces])
    colours = _blend(shares, mesh.colours[corners].astype(float))
    textured = np.flatnonzero(mesh.face_texture[faces] >= 0)
    if len(textured):
        uv, of_samples = _blend(shares[textured], mesh.uvs[corners[textured]]), faces[textured]
        pyramid = TexturePyramid.of(mesh.textures)
        # The level averages two texels along the side of a new face.
        new_faces, count = 4.0 * (areas / new_area), pyramid.table.shape[1]
        levels = mip_levels(pyramid.texel_areas(mesh), new_faces, count)[of_samples]
        colours[textured] *= pyramid.sample(mesh.face_texture[of_samples], levels, uv)
    parts, share = mesh.face_part[faces], (areas / each)[faces]
    return SurfaceSamples(KDTree(points), parts, share, colours, normals, flat[faces])


def _blend(shares: FloatArray, corners: NDArray) -> FloatArray:
    """Weighted sums of the corners' values (N, 3, k), by (N, 3)."""
    return np.einsum("ni,nik->nk", shares, corners)


def _nearest_parts(
    samples: SurfaceSamples, vertices: FloatArray, triangles: NDArray[np.int32]
) -> NDArray[np.int32]:
    """(F,): part of the nearest sample that faces the same way as each new face."""
    middles = vertices[triangles].mean(axis=1)
    flat, _ = face_normals_and_areas(vertices, triangles)
    distance, near = samples.tree.query(middles, k=8)
    away = np.einsum("fki,fi->fk", samples.flat_normals[near], flat) <= 0.0
    best = np.argmin(np.where(away, np.inf, distance), axis=1)
    return samples.parts[near[np.arange(len(near)), best]]


def _copy_for_parts(
    source: NDArray[np.int64],
    corners: NDArray[np.int64],
    normals: FloatArray,
    parts: NDArray[np.int32],
) -> tuple[NDArray[np.int64], NDArray[np.int32], FloatArray]:
    """Copy each vertex once for each part (F,) whose faces meet in it."""
    count = int(parts.max()) + 1
    key = corners * count + parts[:, None]
    unique, inverse = np.unique(key, return_inverse=True)
    old = unique // count
    return source[old], inverse.reshape(-1, 3).astype(np.int32), normals[old]


def _mean_attributes(
    samples: SurfaceSamples,
    points: FloatArray,
    normals: FloatArray,
    parts: NDArray[np.int32],
    reach: float,
) -> tuple[FloatArray, FloatArray]:
    """Mean reflectance (V, 3) and unit normals (V, 3) about ``points``, of their part and side."""
    distance, near = samples.tree.query(points, k=NEIGHBOURS)
    same_part = samples.parts[near] == parts[:, None]
    alike = same_part & (np.einsum("vki,vi->vk", samples.flat_normals[near], normals) > 0.5)
    none = ~alike.any(axis=1)
    alike[none, np.argmax(same_part[none], axis=1)] = True
    nearest = np.min(np.where(alike, distance, np.inf), axis=1, keepdims=True)
    counts = alike & (distance <= np.maximum(nearest, reach))
    weights = np.where(counts, np.maximum(samples.areas[near], 1e-300), 0.0)
    weights = weights / weights.sum(axis=1, keepdims=True)
    colours = np.einsum("vk,vki->vi", weights, samples.colours[near])
    mean = np.einsum("vk,vki->vi", weights, samples.normals[near])
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    # The new surface's own normal, where normals cancel out or no sample fits.
    keep = none[:, None] | (length < 1e-6)
    return colours, np.where(keep, normals, mean / np.maximum(length, 1e-6))
