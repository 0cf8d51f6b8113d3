"""The street in which the demo car is photographed: our own, from boxes, tubes and leaves.

World frame = car frame: x along the road, the house row on the car's right (y < 0), metres.
"""

from __future__ import annotations

import bpy
import nodes
import numpy as np

KERB_Y = -1.22
WALL_Y = -4.1


def add_mesh(
    name: str, vertices: np.ndarray, faces: list, material: bpy.types.Material
) -> bpy.types.Object:
    """New object from vertices (n,3) and faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(vertices).tolist(), [], [list(map(int, f)) for f in faces])
    mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def box(
    low: tuple, high: tuple, material: bpy.types.Material, bevel: float = 0.0
) -> bpy.types.Object:
    """Axis-aligned box, its edges bevelled by `bevel` metres."""
    corners = np.array(
        [
            [(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ]
    )
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    thing = add_mesh("box", corners, faces, material)
    if bevel:
        modifier = thing.modifiers.new("bevel", "BEVEL")
        modifier.width, modifier.segments = bevel, 2
    return thing


def tube(low: tuple, high: tuple, radius: float, material: bpy.types.Material) -> bpy.types.Object:
    """Round bar between two points."""
    a, b = np.array(low, float), np.array(high, float)
    w = (b - a) / np.linalg.norm(b - a)
    u = np.cross(w, [0.3, 0.5, 0.81])
    u /= np.linalg.norm(u)
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None]
    ring = radius * (np.cos(t) * u + np.sin(t) * np.cross(w, u))
    faces = [(i, (i + 1) % 24, (i + 1) % 24 + 24, i + 24) for i in range(24)]
    return add_mesh("tube", np.vstack([a + ring, b + ring]), [*faces, range(24, 48)], material)


def leaves(
    low: tuple, high: tuple, count: int, size: float, seed: int, material: bpy.types.Material
) -> None:
    """A clipped hedge or a tree crown: small leaves, most of them near the outside of a box."""
    rng = np.random.default_rng(seed)
    low_, high_ = np.array(low), np.array(high)
    unit = rng.uniform(-1, 1, (count, 3))
    unit[np.arange(count), rng.integers(0, 3, count)] *= 1.0
    unit = np.sign(unit) * np.abs(unit) ** 0.55
    centre = 0.5 * (low_ + high_) + 0.5 * unit * (high_ - low_) + rng.normal(0, 0.02, (count, 3))
    a = rng.normal(size=(count, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(a, rng.normal(size=(count, 3)))
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    s = size * rng.uniform(0.6, 1.3, (count, 1))
    quad = np.stack([centre - s * a, centre + 0.5 * s * b, centre + s * a, centre - 0.5 * s * b], 1)
    add_mesh("leaves", quad.reshape(-1, 3), np.arange(4 * count).reshape(-1, 4).tolist(), material)


def window(
    x: float, z: float, wide: float, tall: float, y: float, kit: dict, panes: int = 2
) -> None:
    """Framed window with sill, lintel, curtain, in a wall whose face is at y."""
    left, right, top = x - wide / 2, x + wide / 2, z + tall
    box((left, y - 0.4, z), (right, y + 0.004, top), kit["dark"])
    box((left - 0.08, y - 0.05, top), (right + 0.08, y + 0.018, top + 0.21), kit["stone"], 0.006)
    box((left - 0.10, y - 0.05, z - 0.09), (right + 0.10, y + 0.085, z), kit["stone"], 0.010)
    for low, high in ((left, left + 0.26 * wide), (right - 0.22 * wide, right)):
        box((low, y - 0.3, z), (high, y + 0.008, top), kit["curtain"])
    box((left, y + 0.012, z), (right, y + 0.014, top), kit["pane"])
    for side in (left, right - 0.06):
        box((side, y, z), (side + 0.06, y + 0.035, top), kit["frame"], 0.006)
    for low in (z, top - 0.06, z + 0.62 * tall):
        box((left, y, low), (right, y + 0.035, low + 0.06), kit["frame"], 0.006)
    for i in range(1, panes):
        at = left + i * wide / panes
        box((at - 0.025, y, z), (at + 0.025, y + 0.030, top), kit["frame"], 0.005)


def door(x: float, y: float, colour: bpy.types.Material, kit: dict) -> None:
    """House door with panels, fanlight, step and letter slot."""
    box((x - 0.55, y - 0.05, 0.15), (x + 0.55, y + 0.03, 2.62), kit["frame"], 0.01)
    box((x - 0.46, y, 0.30), (x + 0.46, y + 0.045, 2.20), colour, 0.006)
    box((x - 0.44, y, 2.26), (x + 0.44, y + 0.040, 2.54), kit["pane"])
    for low, high in ((0.42, 0.98), (1.18, 2.06)):
        for a, b in ((-0.36, -0.05), (0.05, 0.36)):
            box((x + a, y, low), (x + b, y + 0.058, high), colour, 0.012)
    box((x - 0.12, y, 1.05), (x + 0.12, y + 0.062, 1.10), kit["brass"], 0.004)
    box((x - 0.75, y, 0.10), (x + 0.75, y + 0.42, 0.27), kit["stone"], 0.015)


def house(
    x0: float, x1: float, y: float, wall: bpy.types.Material, kit: dict, openings: list
) -> None:
    """One house front; openings are (kind, x, ...)."""
    box((x0, y - 4.0, 0.0), (x1, y, 7.2), wall)
    box((x0, y - 0.1, 0.0), (x1, y + 0.035, 0.55), kit["plinth"], 0.008)
    box((x0, y - 0.3, 7.0), (x1, y + 0.30, 7.25), kit["frame"])
    for opening in openings:
        if opening[0] == "door":
            door(opening[1], y, opening[2], kit)
        else:
            window(opening[1], 1.12, opening[2], 1.35, y, kit, opening[3])
            window(opening[1], 4.0, opening[2], 1.35, y, kit, opening[3])


def ground(kit: dict) -> None:
    """Road, patches, marking, gutter, kerb stones, pavement."""
    box((-120, KERB_Y, -0.5), (120, 120, 0.0), nodes.asphalt())
    patch = nodes.mottled("patch", (0.050, 0.050, 0.052), (0.095, 0.094, 0.092), 6.0)
    box((-3.9, 1.55, -0.1), (-1.35, 3.2, 0.003), patch)
    box((2.1, -0.2, -0.1), (2.9, 1.25, 0.003), patch)
    marking = nodes.worn_paint()
    for start in (-34.0, -26.0, -18.0, -10.0, -2.2, 5.8):
        box((start, 3.35, -0.1), (start + 3.4, 3.47, 0.004), marking)
    box((-120, KERB_Y - 0.001, -0.1), (120, KERB_Y + 0.26, 0.005), kit["gutter"])
    rng = np.random.default_rng(4)
    x = -40.0
    while x < 14:
        low = rng.uniform(-0.006, 0.006)
        box((x, KERB_Y - 0.15, -0.1), (x + 0.905, KERB_Y + low, 0.125 + low), kit["stone"], 0.018)
        x += 0.915
    box((-120, -4.6, -0.1), (120, KERB_Y - 0.15, 0.118), kit["slabs"])
    lid = nodes.plain("iron", (0.05, 0.048, 0.046), Roughness=0.5, Metallic=0.7)
    tube((-1.9, 2.55, -0.1), (-1.9, 2.55, 0.006), 0.32, lid)
    box((2.6, KERB_Y + 0.01, -0.1), (3.05, KERB_Y + 0.25, 0.008), lid)


def build() -> None:
    """Put the whole street into the scene."""
    kit = {
        "stone": nodes.mottled("stone", (0.30, 0.29, 0.27), (0.47, 0.46, 0.43), 3.0),
        "plinth": nodes.mottled("plinth", (0.16, 0.155, 0.15), (0.25, 0.24, 0.23), 2.5),
        "gutter": nodes.mottled("gutter", (0.13, 0.13, 0.125), (0.23, 0.225, 0.215), 5.0),
        "frame": nodes.plain("frame", (0.70, 0.69, 0.66), Roughness=0.4),
        "dark": nodes.plain("dark", (0.02, 0.02, 0.022), Roughness=0.8),
        "pane": nodes.tinted_glass("pane", (0.02, 0.02, 0.02), 0.85),
        "curtain": nodes.mottled("curtain", (0.33, 0.31, 0.27), (0.55, 0.52, 0.46), 3.0, 0.9, 0.01),
        "brass": nodes.plain("brass", (0.60, 0.45, 0.18), Metallic=1.0, Roughness=0.3),
        "slabs": nodes.bricks(
            "slabs",
            (0.27, 0.26, 0.245),
            (0.36, 0.35, 0.33),
            (0.09, 0.088, 0.08),
            (0.75, 0.56),
            0.010,
            upright=False,
            depth=0.003,
        ),
    }
    ground(kit)
    red = nodes.bricks(
        "red bricks", (0.30, 0.105, 0.060), (0.20, 0.068, 0.045), (0.36, 0.34, 0.30), (0.225, 0.075)
    )
    buff = nodes.bricks(
        "buff bricks", (0.43, 0.33, 0.20), (0.33, 0.245, 0.15), (0.30, 0.28, 0.25), (0.225, 0.075)
    )
    cream = nodes.mottled("render", (0.50, 0.47, 0.39), (0.62, 0.59, 0.51), 0.8)
    green = nodes.plain("green door", (0.020, 0.085, 0.050), Roughness=0.25)
    wine = nodes.plain("wine door", (0.16, 0.018, 0.022), Roughness=0.25)
    y = WALL_Y
    house(
        -6.2,
        2.3,
        y,
        red,
        kit,
        [("window", -0.1, 1.7, 3), ("door", -2.35, green), ("window", -4.5, 1.6, 2)],
    )
    house(-13.6, -6.2, y + 0.12, cream, kit, [("door", -7.6, wine), ("window", -10.0, 1.8, 3)])
    house(
        -24.0,
        -13.6,
        y,
        buff,
        kit,
        [("window", -15.5, 1.5, 2), ("door", -18.0, green), ("window", -21, 1.5, 2)],
    )
    house(-60.0, -24.0, y + 0.2, red, kit, [("window", -27.0, 1.6, 2), ("window", -33.0, 1.6, 2)])
    house(
        2.3,
        10.5,
        y + 0.10,
        buff,
        kit,
        [("window", 4.3, 1.7, 3), ("door", 6.8, wine), ("window", 9.0, 1.5, 2)],
    )
    house(10.5, 40.0, y, cream, kit, [("window", 13.0, 1.7, 3), ("window", 18.0, 1.7, 3)])
    pipe = nodes.plain("pipe", (0.035, 0.036, 0.038), Roughness=0.4)
    for x in (-6.12, 2.2, -13.5):
        tube((x, y + 0.2, 0.12), (x, y + 0.2, 7.0), 0.045, pipe)
        for z in (0.6, 2.5, 4.4):
            tube((x, y + 0.2, z), (x, y + 0.2, z + 0.06), 0.060, pipe)
    tube((-8.4, KERB_Y - 0.45, 0.1), (-8.4, KERB_Y - 0.45, 6.0), 0.065, pipe)
    tube((-8.4, KERB_Y - 0.45, 0.1), (-8.4, KERB_Y - 0.45, 1.1), 0.095, pipe)
    leaf = nodes.mottled("leaf", (0.020, 0.060, 0.012), (0.070, 0.150, 0.030), 9.0, 0.5)
    leaves((-5.6, y + 0.12, 0.12), (-3.25, y + 0.62, 0.98), 15000, 0.032, 1, leaf)
    leaves((-1.15, y + 0.12, 0.12), (2.0, y + 0.60, 0.92), 17000, 0.032, 2, leaf)
    # across the road, out of the picture: what the car's paint and panes mirror
    for x0, x1, tall, wall in (
        (-40, -14, 6.5, buff),
        (-12, 1, 5.6, cream),
        (3, 14, 6.6, red),
        (16, 40, 6, buff),
    ):
        far = box((x0, 15.0, 0), (x1, 22.0, tall), wall)
        strip = box((x0 + 0.8, 14.97, 1.0), (x1 - 0.8, 15.1, 2.3), kit["pane"])
        walk = box((x0 - 2, 11.5, 0), (x1 + 2, 15.0, 0.13), kit["slabs"])
        for thing in (far, strip, walk):
            thing.visible_camera = thing.visible_shadow = False
