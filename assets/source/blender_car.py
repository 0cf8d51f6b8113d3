"""Bring the car file into Blender: one object per named part, with the file's own normals.

Runs inside Blender's Python (`bpy`). The car file keeps z up, unlike most glTF files, so
its numbers are taken as they are, without Blender's own importer and its turn of axes.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import trimesh


def load_car(path: Path) -> dict[str, bpy.types.Object]:
    """Add every part of the car at `path` to the scene; returns part name -> object."""
    scene = trimesh.load(path, process=False)
    objects = {}
    for node in scene.graph.nodes_geometry:
        place, geometry = scene.graph[node]
        part = scene.geometry[geometry]
        points = trimesh.transform_points(part.vertices, place)
        mesh = bpy.data.meshes.new(node)
        mesh.from_pydata(points.tolist(), [], part.faces.tolist())
        mesh.polygons.foreach_set("use_smooth", np.ones(len(part.faces), dtype=bool))
        mesh.normals_split_custom_set_from_vertices(np.asarray(part.vertex_normals).tolist())
        objects[node] = bpy.data.objects.new(node, mesh)
        objects[node]["color"] = [float(c) / 255 for c in part.visual.material.main_color]
        objects[node]["material"] = part.visual.material.name or "paint"
        bpy.context.scene.collection.objects.link(objects[node])
    return objects
