"""Model, camera and photo together, to be looked at: MeshLab's project, and a Python script that
makes a scene in Blender.

MeshLab (the VCG library's ``Shot``): the axes of the rows of ``RotationMatrix`` are OpenGL's,
``TranslationVector`` is minus the camera's place, and ``CenterPx`` counts from the lower left
corner of the picture, with pixel centres at i + 0.5. Blender's camera has OpenGL's axes; its lens
is in mm on a sensor, its principal point a shift in widths of the photo, and unequal focal lengths
are the shape of its pixels.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import Reading
from poseviewer.files.formats.conversion import (
    ConvertOptions,
    Format,
    Written,
    make_record,
    photo_name,
    refuse_lens,
    require_file,
    require_pinhole,
    size_of,
    the_one,
    write_new,
)
from poseviewer.files.formats.gltf import before_camera, in_front, view_depths
from poseviewer.files.formats.matrices import as_4x4, from_4x4
from poseviewer.files.mesh.load import GLTF as GLTF_ENDINGS
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import PoseRecord, set_frame
from poseviewer.files.scene import SceneRecord
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import (
    BLENDER_FROM_GLTF,
    OPENGL_FROM_OPENCV,
    camera_with_rows_from_below,
)
from poseviewer.geometry.transform import RigidTransform

SENSOR_MM = 36.0
"""Width of the sensor we claim: both tools want mm, of which only ratios count."""
IMPORTED = (*GLTF_ENDINGS, ".obj", ".ply", ".stl")
"""What Blender's own importers read."""
DOC = '''"""What poseviewer found where it found it, seen by the camera of the photo, in Blender.

Run it with: blender --python {name}
It adds a scene "poseviewer" and touches no other. Lengths are in the model's unit. Blender's axes:
x right, y up, z backward in the camera; the world is {world}.
"""

'''


def write_meshlab(record: PoseRecord, out: Path, request: ConvertOptions) -> Written:
    """Write a project that names model and photo by their paths from its folder."""
    model = require_file(request.model, "model", "MeshLab")
    return _write_project(record, {model.name: (model, np.eye(4))}, out, request)


def write_meshlab_scene(scene: SceneRecord, out: Path, request: ConvertOptions) -> Written:
    """Write all objects of a scene; the project's world is the camera's frame, OpenCV's axes."""
    of_camera = replace(scene.objects[0].record, pose=Pose(scene.camera, RigidTransform.identity()))
    models = {
        one.id: (one.model, as_4x4(one.record.pose.camera_from_model)) for one in scene.objects
    }
    photo = replace(request, photo=request.photo or scene.photo)
    return _write_project(of_camera, models, out, photo)


def _write_project(
    record: PoseRecord,
    models: Mapping[str, tuple[Path, FloatArray]],
    out: Path,
    request: ConvertOptions,
) -> Written:
    """Write models, each by its label with the matrix (4, 4) that puts it into the world, which the
    record's pose is from.
    """
    require_pinhole(record, "MeshLab")
    require_file(request.photo, "photo", "MeshLab")
    add, root = ElementTree.SubElement, ElementTree.Element("MeshLabProject")
    if frame := set_frame(record):
        root.append(ElementTree.Comment(f" {frame.sentence.replace('--', '- -')} "))
    group = add(root, "MeshGroup")
    for label, (model, place) in models.items():
        mesh = {"label": label, "visible": "1", "filename": _from_folder(out, model)}
        matrix = add(add(group, "MLMesh", mesh), "MLMatrix44")
        matrix.text = "\n" + "".join(f"{_words(row)} \n" for row in place)
    rasters, notes = add(root, "RasterGroup"), []
    for one, asked in ((record, request), *request.others):
        if asked.photo is None:
            notes.append(f"{photo_name(one)} is not there, and is left out.")
            continue
        raster = add(rasters, "MLRaster", {"label": asked.photo.name})
        add(raster, "VCGCamera", _shot(one))
        add(raster, "Plane", {"semantic": "1", "fileName": _from_folder(out, asked.photo)})
    ElementTree.indent(root, " ")
    text = "<!DOCTYPE MeshLabDocument>\n" + ElementTree.tostring(root, encoding="unicode") + "\n"
    return write_new(request, {out: text}, *notes)


def _shot(record: PoseRecord) -> dict[str, str]:
    """MeshLab's words for a camera."""
    camera = camera_with_rows_from_below(require_pinhole(record, "MeshLab"))
    place = OPENGL_FROM_OPENCV @ record.pose.camera_from_model
    pixel_mm = SENSOR_MM / camera.width
    focal_mm = camera.fx * pixel_mm
    return {
        "TranslationVector": _words((*-place.inverse().translation, 1.0)),
        "LensDistortion": "0 0",
        "ViewportPx": f"{camera.width} {camera.height}",
        "PixelSizeMm": _words((pixel_mm, focal_mm / camera.fy)),
        "CenterPx": _words((camera.cx, camera.cy)),
        "FocalMm": repr(float(focal_mm)),
        "RotationMatrix": _words(as_4x4(RigidTransform(place.rotation, np.zeros(3))).reshape(-1)),
        "CameraType": "0",
        "BinaryData": "0",
    }


def _from_folder(out: Path, path: Path) -> str:
    """Where a file is, from the folder of ``out``."""
    return Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()


def _words(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def read_meshlab(path: Path, request: ConvertOptions) -> PoseRecord:
    """Read one raster: ``request.image`` by its label, or the only one.

    The project's world is taken for the model's frame; a mesh that the project moves is refused.
    """
    reading = Reading(path, kind="MeshLab project (.mlp)")
    try:
        root = ElementTree.fromstring(reading.load_bytes())  # expat refuses bombs of entities
    except ElementTree.ParseError as error:
        raise reading.error(f"not XML ({error})", "wanted a MeshLab project (.mlp)") from error
    for matrix in root.iter("MLMatrix44"):
        text = matrix.text or ""
        numbers = reading.words(text, "MLMatrix44", 16) if text.strip() else np.eye(4).reshape(-1)
        if not np.allclose(numbers, np.eye(4).reshape(-1), rtol=0.0, atol=1e-12):
            raise reading.error(
                "the project moves its mesh (MLMatrix44)",
                "freeze that matrix in MeshLab (Matrix: Freeze Current Matrix)",
            )
    rasters = list(root.iter("MLRaster"))
    labels = [raster.get("label") or "" for raster in rasters]
    raster = the_one(reading, request, "rasters", labels, rasters)
    shot = raster.find("VCGCamera")
    if shot is None:
        raise reading.error("the raster has no VCGCamera", "wanted a raster with its camera")

    def numbers_of(name: str, count: int) -> list[float]:
        return reading.words(shot.get(name, ""), name, count)

    if shot.get("CameraType", "0") != "0" or any(numbers_of("LensDistortion", 2)):
        raise reading.error(
            "its camera has distortion or is not in perspective", "wanted a pinhole camera"
        )
    width, height = size_of(reading, request, *numbers_of("ViewportPx", 2))
    (focal_mm,), pixel_mm = numbers_of("FocalMm", 1), numbers_of("PixelSizeMm", 2)
    if not min(focal_mm, *pixel_mm) > 0.0:
        raise reading.error("FocalMm or PixelSizeMm is not above 0", "wanted a camera")
    fx, fy = (focal_mm / side for side in pixel_mm)
    cx, cy = numbers_of("CenterPx", 2)
    camera = Perspective(fx, fy, cx, cy, width, height)
    rows = np.reshape(numbers_of("RotationMatrix", 16), (4, 4)).tolist()
    rotation = from_4x4(reading, rows, "RotationMatrix").rotation
    translation = rotation @ np.array(numbers_of("TranslationVector", 4)[:3])
    place = OPENGL_FROM_OPENCV @ RigidTransform(rotation, translation)
    pose = Pose(camera_with_rows_from_below(camera), place)
    return make_record(reading, pose, raster.get("label"), request.unit)


def write_blender(record: PoseRecord, out: Path, request: ConvertOptions) -> Written:
    """Write the script; it names model and photo by their paths."""
    refuse_lens(record, "Blender")
    model = require_file(request.model, "model", "Blender")
    _require_imported(model)
    mesh, is_gltf = load_mesh(model), model.suffix.lower() in GLTF_ENDINGS
    pose = in_front(record.pose, mesh)
    world = "the model's frame" + (", turned from y up to z up" if is_gltf else "")
    view = blender_view(pose, view_depths(pose, mesh), is_gltf)
    others = []
    for one, asked in request.others:
        refuse_lens(one, "Blender")
        seen = blender_view(one.pose, view_depths(one.pose, mesh), is_gltf)
        paths = _paths(out, asked.photo) if asked.photo else "[]"
        others.append((photo_name(one) or "another photo", seen, paths))
    if frame := set_frame(record):
        turn = as_4x4(BLENDER_FROM_GLTF) if is_gltf else np.eye(4)
        world_from_set = turn @ np.linalg.inv(frame.set_from_model)
        view["set"] = {"file": frame.name, "world_from_set": world_from_set.tolist()}
    return _write_script([(model, np.eye(4))], world, view, out, request, others)


def write_blender_scene(scene: SceneRecord, out: Path, request: ConvertOptions) -> Written:
    """Write a script with all objects of a scene; its world is the camera's frame, turned from y
    up to z up.
    """
    refuse_lens(scene.objects[0].record, "Blender")
    for one in scene.objects:
        _require_imported(one.model)
    _, matrices, span = before_camera(scene)
    upright = as_4x4(BLENDER_FROM_GLTF @ OPENGL_FROM_OPENCV)
    models = []
    for one, place in zip(scene.objects, matrices, strict=True):
        is_gltf = one.model.suffix.lower() in GLTF_ENDINGS  # whose axes the importer has turned
        turned_back = as_4x4(BLENDER_FROM_GLTF.inverse()) if is_gltf else np.eye(4)
        models.append((one.model, upright @ place @ turned_back))
    view = blender_view(Pose(scene.camera, OPENGL_FROM_OPENCV.inverse()), span, is_gltf=True)
    photo = replace(request, photo=request.photo or scene.photo)
    world = "the camera's frame, turned from y up to z up"
    return _write_script(models, world, view, out, photo)


def _require_imported(model: Path) -> None:
    if model.suffix.lower() not in IMPORTED:
        raise PoseFileError(
            f"{model.name}: Blender does not import {model.suffix} files; convert the pose "
            "to gltf, which holds the model, and open that."
        )


def _write_script(
    models: Sequence[tuple[Path, FloatArray]],
    world: str,
    view: dict[str, Any],
    out: Path,
    request: ConvertOptions,
    others: Sequence[tuple[str, dict[str, Any], str]] = (),
) -> Written:
    """Write models, each with the matrix (4, 4) that moves what Blender imports, and what ``view``
    says of the camera; ``others``: names and views of the other photos of a set, and where they
    lie.
    """
    if out.suffix.lower() != ".py":
        raise PoseFileError(f"{out.name}: Blender's scripts end in .py; name it so.")
    photo = request.photo
    listed = [f"    ({_paths(out, path)}, {place.tolist()}),\n" for path, place in models]
    more = [f"    ({name!r}, {json.dumps(seen)}, {paths}),\n" for name, seen, paths in others]
    script = (
        DOC.format(name=out.name, world=world)
        + f"MODELS = [\n{''.join(listed)}]\n"
        + f"PHOTO = {_paths(out, photo) if photo else '[]'}\n"
        + f"VIEW = {json.dumps(view, indent=4)}\n"
        + f"OTHERS = [\n{''.join(more)}]\n\n"
        + files("poseviewer.files.formats").joinpath("blender_scene.txt").read_text("utf-8")
    )
    notes = () if photo else ("No photo is known: there is no background; add --photo FILE.",)
    return write_new(request, {out: script}, *notes)


def _paths(out: Path, path: Path) -> str:
    """Where a file is: from the script's folder, and in full, as a list in Python."""
    return json.dumps([_from_folder(out, path), str(path.resolve())], ensure_ascii=False)


def blender_view(pose: Pose, depths: tuple[float, float], is_gltf: bool = False) -> dict[str, Any]:
    """Blender's numbers for the camera; unit of both shifts: the photo's width. ``is_gltf``: the
    world is one with y up, as in glTF, and is turned as Blender's importer turns that.
    """
    camera, (near, far) = pose.camera, depths
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


MESHLAB = Format(write_meshlab, read_meshlab)
BLENDER = Format(write_blender, None, parallel=True)
