"""Meshes made for tests, without a file."""

from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from poseviewer.geometry.mesh import Mesh


def make_mesh(vertices, faces, normals=None, colours=None, **more) -> Mesh:
    """A mesh from arrays; flat normals (corners apart) unless given."""
    vertices, faces = np.asarray(vertices, float), np.asarray(faces, np.int32)
    if normals is None:
        corners = vertices[faces]
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        flat = np.divide(flat, length, where=length > 0.0, out=np.zeros_like(flat))
        vertices, normals = corners.reshape(-1, 3), np.repeat(flat, 3, axis=0)
        if colours is not None:
            colours = np.asarray(colours)[faces].reshape(-1, 3)
        if "uvs" in more:
            more["uvs"] = np.asarray(more["uvs"])[faces].reshape(-1, 2)
        faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    if colours is None:
        colours = np.full((len(vertices), 3), 0.7)
    settings = {
        "uvs": np.zeros((len(vertices), 2)),
        "face_texture": np.full(len(faces), -1),
        "face_part": np.zeros(len(faces)),
    }
    return Mesh(vertices, faces, normals, colours, **(settings | more))


def make_box(size=(2.0, 1.0, 0.5)) -> Mesh:
    """A box about the origin, colours of its faces' directions."""
    box = trimesh.creation.box(extents=size)
    colours = 0.5 + 0.3 * np.sign(box.vertices)
    return make_mesh(box.vertices, box.faces, colours=colours)


def make_printed(size=(2.0, 1.4, 1.0)) -> Mesh:
    """A box with a print of its own on each face: patches of colours, at random."""
    box = trimesh.creation.box(extents=size)
    for _ in range(4):
        box = box.subdivide()
    colours = np.random.default_rng(0).choice([0.1, 0.5, 0.9], (len(box.vertices), 1))
    return make_mesh(box.vertices, box.faces, colours=np.tile(colours, 3))


def make_two_boxes() -> Mesh:
    """A box called body, and beside it a smaller one called mirror."""
    body = make_box()
    mirror = replace(body, vertices=0.2 * body.vertices + np.array([3.0, 0.0, 0.0]))
    parts = np.repeat([0, 1], len(body.faces))
    return replace(merged(body, mirror), face_part=parts, part_names=("body", "mirror"))


def merged(one: Mesh, other: Mesh) -> Mesh:
    """Both meshes as one."""
    names = "vertices", "normals", "colours", "uvs", "face_texture", "face_part"
    both = {name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in names}
    return replace(one, faces=np.concatenate([one.faces, other.faces + len(one.vertices)]), **both)


def make_sphere(subdivisions=4, radius=1.0) -> Mesh:
    """A sphere about the origin with exact normals and waves of colour."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    normals = ball.vertices / radius
    return make_mesh(ball.vertices, ball.faces, normals, 0.5 + 0.4 * np.sin(3.0 * normals))


def make_bumpy(subdivisions=4) -> Mesh:
    """A smooth closed shape without symmetry."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    d = ball.vertices
    radius = 1.0 + 0.25 * np.sin(3.0 * d[:, 0] + 1.0) * np.cos(2.0 * d[:, 1]) + 0.15 * d[:, 2]
    shape = trimesh.Trimesh(d * radius[:, None], ball.faces, process=False)
    colours = 0.5 + 0.35 * np.sin(4.0 * d + np.array([0.0, 1.0, 2.0]))
    return make_mesh(shape.vertices, shape.faces, np.array(shape.vertex_normals), colours)


def make_painted() -> Mesh:
    """A bumpy shape whose faces have one colour, several, or a texture and one colour."""
    mesh, random = make_bumpy(3), np.random.default_rng(6)
    face_texture, corners = random.integers(-1, 1, len(mesh.faces)), mesh.faces.ravel()
    colours = np.where(mesh.vertices[:, 2:] > 0.0, [0.8, 0.6, 0.7], mesh.colours)[mesh.faces]
    colours[face_texture >= 0] = colours[face_texture >= 0, :1]
    return make_mesh(
        mesh.vertices[corners],
        np.arange(len(corners)).reshape(-1, 3),
        mesh.normals[corners],
        colours.reshape(-1, 3),
        uvs=mesh.vertices[corners, :2] * 1.7,
        face_texture=face_texture,
        textures=(make_waves(48, 64),),
    )


def make_waves(height: int, width: int) -> NDArray[np.uint8]:
    """(height, width, 3): a smooth texture that goes on at its borders."""
    rows, columns = np.mgrid[:height, :width]
    waves = np.stack([rows / height, columns / width, 2 * rows / height], -1)
    return (128 + 100 * np.sin(2 * np.pi * waves)).astype(np.uint8)


def make_soup(seed: int, triangles=300, spread=1.0, size=0.5) -> Mesh:
    """Random triangles of random colours, through one another."""
    random = np.random.default_rng(seed)
    centres = random.normal(size=(triangles, 1, 3)) * spread
    vertices = (centres + size * random.normal(size=(triangles, 3, 3))).reshape(-1, 3)
    colours = random.uniform(size=(len(vertices), 3))
    return make_mesh(vertices, np.arange(len(vertices)).reshape(-1, 3), colours=colours)
