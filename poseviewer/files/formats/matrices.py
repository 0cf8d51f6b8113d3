"""Poses of one model as matrices, vectors and quaternions alone; pixel centres are at integers.

``opencv``: camera matrix, rotation vector and translation in the files of ``cv2.FileStorage``, by
the names of OpenCV's own calibration sample; rows first.

``matrix``: the 4x4 matrix camera from model, row-major, as text, JSON or ``.npy``: what
FoundationPose, SAM-6D and most scripts print. It says no camera, which a file of one has to.

``dope``: DOPE's and NDDS's JSON (https://github.com/NVlabs/Deep_Object_Pose): cm, OpenCV axes,
quaternions x y z w.
"""

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.camera_forms import cameras_in, load_tree, matrix_text
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.files.checks import Reading, checked_rotation, rotation_of
from poseviewer.files.formats import conversion as c
from poseviewer.files.scene_json import ModelFile, ObjectRecord, Place, SceneRecord, ViewRecord
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV, camera_as_integer_centres
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.geometry.transform import RigidTransform

ENDINGS, STORAGES = (".txt", ".npy", ".json"), (".yml", ".yaml", ".json")
"""Endings of matrices' and of OpenCV's files."""
FISHEYE = "OpenCV fisheye"
LENSES: c.Lenses = (*(("OpenCV", "opencv", n) for n in (5, 8, 12, 14)), (FISHEYE, "fisheye", 4))
UNIT = "cm"
"""DOPE's."""


def write_opencv(scene: SceneRecord, out: Path, *_: object) -> dict[Path, str]:
    """Write YAML or JSON, by the ending."""
    transform, camera, lens, k = next(c.cameras_as_taken(scene, "OpenCV", LENSES))[1:]
    ending = out.suffix.lower()
    if ending not in STORAGES:
        raise PoseFileError(f"{out.name}: OpenCV files end in {', '.join(STORAGES)}; name one so.")
    storage = cv2.FileStorage(f"m{ending}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", opencv_matrix(camera))
    storage.write("distortion_coefficients", np.reshape(k, (-1, 1)))
    if lens == FISHEYE:
        storage.write("fisheye_model", 1)  # as OpenCV's calibration sample says it
    storage.write("rvec", transform.as_rotation_vector().reshape(3, 1))
    storage.write("tvec", np.array(transform.translation).reshape(3, 1))
    return {out: storage.releaseAndGetString()}


def read_opencv(path: Path, request: c.ConvertOptions) -> SceneRecord:
    """Read ``camera_matrix`` or ``K``, ``rvec`` or ``R``, ``tvec`` or ``t``; JSON lists as well."""
    reading = Reading(path, numbers_as_text=True)
    data = reading.object(load_tree(reading), "its content")
    known = cameras_in(reading, data)[0]
    rotation = reading.flat_numbers(data.get("rvec") or data.get("R"), "rvec or R")
    translation = reading.flat_numbers(data.get("tvec") or data.get("t"), "tvec or t", 3)
    if len(rotation) not in (3, 9):
        raise reading.error(f"rvec or R has {len(rotation)} numbers", "wanted 3, or 9 of a matrix")
    matrix = Rotation.from_rotvec(rotation).as_matrix() if len(rotation) == 3 else rotation
    rotation = checked_rotation(reading, np.reshape(matrix, (3, 3)))
    place = RigidTransform(rotation, np.array(translation))
    return request.scene_of(reading, ViewRecord.of(Path(), known.camera, None, known.lens, place))


def write_matrix(scene: SceneRecord, out: Path, options: c.ConvertOptions, *_: Any) -> c.Contents:
    """Write the matrix camera from model in the form of the file's ending."""
    c.perspective_of(scene.views[0].camera, "matrix")
    place = scene.pose(0).camera_from_model
    rows = (OPENGL_FROM_OPENCV @ place if options.opengl else place).as_matrix()
    match out.suffix.lower():
        case ".npy":
            memory = BytesIO()
            np.save(memory, rows)
            return {out: memory.getvalue()}
        case ".json":
            return {out: json.dumps(rows.tolist()) + "\n"}
        case ".txt":
            return {out: "".join(" ".join(map(repr, r)) + "\n" for r in rows.tolist())}
    raise PoseFileError(f"{out.name}: matrix files end in {', '.join(ENDINGS)}; name it so.")


def read_matrix(path: Path, request: c.ConvertOptions) -> SceneRecord:
    """Read 4 rows of 4 numbers (or 3), and the camera in the file ``request.calibration``."""
    reading = Reading(path, numbers_as_text=True, kind="4x4 matrix")
    match path.suffix.lower():
        case ".npy":
            values = load_tree(reading)["camera_matrix"]
        case ".json":
            values = reading.load_json()
        case _:
            values = matrix_text(reading)
    place = c.from_4x4(reading, values, "the matrix")
    place = OPENGL_FROM_OPENCV @ place if request.opengl else place
    return request.scene_of(reading, _calibrated(reading, request, place))


def _calibrated(
    reading: Reading, request: c.ConvertOptions, place: RigidTransform | None = None
) -> ViewRecord:
    if request.calibration is None:
        wanted = "add --calibration FILE, and --photo or --photo-size"
        raise reading.error("it does not say the camera", wanted)
    size, photo = request.size_of(reading, None, None, request.photo), request.photo or Path()
    known, notes = load_calibration(Calibration(request.calibration), photo.name, *size)
    reading.warnings.extend(notes)
    return ViewRecord.of(photo, known.camera, None, known.lens, place)


def write_dope(scene: SceneRecord, out: Path, options: c.ConvertOptions, *_: Any) -> c.Contents:
    """Write camera and objects of one photo."""
    camera = c.perspective_of(scene.views[0].camera, "DOPE")
    shifted, objects = camera_as_integer_centres(camera), []
    factor = options.lengths_in(UNIT, scene, "DOPE")
    for index, item in enumerate(scene.objects):
        place = scene.pose(index).camera_from_model
        quaternion = np.roll(place.as_quaternion(), -1).tolist()
        place = {"location": (place.translation * factor).tolist(), "quaternion_xyzw": quaternion}
        objects.append({"class": item.label, **place})
    numbers = {name: float(getattr(shifted, name)) for name in ("fx", "fy", "cx", "cy")}
    size = {"width": camera.width, "height": camera.height}
    data = {"camera_data": {**size, "intrinsics": numbers}, "objects": objects}
    return {out: json.dumps(data, indent=2) + "\n"}


def read_dope(path: Path, request: c.ConvertOptions) -> SceneRecord:
    """Read all objects of a photo, or those of the class ``request.image``."""
    reading, objects = Reading(path, kind="DOPE file"), []
    data, unit = reading.load_object(), request.unit or UNIT
    if data.get("camera_data"):
        known = cameras_in(reading, data["camera_data"])[0]
        view = request.sized(reading, ViewRecord.of(request.photo or Path(), known.camera))
    else:
        view = _calibrated(reading, request)
    factor = c.metres_per_unit(UNIT) / c.metres_per_unit(unit)
    entries = data.get("objects")
    for number, entry in enumerate(entries if isinstance(entries, list) else [], 1):
        said, what = reading.object(entry, "an object"), f"objects[{number - 1}]"
        location = np.array(reading.flat_numbers(said.get("location"), f"{what}.location", 3))
        quaternion = reading.flat_numbers(said.get("quaternion_xyzw"), f"{what}.quaternion_xyzw", 4)
        rotation = rotation_of(reading, quaternion, f"{what}.quaternion_xyzw")
        place = Place.of(RigidTransform(rotation, location * factor))
        name = reading.text(said.get("class"), f"{what}.class") or ""
        if request.image in (None, name):
            model = ModelFile(str(request.model or Path()), unit=unit)
            objects.append(ObjectRecord(id=str(number), name=name, model=model, place=place))
    if not objects:
        raise reading.error(f"no pose of {request.image or 'an object'}", "wanted one in objects")
    return SceneRecord(views=(view,), objects=tuple(objects), warnings=tuple(reading.warnings))


OPENCV = c.Format(write_opencv, read_opencv, lenses=LENSES, several_photos=False)
MATRIX = c.Format(write_matrix, read_matrix, lenses=LENSES, several_photos=False)
DOPE = c.Format(write_dope, read_dope, several_photos=False, several_objects=True)
