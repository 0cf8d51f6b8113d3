"""Poses of one model as matrices, vectors and quaternions; pixel centres are at integers.

``opencv``: the files of ``cv2.FileStorage``, by the names of OpenCV's calibration sample.
``matrix``: camera from model, row-major, as FoundationPose and SAM-6D print it; it says no camera.
``linemod``: ``rot0.rot`` and ``tra0.tra``, in cm; the text of Occlusion-LINEMOD (read alone), in m
with OpenGL's axes. They say no camera.
``dope``: JSON of https://github.com/NVlabs/Deep_Object_Pose: cm, OpenCV axes, quaternions x y z w.
"""

import json
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.camera_forms import cameras_in
from poseviewer.files.camera_trees import load_tree, matrix_text
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.files.checks import InputFile, repair_rotation, rotation_of
from poseviewer.files.formats import conversion as c
from poseviewer.files.photo import orientation_of
from poseviewer.files.scene_assets import model_file, view_of_file
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV, camera_as_integer_centres
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.geometry.world_pose import WORLD
from poseviewer.scene.types import Scene, SceneObject, View

ENDINGS = (".txt", ".npy", ".json")
OPENCV_ENDINGS = (".yml", ".yaml", ".json")
FISHEYE = "OpenCV fisheye"
LENSES: c.Lenses = (*(("OpenCV", "opencv", n) for n in (5, 8, 12, 14)), (FISHEYE, "fisheye", 4))
UNIT = "cm"
"""Length unit of DOPE's and LINEMOD's files."""
LINEMOD_ENDINGS = (".rot", ".tra")


def write_opencv(scene: Scene, out: Path, *_: object) -> dict[Path, str]:
    """Write YAML or JSON, by the ending."""
    transform, camera, lens, k = next(c.cameras_as_taken(scene, "OpenCV", LENSES))[1:]
    ending = out.suffix.lower()
    if ending not in OPENCV_ENDINGS:
        found = f"OpenCV files end in {', '.join(OPENCV_ENDINGS)}"
        raise PoseFileError(f"{out.name}: {found}; name one so.")
    storage = cv2.FileStorage(f"m{ending}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    if (note := c.focal_guess_note(scene)) and ending != ".json":  # JSON has no comments
        storage.writeComment(note)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", opencv_matrix(camera))
    storage.write("distortion_coefficients", np.reshape(k, (-1, 1)))
    if lens == FISHEYE:
        storage.write("fisheye_model", 1)  # as OpenCV's calibration sample says it
    storage.write("rvec", transform.as_rotation_vector().reshape(3, 1))
    storage.write("tvec", np.array(transform.translation).reshape(3, 1))
    return {out: storage.releaseAndGetString()}


def read_opencv(path: Path, request: c.ConvertOptions) -> Scene:
    """Read ``camera_matrix`` or ``K``, ``rvec`` or ``R``, ``tvec`` or ``t``; JSON lists as well."""
    file = InputFile(path, numbers_as_text=True)
    data = file.object(load_tree(file), "its content")
    known = cameras_in(file, data, request.lens_model)[0]
    rotation = file.flat_numbers(data.get("rvec") or data.get("R"), "rvec or R")
    translation = file.flat_numbers(data.get("tvec") or data.get("t"), "tvec or t", 3)
    if len(rotation) not in (3, 9):
        raise file.error(f"rvec or R has {len(rotation)} numbers", "wanted 3, or 9 of a matrix")
    matrix = Rotation.from_rotvec(rotation).as_matrix() if len(rotation) == 3 else rotation
    rotation = repair_rotation(file, np.reshape(matrix, (3, 3)))
    place = RigidTransform(rotation, np.array(translation))
    return request.scene_of(file, view_of_file(Path(), known.camera, None, known.lens, place))


def write_matrix(scene: Scene, out: Path, options: c.ConvertOptions, *_: Any) -> c.Contents:
    """Write the matrix camera from model in the form of the file's ending."""
    c.perspective_of(scene.views[0].camera, "matrix")
    place = scene.pose(0).camera_from_model
    place = OPENGL_FROM_OPENCV @ place if options.opengl else place
    rows = (place.inverse() if options.inverse else place).as_matrix()
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


def read_matrix(path: Path, request: c.ConvertOptions) -> Scene:
    """Read 4 rows of 4 numbers (or 3), and the camera in the file ``request.calibration``."""
    file = InputFile(path, numbers_as_text=True, kind="4x4 matrix")
    match path.suffix.lower():
        case ".npy":
            values = load_tree(file)["camera_matrix"]
        case ".json":
            values = file.load_json()
        case _:
            values = matrix_text(file)
    place = c.from_4x4(file, values, "the matrix")
    place = place.inverse() if request.inverse else place
    place = OPENGL_FROM_OPENCV @ place if request.opengl else place
    return request.scene_of(file, _read_calibration(file, request, place))


def write_linemod(scene: Scene, out: Path, options: c.ConvertOptions, *_: Any) -> c.Contents:
    """Write rotation and translation in a file each, whichever of them ``out`` is."""
    c.perspective_of(scene.views[0].camera, "LINEMOD")
    if out.suffix.lower() not in LINEMOD_ENDINGS:
        wanted = f"end in {', '.join(LINEMOD_ENDINGS)}; name one so, as rot0.rot"
        raise PoseFileError(f"{out.name}: LINEMOD's files {wanted}.")
    place, factor = scene.pose(0).camera_from_model, options.lengths_in(UNIT, scene, "LINEMOD")
    texts = []
    for part in (place.rotation, factor * place.translation[:, None]):
        rows = ([3, part.shape[1]], *part.tolist())
        texts.append("".join(" ".join(map(repr, row)) + "\n" for row in rows))
    return dict(zip(_linemod_files(out), texts, strict=True))


def _linemod_files(path: Path) -> list[Path]:
    name = re.sub("^(rot|tra)", "", path.stem)
    is_prefixed = name != path.stem
    return [path.with_name(f"{end[1:] * is_prefixed}{name}{end}") for end in LINEMOD_ENDINGS]


def read_linemod(path: Path, request: c.ConvertOptions) -> Scene:
    """Read LINEMOD's two files, or Occlusion-LINEMOD's one; the camera is that of a calibration."""
    file = InputFile(path, numbers_as_text=True, kind="pose of LINEMOD")
    if path.suffix.lower() in LINEMOD_ENDINGS:
        unit, both = UNIT, []
        for part, count in zip(_linemod_files(path), (9, 3), strict=True):
            numbers = matrix_text(replace(file, path=part)).split()
            both.append(numbers[2:] if len(numbers) == count + 2 else numbers)  # rows and columns
    else:
        unit, tree = "m", load_tree(file)
        both = [tree.get("rotation"), tree.get("center")]
        if not all(both):
            wanted = "wanted rotation: and center:, as of an object that the photo shows"
            raise file.error("no pose of Occlusion-LINEMOD", wanted)
    names = zip(both, ("rotation", "translation"), (9, 3), strict=True)
    rotation, shift = (np.array(file.flat_numbers(*said)) for said in names)
    factor = c.metres_per_unit(unit) / c.metres_per_unit(request.unit or unit)
    place = RigidTransform(repair_rotation(file, rotation.reshape(3, 3)), factor * shift)
    place = OPENGL_FROM_OPENCV @ place if unit == "m" else place
    return request.scene_of(file, _read_calibration(file, request, place), unit)


def _read_calibration(
    file: InputFile, request: c.ConvertOptions, place: RigidTransform = WORLD
) -> View:
    if request.calibration is None:
        wanted = "add `calibration`, and `photo` or `photo_size`"
        raise file.error("it does not say the camera", wanted)
    size, photo = request.size_of(file, (None, None), request.photo), request.photo or Path()
    choice = Calibration(request.calibration, lens_model=request.lens_model)
    known, notes = load_calibration(choice, photo.name, *size, orientation_of(photo))
    file.warnings.extend(notes)
    return view_of_file(photo, known.camera, None, known.lens, place)


def write_dope(scene: Scene, out: Path, options: c.ConvertOptions, *_: Any) -> c.Contents:
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


def read_dope(path: Path, request: c.ConvertOptions) -> Scene:
    """Read all objects of a photo, or those of the class ``request.image``."""
    file, objects = InputFile(path, kind="DOPE file"), []
    data, unit = file.load_object(), request.unit or UNIT
    if data.get("camera_data"):
        known = cameras_in(file, data["camera_data"])[0]
        view = request.with_size(file, view_of_file(request.photo or Path(), known.camera))
    else:
        view = _read_calibration(file, request)
    factor = c.metres_per_unit(UNIT) / c.metres_per_unit(unit)
    entries = data.get("objects")
    for number, entry in enumerate(entries if isinstance(entries, list) else [], 1):
        said, what = file.object(entry, "an object"), f"objects[{number - 1}]"
        location = np.array(file.flat_numbers(said.get("location"), f"{what}.location", 3))
        quaternion = file.flat_numbers(said.get("quaternion_xyzw"), f"{what}.quaternion_xyzw", 4)
        rotation = rotation_of(file, quaternion, f"{what}.quaternion_xyzw")
        place = Similarity(RigidTransform(rotation, location * factor))
        name = file.text(said.get("class"), f"{what}.class") or ""
        if request.image in (None, name):
            model = model_file(request.model or Path(), unit=unit)
            item = SceneObject(id=str(number), name=name, model=model, world_from_model=place)
            objects.append(item)
    if not objects:
        raise file.error(f"no pose of {request.image or 'an object'}", "wanted one in objects")
    return Scene(views=(view,), objects=tuple(objects), notes=tuple(file.warnings))


OPENCV = c.Format(write_opencv, read_opencv, ".yml", lenses=LENSES, several_photos=False)
MATRIX = c.Format(write_matrix, read_matrix, ".txt", lenses=LENSES, several_photos=False)
LINEMOD = c.Format(write_linemod, read_linemod, ".rot", lenses=LENSES, several_photos=False)
DOPE = c.Format(write_dope, read_dope, ".dope.json", several_photos=False, several_objects=True)
