"""Run in Blender's Python, in a process of its own (bpy and NumPy, nothing of ours):
``python blender.py FOLDER`` path-traces a vehicle on a ground that catches its shadow, as
``job.json`` and ``arrays.npz`` in the folder say; the picture is that before any background.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np
from mathutils import Matrix, Vector  # pyright: ignore[reportMissingImports]

JOB, ARRAYS, PICTURE, RENDERED = "job.json", "arrays.npz", "picture.npy", "rendered.exr"
MOST_BOUNCES, MOST_PANES = 6, 12
NOISE_LEFT = 0.01
"""A pixel whose noise is below it takes no more samples."""


COLOURS = "colours"
"""Name of the mesh's colour attribute."""
LINING = (0.05, 0.05, 0.052, 1.0)
"""Of the inside of the paint, which has no thickness: the cabin's dark lining."""
PANE_CLEAR, PANE_IOR = 0.4, 1.55
"""Share of the light that a tinted pane lets through; its refractive index, for reflections."""
SETTINGS: dict[str, dict[str, float]] = {
    "paint": {"Roughness": 0.36, "Metallic": 0.12, "Coat Weight": 1.0, "Coat Roughness": 0.02},
    "plastic": {"Roughness": 0.4},
    "rubber": {"Roughness": 0.8},
    "metal": {"Roughness": 0.22, "Metallic": 0.85},
    "glass": {},
}
"""Inputs of Blender's Principled BSDF for each finish."""


def draw(folder: Path) -> None:
    """Write ``PICTURE``, (h, w, 4) float32: linear RGB times alpha, and alpha, rows from above."""
    job = json.loads((folder / JOB).read_text())
    arrays = np.load(folder / ARRAYS)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _add_model(arrays, job["finishes"])
    _add_camera(job["view"])
    _set_renderer(job)
    if job["silhouette"]:
        opaque = bpy.data.materials.new("opaque")
        bpy.context.scene.view_layers[0].material_override = opaque
    else:
        _add_ground(job["ground"])
        _add_sun(job["sun"])
        _add_surroundings(arrays["surroundings"])
    np.save(folder / PICTURE, _render(folder / RENDERED))


def _add_model(arrays: Any, finishes: list[str]) -> None:
    faces = arrays["faces"]
    mesh = bpy.data.meshes.new("model")
    mesh.from_pydata(arrays["vertices"].tolist(), [], faces.tolist())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), dtype=bool))
    mesh.polygons.foreach_set("material_index", arrays["face_finish"].astype(np.int32))
    colours = mesh.color_attributes.new(COLOURS, "FLOAT_COLOR", "CORNER")
    rgba = np.ones((faces.size, 4), np.float32)
    rgba[:, :3] = arrays["corner_colours"].reshape(-1, 3)
    colours.data.foreach_set("color", rgba.ravel())
    mesh.normals_split_custom_set_from_vertices(arrays["normals"].tolist())
    for finish in finishes:
        mesh.materials.append(_make_material(finish))
    _link(bpy.data.objects.new("model", mesh))


def _add_ground(ground: dict[str, Any]) -> None:
    """A square at z = 0 of which only the shadow is seen, and what the model mirrors of it."""
    half = ground["size"] / 2.0
    corners = [(-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0)]
    mesh = bpy.data.meshes.new("ground")
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("ground")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*ground["colour"], 1.0)
    surface.inputs["Roughness"].default_value = 0.9
    mesh.materials.append(material)
    placed = bpy.data.objects.new("ground", mesh)
    placed.is_shadow_catcher = True
    _link(placed)


def _add_sun(sun: dict[str, Any]) -> None:
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.angle, lamp.color = sun["strength"], sun["angle"], sun["colour"]
    placed = bpy.data.objects.new("sun", lamp)
    placed.rotation_euler = Vector(sun["towards"]).to_track_quat("Z", "Y").to_euler()
    _link(placed)


def _add_surroundings(picture: Any) -> None:
    """(h, w, 3) linear RGB in all directions, rows from above: light, and what is mirrored."""
    height, width = picture.shape[:2]
    image = bpy.data.images.new("surroundings", width, height, float_buffer=True, is_data=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1]  # Blender counts rows from below
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    world = bpy.data.worlds.new("surroundings")
    world.use_nodes = True
    node = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = image
    background = world.node_tree.nodes["Background"]
    world.node_tree.links.new(node.outputs["Color"], background.inputs["Color"])
    bpy.context.scene.world = world


def _add_camera(view: dict[str, Any]) -> None:
    camera = bpy.data.cameras.new("camera")
    camera.type = view["type"]
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", view["sensor_width"]
    if view["type"] == "PERSP":
        camera.lens = view["lens"]
    else:
        camera.ortho_scale = view["ortho_scale"]
    camera.shift_x, camera.shift_y = view["shift"]
    camera.clip_start, camera.clip_end = view["clip"]
    placed = bpy.data.objects.new("camera", camera)
    placed.matrix_world = Matrix(view["world_from_camera"])
    _link(placed)
    scene = bpy.context.scene
    scene.camera = placed
    scene.render.resolution_x, scene.render.resolution_y = view["size"]
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = view["pixel_aspect"]


def _set_renderer(job: dict[str, Any]) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.seed = job["samples"], job["seed"]
    cycles.use_adaptive_sampling, cycles.adaptive_threshold = True, NOISE_LEFT
    cycles.max_bounces, cycles.transparent_max_bounces = MOST_BOUNCES, MOST_PANES
    cycles.use_denoising = not job["silhouette"]
    if job["silhouette"]:
        cycles.pixel_filter_type = "BOX"
        cycles.max_bounces = 0


def _render(path: Path) -> Any:
    scene = bpy.context.scene
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(height, width, 4)[::-1]


def _link(thing: Any) -> None:
    bpy.context.scene.collection.objects.link(thing)


def _make_material(finish: str) -> Any:
    """The material of a finish."""
    material = bpy.data.materials.new(finish)
    material.use_nodes = True
    tree = material.node_tree
    if finish == "glass":
        _make_pane(tree)
        return material
    surface = tree.nodes["Principled BSDF"]
    for name, value in SETTINGS[finish].items():
        surface.inputs[name].default_value = value
    colour = tree.nodes.new("ShaderNodeVertexColor")
    colour.layer_name = COLOURS
    tree.links.new(colour.outputs["Color"], surface.inputs["Base Color"])
    if finish == "paint":
        lining = tree.nodes.new("ShaderNodeBsdfDiffuse")
        lining.inputs["Color"].default_value = LINING
        back = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
        _show(tree, _mixed(tree, back, surface, lining))
    return material


def _make_pane(tree: Any) -> None:
    """A thin pane: partly clear, and a mirror as far as Fresnel's equations have it."""
    through = tree.nodes.new("ShaderNodeBsdfTransparent")
    through.inputs["Color"].default_value = (PANE_CLEAR * 0.93, PANE_CLEAR, PANE_CLEAR * 0.96, 1.0)
    shine = tree.nodes.new("ShaderNodeBsdfGlossy")
    shine.inputs["Roughness"].default_value = 0.004
    fresnel = tree.nodes.new("ShaderNodeFresnel")
    fresnel.inputs["IOR"].default_value = PANE_IOR
    _show(tree, _mixed(tree, fresnel.outputs[0], through, shine))


def _mixed(tree: Any, share: Any, first: Any, second: Any) -> Any:
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(share, mix.inputs[0])
    tree.links.new(first.outputs[0], mix.inputs[1])
    tree.links.new(second.outputs[0], mix.inputs[2])
    return mix


def _show(tree: Any, shader: Any) -> None:
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
