"""Blender: FILE WIDTH HEIGHT ASPECT PICTURE.png OUT.json, or FILE ... OUT.json.

Imports a glTF file, and draws the model's silhouette through the camera it finds there. glTF's
cameras say the aspect ratio of the view, and Blender's importer leaves it to whoever sets the
picture's size. Of files alone it writes each one's vertices in glTF's world, skinned and instanced,
and the sizes of its objects.
"""

import json
import sys
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]


def load(file: str) -> bpy.types.Scene:
    """The scene of a glTF file, and nothing else."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=file)
    return bpy.context.scene


def shapes(file: str) -> dict:
    """What a file has; Blender's z is up, glTF's y."""
    scene, vertices = load(file), []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "MESH" and "shape" not in instance.object.name.lower():
            places = [instance.matrix_world @ v.co for v in instance.object.data.vertices]
            vertices += [(x, z, -y) for x, y, z in places]
    sizes = {item.name: [*item.dimensions] for item in scene.objects if item.type == "MESH"}
    return {"vertices": vertices, "sizes": sizes}


def draw(file: str, width: str, height: str, aspect: str, picture: str) -> dict:
    """Draw a file's model into the picture; return the names of its objects."""
    scene = load(file)
    scene.camera = next(item for item in scene.objects if item.type == "CAMERA")
    scene.render.resolution_x, scene.render.resolution_y = int(width), int(height)
    scene.render.pixel_aspect_y = int(width) / int(height) / float(aspect)
    scene.render.film_transparent = True
    scene.view_layers[0].material_override = bpy.data.materials.new("opaque")
    names = [item.name for item in scene.objects]
    for item in scene.objects:
        item.hide_render = item.type == "MESH" and item.name == "photo plane"
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.cycles.pixel_filter_type, scene.cycles.max_bounces = "BOX", 0
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True, scene=scene.name)
    return {"objects": names}


*given, out = sys.argv[1:]
drawn = given[-1].endswith(".png")
answer = draw(*given) if drawn else {Path(file).stem: shapes(file) for file in given}
Path(out).write_text(json.dumps(answer))
