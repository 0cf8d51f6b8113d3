"""MeshLab's project: the model, and the photo as a raster with its camera.

The VCG library's ``Shot``: the axes of the rows of ``RotationMatrix`` are OpenGL's,
``TranslationVector`` is minus the camera's place, and ``CenterPx`` counts from the lower left
corner of the picture, with pixel centres at i + 0.5.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.matrix import as_4x4, from_4x4
from poseviewer.files.formats.request import (
    Request,
    Written,
    make_record,
    refuse_existing,
    refuse_lens,
    require_file,
    require_perspective,
    size_of,
)
from poseviewer.files.pose.checks import LARGEST_FILE, Reading
from poseviewer.files.pose.file import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV, camera_with_rows_from_below
from poseviewer.geometry.transform import RigidTransform

SENSOR_MM = 36.0
"""Width of the sensor we claim; MeshLab wants mm, and only their ratio to px counts."""


def write_meshlab(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a project that names model and photo by their paths from its folder.

    Raises:
        PoseFileError: parallel projection; photo or model is not known; the file is there already.
    """
    refuse_lens(record, "MeshLab")
    camera = camera_with_rows_from_below(require_perspective(record, "MeshLab"))
    model = require_file(request.model, "model", "MeshLab")
    photo = require_file(request.photo, "photo", "MeshLab")
    refuse_existing(request, out)
    root = ElementTree.Element("MeshLabProject")
    mesh = _child(_child(root, "MeshGroup"), "MLMesh", label=model.name, visible="1")
    mesh.set("filename", _path_from(out, model))
    matrix = _child(mesh, "MLMatrix44")
    matrix.text = "\n" + "".join(f"{_words(row)} \n" for row in np.eye(4))
    raster = _child(_child(root, "RasterGroup"), "MLRaster", label=photo.name)
    _child(raster, "VCGCamera", **_attributes(camera, record.pose.camera_from_model))
    _child(raster, "Plane", semantic="1", fileName=_path_from(out, photo))
    ElementTree.indent(root, " ")
    text = "<!DOCTYPE MeshLabDocument>\n" + ElementTree.tostring(root, encoding="unicode") + "\n"
    write_whole(out, text.encode(), PoseFileError)
    return Written((out,))


def _child(parent: ElementTree.Element, name: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, name, attributes)


def _path_from(out: Path, path: Path) -> str:
    return Path(os.path.relpath(path, out.parent)).as_posix()


def _attributes(camera: Perspective, camera_from_model: RigidTransform) -> dict[str, str]:
    place = OPENGL_FROM_OPENCV @ camera_from_model
    rotation = RigidTransform(place.rotation, np.zeros(3))
    pixel_mm = SENSOR_MM / camera.width
    focal_mm = camera.fx * pixel_mm
    return {
        "TranslationVector": _words((*-place.inverse().translation, 1.0)),
        "LensDistortion": "0 0",
        "ViewportPx": f"{camera.width} {camera.height}",
        "PixelSizeMm": _words((pixel_mm, focal_mm / camera.fy)),
        "CenterPx": _words((camera.cx, camera.cy)),
        "FocalMm": repr(float(focal_mm)),
        "RotationMatrix": _words(as_4x4(rotation).reshape(-1)),
        "CameraType": "0",
        "BinaryData": "0",
    }


def _words(numbers: FloatArray | tuple[float, ...]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def read_meshlab(path: Path, request: Request) -> PoseRecord:
    """Read one raster: ``request.image`` by its label, or the only one.

    The project's world is taken for the model's frame; a mesh that the project moves is refused.

    Raises:
        PoseFileError: there is no such raster, or its camera is no pinhole.
    """
    reading = Reading(path.name, [])
    root = _load_xml(reading, path)
    _refuse_moved_meshes(reading, root)
    raster = _chosen_raster(reading, root, request)
    shot = raster.find("VCGCamera")
    if shot is None:
        raise reading.error("the raster has no VCGCamera", "wanted a raster with its camera")
    if shot.get("CameraType", "0") != "0" or any(_numbers(reading, shot, "LensDistortion", 2)):
        raise reading.error(
            "its camera has distortion or is not in perspective", "wanted a pinhole camera"
        )
    camera = camera_with_rows_from_below(_camera(reading, shot, request))
    rows = np.reshape(_numbers(reading, shot, "RotationMatrix", 16), (4, 4)).tolist()
    rotation = from_4x4(reading, rows, "RotationMatrix").rotation
    translation = rotation @ np.array(_numbers(reading, shot, "TranslationVector", 4)[:3])
    place = OPENGL_FROM_OPENCV @ RigidTransform(rotation, translation)
    return make_record(reading, Pose(camera, place), raster.get("label"), request.unit)


def _load_xml(reading: Reading, path: Path) -> ElementTree.Element:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise reading.error("it is larger than any project", "wanted a MeshLab project")
        return ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise reading.error(f"cannot be read ({error.strerror})", "check the path") from error
    except ElementTree.ParseError as error:
        raise reading.error(f"not XML ({error})", "wanted a MeshLab project (.mlp)") from error


def _refuse_moved_meshes(reading: Reading, root: ElementTree.Element) -> None:
    for matrix in root.iter("MLMatrix44"):
        if (matrix.text or "").strip():
            numbers = _split(reading, matrix.text or "", "MLMatrix44", 16)
            if not np.allclose(numbers, np.eye(4).reshape(-1), rtol=0.0, atol=1e-12):
                raise reading.error(
                    "the project moves its mesh (MLMatrix44)",
                    "freeze that matrix in MeshLab (Matrix: Freeze Current Matrix)",
                )


def _chosen_raster(
    reading: Reading, root: ElementTree.Element, request: Request
) -> ElementTree.Element:
    rasters = list(root.iter("MLRaster"))
    chosen = [raster for raster in rasters if request.image in (None, raster.get("label"))]
    if len(chosen) != 1:
        raise reading.error(
            f"{len(chosen)} of its {len(rasters)} rasters are "
            + (repr(request.image) if request.image else "meant"),
            "wanted one, choose it with --image LABEL",
        )
    return chosen[0]


def _camera(reading: Reading, shot: ElementTree.Element, request: Request) -> Perspective:
    """The camera with cy as MeshLab counts it."""
    sides = [int(side) for side in _numbers(reading, shot, "ViewportPx", 2)]
    found = (reading.size(sides[0], "ViewportPx"), reading.size(sides[1], "ViewportPx"))
    width, height = size_of(reading, request, found)
    focal_mm = _numbers(reading, shot, "FocalMm", 1)[0]
    pixel_x, pixel_y = _numbers(reading, shot, "PixelSizeMm", 2)
    if not min(focal_mm, pixel_x, pixel_y) > 0.0:
        raise reading.error("FocalMm or PixelSizeMm is not above 0", "wanted a camera")
    cx, cy = _numbers(reading, shot, "CenterPx", 2)
    return Perspective(focal_mm / pixel_x, focal_mm / pixel_y, cx, cy, width, height)


def _numbers(reading: Reading, shot: ElementTree.Element, name: str, count: int) -> list[float]:
    return _split(reading, shot.get(name, ""), name, count)


def _split(reading: Reading, text: str, name: str, count: int) -> list[float]:
    words = text.split()
    if len(words) != count:
        raise reading.error(f"{name} is {text.strip()[:60]!r}", f"wanted {count} numbers")
    try:
        return [reading.number(float(word), name) for word in words]
    except ValueError:
        raise reading.error(f"{name} is {text.strip()[:60]!r}", "wanted numbers") from None
