"""Poses of one model as matrices and quaternions alone.

``matrix``: the 4x4 matrix camera from model, row-major, as text, JSON or ``.npy``: what
FoundationPose, SAM-6D and most scripts print. It says no camera, which a file of one has to.

``dope``: DOPE's and NDDS's JSON (https://github.com/NVlabs/Deep_Object_Pose): cm, OpenCV axes,
quaternions x y z w, pixel centres at integers.
"""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.camera_forms import cameras_in, load_tree, matrix_text
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.files.checks import Reading, rotation_of
from poseviewer.files.formats.conversion import (
    Contents,
    ConvertOptions,
    Format,
    from_4x4,
    metres_per_unit,
    perspective_of,
)
from poseviewer.files.formats.opencv import LENSES
from poseviewer.files.scene_file import ModelFile, ObjectRecord, Place, SceneRecord, ViewRecord
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV, camera_as_integer_centres
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.transform import RigidTransform, Similarity

ENDINGS = (".txt", ".npy", ".json")
UNIT = "cm"
"""DOPE's."""


def write_matrix(scene: SceneRecord, out: Path, options: ConvertOptions, *_: object) -> Contents:
    """Write the matrix camera from model in the form of the file's ending."""
    perspective_of(scene.views[0].camera, "matrix")
    place = scene.pose(0).camera_from_model
    rows = Similarity(OPENGL_FROM_OPENCV @ place if options.opengl else place).matrix
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


def read_matrix(path: Path, request: ConvertOptions) -> SceneRecord:
    """Read 4 rows of 4 numbers (or 3), and the camera in the file ``request.calibration``."""
    reading = Reading(path, numbers_as_text=True, kind="4x4 matrix")
    match path.suffix.lower():
        case ".npy":
            values = load_tree(reading)["camera_matrix"]
        case ".json":
            values = reading.load_json()
        case _:
            values = matrix_text(reading)
    place = from_4x4(reading, values, "the matrix")
    place = OPENGL_FROM_OPENCV @ place if request.opengl else place
    return request.scene_of(reading, _calibrated(reading, request, place))


def _calibrated(
    reading: Reading, request: ConvertOptions, place: RigidTransform | None = None
) -> ViewRecord:
    if request.calibration is None:
        wanted = "add --calibration FILE, and --photo or --photo-size"
        raise reading.error("it does not say the camera", wanted)
    size, photo = request.size_of(reading, None, None, request.photo), request.photo or Path()
    known, notes = load_calibration(Calibration(request.calibration), photo.name, *size)
    reading.warnings.extend(notes)
    undistortion = known.lens and Undistortion.of(known.lens, known.camera)
    return ViewRecord.of(photo, known.camera, undistortion=undistortion, place=place)


def write_dope(scene: SceneRecord, out: Path, options: ConvertOptions, *_: object) -> Contents:
    """Write camera and objects of one photo."""
    camera = perspective_of(scene.views[0].camera, "DOPE")
    shifted, objects = camera_as_integer_centres(camera), []
    factor = options.lengths_in(UNIT, scene, "DOPE")
    for index, item in enumerate(scene.objects):
        place = scene.pose(index).camera_from_model
        quaternion = Rotation.from_matrix(place.rotation).as_quat()
        objects.append(
            {
                "class": item.label,
                "location": (place.translation * factor).tolist(),
                "quaternion_xyzw": quaternion.tolist(),
            }
        )
    numbers = {name: float(getattr(shifted, name)) for name in ("fx", "fy", "cx", "cy")}
    size = {"width": camera.width, "height": camera.height}
    data = {"camera_data": {**size, "intrinsics": numbers}, "objects": objects}
    return {out: json.dumps(data, indent=2) + "\n"}


def read_dope(path: Path, request: ConvertOptions) -> SceneRecord:
    """Read all objects of a photo, or those of the class ``request.image``."""
    reading, objects = Reading(path, kind="DOPE file"), []
    data, unit = reading.load_object(), request.unit or UNIT
    if data.get("camera_data"):
        known = cameras_in(reading, data["camera_data"])[0]
        view = request.sized(reading, ViewRecord.of(request.photo or Path(), known.camera))
    else:
        view = _calibrated(reading, request)
    factor = metres_per_unit(UNIT) / metres_per_unit(unit)
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


MATRIX = Format(write_matrix, read_matrix, lenses=LENSES, several_photos=False)
DOPE = Format(write_dope, read_dope, several_photos=False, several_objects=True)
