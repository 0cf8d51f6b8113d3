"""Blender: FILE WIDTH HEIGHT ASPECT PICTURE.png OUT.json.

Imports a glTF file, and draws the model's silhouette through the camera it finds there. glTF's
cameras say the aspect ratio of the view, and Blender's importer leaves it to whoever sets the
picture's size.
"""

import json
import sys
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]

file, width, height, aspect, picture, out = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=file)
scene = bpy.context.scene
scene.camera = next(item for item in scene.objects if item.type == "CAMERA")
scene.render.resolution_x, scene.render.resolution_y = int(width), int(height)
scene.render.pixel_aspect_y = int(width) / int(height) / float(aspect)
scene.render.film_transparent = True

opaque = bpy.data.materials.new("opaque")
scene.view_layers[0].material_override = opaque
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
Path(out).write_text(json.dumps({"objects": names}))
