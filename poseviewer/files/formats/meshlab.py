"""MeshLab's project: model, camera and photo together, to be looked at.

The axes of ``RotationMatrix`` are OpenGL's, ``TranslationVector`` is minus the camera's position,
and ``CenterPx`` counts from the lower left corner, with pixel centres at i + 0.5.
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from poseviewer.files.checks import InputFile
from poseviewer.files.formats import conversion as c
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.scene_assets import view_of_file
from poseviewer.files.scene_json import relative_name
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV, camera_with_rows_from_below
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import Scene

SENSOR_MM = 36.0
"""Width of the sensor we claim: MeshLab wants mm, of which only ratios count."""


def write_meshlab(
    scene: Scene, out: Path, _: c.ConvertOptions, notes: list[str]
) -> dict[Path, str]:
    """Write a project that names models and photos by their paths from its folder.

    Args:
        scene: objects and views.
        out: project file.
        _: no option is used.
        notes: list for notes to the user.
    """
    c.require_file(scene.views[0].file.location, "photo", "MeshLab")
    places, poses = c.in_one_world(scene)
    add, root = ElementTree.SubElement, ElementTree.Element("MeshLabProject")
    group = add(root, "MeshGroup")
    for item, place in zip(scene.objects, places, strict=True):
        model = relative_name(out, c.require_file(item.model.location, "model", "MeshLab"))
        mesh = {"label": item.label, "visible": "1", "filename": model}
        matrix = add(add(group, "MLMesh", mesh), "MLMatrix44")
        matrix.text = "\n" + "".join(f"{_words(row)} \n" for row in place)
    rasters = add(root, "RasterGroup")
    for view, pose in zip(scene.views, poses, strict=True):
        if not view.file.location.is_file():
            notes.append(f"{view.file.location.name} is not there, and is left out.")
            continue
        raster = add(rasters, "MLRaster", {"label": view.file.location.name})
        add(raster, "VCGCamera", _shot(pose))
        add(raster, "Plane", {"semantic": "1", "fileName": relative_name(out, view.file.location)})
    ElementTree.indent(root, " ")
    text = "<!DOCTYPE MeshLabDocument>\n" + ElementTree.tostring(root, encoding="unicode") + "\n"
    return {out: text}


def _shot(pose: Pose) -> dict[str, str]:
    camera = camera_with_rows_from_below(c.perspective_of(pose.camera, "MeshLab"))
    place = OPENGL_FROM_OPENCV @ pose.camera_from_model
    rotation = RigidTransform(place.rotation, np.zeros(3))
    pixel_mm = SENSOR_MM / camera.width
    focal_mm = camera.fx * pixel_mm
    return {
        "TranslationVector": _words((*-place.inverse().translation, 1.0)),
        "LensDistortion": "0 0", "ViewportPx": f"{camera.width} {camera.height}",
        "PixelSizeMm": _words((pixel_mm, focal_mm / camera.fy)),
        "CenterPx": _words((camera.cx, camera.cy)), "FocalMm": repr(float(focal_mm)),
        "RotationMatrix": _words(rotation.as_matrix().reshape(-1)), "CameraType": "0",
        "BinaryData": "0",
    }  # fmt: skip


def _words(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def read_meshlab(path: Path, request: c.ConvertOptions) -> Scene:
    """Read raster ``request.image``, or the only one; the world is the model's frame."""
    file = InputFile(path, kind="MeshLab project (.mlp)")
    with file.naming_errors():
        root = ElementTree.fromstring(file.load_bytes())  # expat refuses bombs of entities
    for matrix in root.iter("MLMatrix44"):
        numbers = file.flat_numbers(matrix.text or "", "MLMatrix44")
        if numbers and not np.array_equal(np.round(numbers, 12), np.eye(4).ravel()):
            wanted = "freeze that matrix in MeshLab (Matrix: Freeze Current Matrix)"
            raise file.error("the project moves its mesh (MLMatrix44)", wanted)
    known = [(raster.get("label") or "", raster) for raster in root.iter("MLRaster")]
    raster = request.the_one(file, "rasters", known)
    shot = raster.find("VCGCamera")
    if shot is None:
        raise file.error("the raster has no VCGCamera", "wanted a raster with its camera")

    def numbers_of(name: str, count: int) -> list[float]:
        return file.flat_numbers(shot.get(name, ""), name, count)

    if shot.get("CameraType", "0") != "0" or any(numbers_of("LensDistortion", 2)):
        found = "its camera has distortion or is not in perspective"
        raise file.error(found, "wanted a pinhole camera")
    width, height = (file.size(side, "ViewportPx") or 0 for side in numbers_of("ViewportPx", 2))
    focal_mm = file.positive(numbers_of("FocalMm", 1)[0], "FocalMm")
    sides_mm = numbers_of("PixelSizeMm", 2)
    fx, fy = (focal_mm / file.positive(side, "PixelSizeMm") for side in sides_mm)
    cx, cy = numbers_of("CenterPx", 2)
    camera = Perspective(fx, fy, cx, cy, width, height)
    rotation = c.from_4x4(file, shot.get("RotationMatrix", ""), "RotationMatrix").rotation
    translation = rotation @ np.array(numbers_of("TranslationVector", 4)[:3])
    place = OPENGL_FROM_OPENCV @ RigidTransform(rotation, translation)
    photo = path.with_name(bare_name(raster.get("label") or "photo"))
    view = view_of_file(photo, camera_with_rows_from_below(camera), camera_from_world=place)
    return request.scene_of(file, view)


MESHLAB = c.Format(write_meshlab, read_meshlab, ".mlp", several_objects=True)
