"""Triangle shells: the ray-cast grid of half the car, and cutting shells along level lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import body_surface as body
import numpy as np

Field = Callable[[np.ndarray], np.ndarray]


@dataclass
class Shell:
    """Vertices (n,3), their unit normals (n,3), triangles (m,3). Metres, car frame."""

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray

    def pick(self, chosen: np.ndarray) -> Shell:
        """The part of the shell made of the chosen faces (mask or indices)."""
        faces = self.faces[chosen]
        used, again = np.unique(faces, return_inverse=True)
        return Shell(self.vertices[used], self.normals[used], again.reshape(-1, 3))

    def mirrored(self) -> Shell:
        """The shell on the car's other side."""
        flip = np.array([1.0, -1.0, 1.0])
        return Shell(self.vertices * flip, self.normals * flip, self.faces[:, ::-1])

    def moved(self, distance: float) -> Shell:
        """The shell moved along its normals."""
        return Shell(self.vertices + distance * self.normals, self.normals, self.faces)


def join(shells: list[Shell]) -> Shell:
    """One shell of several, vertices kept apart."""
    starts = np.cumsum([0] + [len(s.vertices) for s in shells[:-1]])
    return Shell(
        np.vstack([s.vertices for s in shells]),
        np.vstack([s.normals for s in shells]),
        np.vstack([s.faces + i for s, i in zip(shells, starts, strict=True)]),
    )


def weld(shell: Shell) -> Shell:
    """Merge vertices of equal place and nearly equal normal (0.01 mm, 1/50)."""
    key = np.hstack([np.round(shell.vertices * 1e5), np.round(shell.normals * 50)])
    _, first, again = np.unique(key, axis=0, return_index=True, return_inverse=True)
    faces = again.reshape(-1)[shell.faces]
    real = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    return Shell(shell.vertices[first], shell.normals[first], faces[real])


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Two triangles for each cell of a rows x columns vertex grid."""
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (q.ravel() for q in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    return np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _rays(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays from a capsule's axis inside the car.

    u in 0..1 runs tail to nose (fans at both ends), v in 0..pi runs from below over the
    left flank to the roof. Same shapes in, (n,3) origins and directions out.
    """
    x_rear, x_front, fan = -1.25, 1.15, 0.19
    along = np.clip((u - fan) / (1 - 2 * fan), 0, 1)
    origin = np.stack([x_rear + (x_front - x_rear) * along, 0 * u, 0.58 + 0 * u], 1)
    tilt = np.clip((u - (1 - fan)) / fan, 0, 1) - np.clip((fan - u) / fan, 0, 1)
    angle = tilt * np.pi / 2
    sin_v = np.where((v <= 0) | (v >= np.pi), 0.0, np.sin(v))
    direction = np.stack([np.sin(angle), np.cos(angle) * sin_v, -np.cos(angle) * np.cos(v)], 1)
    direction[np.abs(tilt) == 1] = np.array([1, 0, 0]) * tilt[np.abs(tilt) == 1][:, None]
    return origin, direction


def _spread(points: np.ndarray, count: int, bend: float) -> np.ndarray:
    """Fractions (rows, count) along each row's polyline (rows, m, 3), denser where it bends."""
    step = np.diff(points, axis=1)
    length = np.linalg.norm(step, axis=2)
    unit = step / np.maximum(length, 1e-9)[..., None]
    turn = np.zeros_like(length)
    turn[:, 1:] = np.arccos(np.clip((unit[:, 1:] * unit[:, :-1]).sum(2), -1, 1))
    cost = length + bend * turn
    middle = 0.5 * (points[:, 1:] + points[:, :-1])
    cost = np.where(middle[..., 2] < 0.23, 0.25 * cost, cost)  # few triangles for the underside
    kernel = np.hanning(15)
    kernel /= kernel.sum()
    for axis in (0, 1):  # neighbouring rows must get alike spacings, so smooth both ways
        pad = [(7, 7) if a == axis else (0, 0) for a in (0, 1)]
        cost = np.apply_along_axis(np.convolve, axis, np.pad(cost, pad, "edge"), kernel, "valid")
    total = np.hstack([np.zeros((len(cost), 1)), np.cumsum(cost, axis=1)])
    total /= total[:, -1:]
    even = np.linspace(0, 1, total.shape[1])
    want = np.linspace(0, 1, count)
    return np.array([np.interp(want, row, even) for row in total])


def half_body(stations: int, around: int) -> Shell:
    """Grid shell of the car's left half (y >= 0), every vertex on the skin."""
    fine_u, fine_v = np.linspace(0, 1, 161), np.linspace(0, np.pi, 241)
    uu, vv = np.meshgrid(fine_u, fine_v, indexing="ij")
    coarse = body.cast(*_rays(uu.ravel(), vv.ravel())).reshape(161, 241, 3)
    along = _spread(coarse.transpose(1, 0, 2)[20:-20], stations, 0.10).mean(axis=0)
    rows = (
        np.array([np.interp(along, fine_u, column) for column in _spread(coarse, around, 0.12).T]).T
        * np.pi
    )
    u = np.repeat(along, around)
    v = rows.ravel()
    vertices = body.cast(*_rays(u, v))
    vertices[np.abs(vertices[:, 1]) < 1e-9, 1] = 0
    return weld(Shell(vertices, body.normals(vertices), grid_faces(stations, around)[:, ::-1]))


def split(shell: Shell, field: Field, on_skin: bool = True, reach: float = np.inf) -> Shell:
    """Cut triangles along field = 0, so that each lies wholly on one side of the line.

    Triangles with a corner farther than `reach` from the line are left alone.
    """
    value = field(shell.vertices)
    positive = value >= 0
    faces = shell.faces
    mixed = positive[faces].any(1) & ~positive[faces].all(1) & (np.abs(value[faces]) < reach).all(1)
    if not mixed.any():
        return shell
    cut = faces[mixed]
    lone = np.argmax(positive[cut] == (positive[cut].sum(1) == 1)[:, None], axis=1)
    cut = np.stack([cut[np.arange(len(cut)), (lone + k) % 3] for k in range(3)], 1)
    ends = np.sort(np.vstack([cut[:, [0, 1]], cut[:, [0, 2]]]), axis=1)
    edges, which = np.unique(ends, axis=0, return_inverse=True)
    a, b = shell.vertices[edges[:, 0]], shell.vertices[edges[:, 1]]
    low, high = np.zeros(len(a)), np.ones(len(a))
    start = positive[edges[:, 0]]
    for _ in range(24):
        mid = 0.5 * (low + high)
        same = (field(a + mid[:, None] * (b - a)) >= 0) == start
        low, high = np.where(same, mid, low), np.where(same, high, mid)
    t = (0.5 * (low + high))[:, None]
    new = a + t * (b - a)
    new[(a[:, 1] == 0) & (b[:, 1] == 0), 1] = 0
    if on_skin:
        new = body.project(new)
        new_normals = body.normals(new)
    else:
        new_normals = (1 - t) * shell.normals[edges[:, 0]] + t * shell.normals[edges[:, 1]]
        new_normals /= np.linalg.norm(new_normals, axis=1, keepdims=True)
    which = which.reshape(-1) + len(shell.vertices)
    ab, ac = which[: len(cut)], which[len(cut) :]
    pieces = [
        np.stack(q, 1)
        for q in ((cut[:, 0], ab, ac), (ab, cut[:, 1], cut[:, 2]), (ab, cut[:, 2], ac))
    ]
    return Shell(
        np.vstack([shell.vertices, new]),
        np.vstack([shell.normals, new_normals]),
        np.vstack([faces[~mixed], *pieces]),
    )


def rim_wall(outer: Shell, inner: Shell) -> Shell:
    """Wall between the open borders of a shell and of its moved copy (same faces)."""
    edges = np.vstack([outer.faces[:, [0, 1]], outer.faces[:, [1, 2]], outer.faces[:, [2, 0]]])
    key = np.sort(edges, axis=1)
    _, back, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    border = edges[count[back.reshape(-1)] == 1]
    a, b = border[:, 0], border[:, 1]
    pa, pb, qa, qb = outer.vertices[a], outer.vertices[b], inner.vertices[a], inner.vertices[b]
    side = np.cross(qa - pa, pb - pa)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    n = len(border)
    i = np.arange(n)
    faces = np.vstack(
        [np.stack([i, i + 2 * n, i + n], 1), np.stack([i + n, i + 2 * n, i + 3 * n], 1)]
    )
    return weld(Shell(np.vstack([pa, pb, qa, qb]), np.tile(side, (4, 1)), faces))
