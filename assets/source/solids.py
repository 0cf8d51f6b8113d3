"""Solids for the small parts: round-edged boxes, turned parts, sheets, and their normals."""

from __future__ import annotations

import numpy as np
from shell import Shell, grid_faces, join, weld


def shade(vertices: np.ndarray, faces: np.ndarray, degrees: float = 35.0) -> Shell:
    """Give normals: smooth where faces meet at less than `degrees`, sharp elsewhere."""
    _, first, again = np.unique(
        np.round(vertices * 1e6), axis=0, return_index=True, return_inverse=True
    )
    faces = again.reshape(-1)[faces]
    vertices = vertices[first]
    cross = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    area = np.linalg.norm(cross, axis=1)
    faces, cross, area = faces[area > 1e-12], cross[area > 1e-12], area[area > 1e-12]
    unit = cross / area[:, None]
    corner_vertex, corner_face = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(corner_vertex, kind="stable")
    v, f = corner_vertex[order], corner_face[order]
    total = cross[f].copy()
    for shift in range(1, int(np.bincount(v).max())):
        a, b = np.arange(len(v) - shift), np.arange(shift, len(v))
        near = (v[a] == v[b]) & ((unit[f[a]] * unit[f[b]]).sum(1) > np.cos(np.radians(degrees)))
        np.add.at(total, a[near], cross[f[b[near]]])
        np.add.at(total, b[near], cross[f[a[near]]])
    normals = np.empty_like(total)
    normals[order] = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-15)
    soup = Shell(vertices[corner_vertex], normals, np.arange(len(corner_vertex)).reshape(-1, 3))
    return weld(soup)


def turned(profile: np.ndarray, segments: int, degrees: float = 35.0) -> Shell:
    """Turn a profile (n,2) of (radius, y) about the y axis, outside on the profile's left."""
    t = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    r, y = profile[:, 0], profile[:, 1]
    ring = np.stack([np.outer(np.cos(t), r), np.tile(y, (segments, 1)), np.outer(np.sin(t), r)], 2)
    ring = np.concatenate([ring, ring[:1]])
    return shade(ring.reshape(-1, 3), grid_faces(segments + 1, len(profile)), degrees)


def rounded_block(size: tuple[float, float, float], power: float = 5.0, steps: int = 10) -> Shell:
    """Superellipsoid centred on the origin, `size` its full extents; high power is boxier."""
    lat = np.linspace(-np.pi / 2, np.pi / 2, steps + 1)
    lon = np.linspace(0, 2 * np.pi, 2 * steps + 1)
    a, b = np.meshgrid(lat, lon, indexing="ij")

    def bend(c: np.ndarray) -> np.ndarray:
        c = np.where(np.abs(c) < 1e-12, 0, c)
        return np.sign(c) * np.abs(c) ** (2 / power)

    p = np.stack(
        [bend(np.cos(a)) * bend(np.cos(b)), bend(np.cos(a)) * bend(np.sin(b)), bend(np.sin(a))], 2
    )
    points = 0.5 * p.reshape(-1, 3) * np.array(size)
    return shade(points, grid_faces(steps + 1, 2 * steps + 1)[:, ::-1], 50)


def moved(shell: Shell, rotation: np.ndarray, shift: tuple[float, float, float]) -> Shell:
    """Rotate (3,3) about the origin, then shift."""
    return Shell(
        shell.vertices @ rotation.T + np.array(shift), shell.normals @ rotation.T, shell.faces
    )


def turn(axis: str, degrees: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def sheet(points: np.ndarray, degrees: float = 35.0) -> Shell:
    """Open surface through a grid of points (rows, columns, 3)."""
    rows, columns = points.shape[:2]
    return shade(points.reshape(-1, 3), grid_faces(rows, columns), degrees)


def slab(top: np.ndarray, bottom: np.ndarray) -> Shell:
    """Closed solid between two grids of points of equal shape."""
    rim = lambda g: np.vstack([g[0], g[1:, -1], g[-1, -2::-1], g[-2:0:-1, 0], g[:1, 0]])  # noqa: E731
    edge = np.stack([rim(top), rim(bottom)], 0)
    shells = [sheet(top), sheet(bottom[:, ::-1]), sheet(edge)]
    vertices = np.vstack([s.vertices for s in shells])
    return shade(vertices, join(shells).faces)
