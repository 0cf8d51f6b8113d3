"""Blender: a Python script that makes a scene of model, camera and photo.

Blender's camera has OpenGL's axes; its lens is in mm on a sensor, its principal point a shift in
widths of the photo, and unequal focal lengths are the shape of its pixels.
"""

from __future__ import annotations

import json
import os
from importlib.resources import files
from pathlib import Path
from typing import Any

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.gltf import in_front, view_depths
from poseviewer.files.formats.matrices import as_4x4
from poseviewer.files.formats.request import Request, Written, refuse_lens, require_file, write_new
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import PoseRecord
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import BLENDER_FROM_GLTF, OPENGL_FROM_OPENCV
from poseviewer.geometry.mesh import Mesh

SENSOR_MM = 36.0
"""Width of the sensor we claim; only its ratio to the lens counts."""
GLTF = (".glb", ".gltf")
IMPORTED = (*GLTF, ".obj", ".ply", ".stl")
"""What Blender's own importers read."""
DOC = '''"""A model where poseviewer found it, seen by the camera of the photo, in Blender.

Run it with: blender --python {name}
It adds a scene "poseviewer" and touches no other. Lengths are in the model's unit. Blender's axes:
x right, y up, z backward in the camera; the world is the model's frame{turned}.
"""

'''


def write_blender(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write the script; it names model and photo by their paths."""
    refuse_lens(record, "Blender")
    model = require_file(request.model, "model", "Blender")
    if model.suffix.lower() not in IMPORTED:
        raise PoseFileError(
            f"{model.name}: Blender does not import {model.suffix} files; convert the pose "
            "to gltf, which holds the model, and open that."
        )
    if out.suffix.lower() != ".py":
        raise PoseFileError(f"{out.name}: Blender's scripts end in .py; name it so.")
    mesh, is_gltf, photo = load_mesh(model), model.suffix.lower() in GLTF, request.photo
    view = blender_view(in_front(record.pose, mesh), mesh, is_gltf)
    script = (
        DOC.format(name=out.name, turned=", turned from y up to z up" if is_gltf else "")
        + f"MODEL = {_paths(out, model)}\n"
        + f"PHOTO = {_paths(out, photo) if photo else '[]'}\n"
        + f"VIEW = {json.dumps(view, indent=4)}\n\n"
        + files("poseviewer.files.formats").joinpath("blender_scene.txt").read_text("utf-8")
    )
    notes = () if photo else ("No photo is known: there is no background; add --photo FILE.",)
    return write_new(request, {out: script}, *notes)


def _paths(out: Path, path: Path) -> str:
    """Where a file is: from the script's folder, and in full, as a list in Python."""
    whole = path.resolve()
    near = Path(os.path.relpath(whole, out.resolve().parent)).as_posix()
    return json.dumps([near, str(whole)], ensure_ascii=False)


def blender_view(pose: Pose, mesh: Mesh, is_gltf: bool = False) -> dict[str, Any]:
    """Blender's numbers for the camera; unit of both shifts: the photo's width. ``is_gltf``: the
    model came in by Blender's importer of glTF, which turns its axes.
    """
    camera = pose.camera
    near, far = view_depths(pose, mesh)
    place = (OPENGL_FROM_OPENCV @ pose.camera_from_model).inverse()
    if is_gltf:
        place = BLENDER_FROM_GLTF @ place
    lens: dict[str, Any] = {"type": "ORTHO", "sensor_width": SENSOR_MM}
    stretch = 1.0
    if isinstance(camera, Perspective):
        stretch = camera.fx / camera.fy  # height of a pixel, in widths
        lens |= {"type": "PERSP", "lens": camera.fx / camera.width * SENSOR_MM}
    else:
        lens["ortho_scale"] = camera.width / camera.scale
    right = (camera.width / 2.0 - camera.cx) / camera.width
    up = (camera.cy - camera.height / 2.0) * stretch / camera.width
    return lens | {
        "shift": [right, up],
        "clip": [near, 2.0 * far],
        "size": [camera.width, camera.height],
        # Blender allows neither side below 1.
        "pixel_aspect": [max(1.0, 1.0 / stretch), max(1.0, stretch)],
        "world_from_camera": as_4x4(place).tolist(),
    }
