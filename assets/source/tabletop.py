"""Things on a table, in the sun: models from files, so close that they hide one another.

World frame: the table is z = 0, metres; the models' unit is mm, their z is up.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import nodes
import numpy as np
import street
import trimesh

UNIT = 0.001
CROWDED = 1.1
"""Share of the room beside one another that things have."""


def build(models: Sequence[Path], seed: int = 5) -> dict[str, bpy.types.Object]:
    """Put table and things into the scene, in a ring, turned at random; by the models' names."""
    rng = np.random.default_rng(seed)
    wood = nodes.mottled("wood", (0.16, 0.09, 0.045), (0.42, 0.27, 0.15), 9.0, 0.5, 0.0005)
    street.box((-1.2, -1.2, -0.04), (1.2, 1.2, 0.0), wood, 0.004)
    things = {path.stem: _load(path, rng) for path in models}
    wide = [UNIT * max(np.ptp(_points(thing)[:, :2], axis=0)) for thing in things.values()]
    radius = CROWDED * sum(wide) / (2.0 * np.pi)
    ends = np.cumsum(wide)
    angles = 2.0 * np.pi * (ends - np.array(wide) / 2.0) / ends[-1]
    for thing, angle in zip(things.values(), angles, strict=True):
        middle = np.append(_points(thing)[:, :2].mean(axis=0), _points(thing)[:, 2].min())
        turn = rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        at = np.array([radius * np.cos(angle), radius * np.sin(angle), 0.0])
        thing.rotation_euler = (0.0, 0.0, turn)
        thing.location, thing.scale = at - UNIT * rotation @ middle, (UNIT,) * 3
    bpy.context.view_layer.update()
    return things


def place_of(thing: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3,3) and translation (3,), mm: world from model."""
    world = np.array(thing.matrix_world)
    u, _, vt = np.linalg.svd(world[:3, :3])  # Blender's numbers are single precision
    return u @ vt, world[:3, 3] / UNIT


def _points(thing: bpy.types.Object) -> np.ndarray:
    return np.array([v.co for v in thing.data.vertices])


def _load(path: Path, rng: np.random.Generator) -> bpy.types.Object:
    """The model in its own frame, with its texture or the colours of its corners."""
    model = trimesh.load(path, process=False, force="mesh")
    m = nodes.Material(
        path.stem, Roughness=rng.uniform(0.3, 0.7), Coat_Weight=rng.choice([0.0, 0.4])
    )
    thing = street.add_mesh(path.stem, model.vertices, model.faces.tolist(), m.data)
    mesh = thing.data
    mesh.polygons.foreach_set("use_smooth", np.ones(len(model.faces), dtype=bool))
    if model.visual.kind == "texture":
        corners = model.visual.uv[model.faces.ravel()]
        mesh.uv_layers.new().data.foreach_set("uv", corners.ravel())
        picture = model.visual.material.image.convert("RGBA")
        image = bpy.data.images.new(path.stem, *picture.size)
        image.pixels = (np.asarray(picture)[::-1] / 255.0).ravel().tolist()
        node = m.add("TexImage")
        node.image = image
    else:
        layer = mesh.color_attributes.new("colour", "BYTE_COLOR", "POINT")
        layer.data.foreach_set("color_srgb", (model.visual.vertex_colors / 255.0).ravel())
        node = m.add("VertexColor")
        node.layer_name = "colour"
    m.link(node.outputs["Color"], "Base Color")
    return thing
