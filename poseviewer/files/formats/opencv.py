"""OpenCV's camera matrix, rotation vector and translation, in the files of ``cv2.FileStorage``, by
the names of OpenCV's own calibration sample. Rows first; pixel centres are at integers.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.camera_forms import cameras_in, load_tree
from poseviewer.files.checks import Reading, checked_rotation
from poseviewer.files.formats.conversion import (
    ConvertOptions,
    Format,
    Lenses,
    cameras_as_taken,
)
from poseviewer.files.scene_file import SceneRecord, ViewRecord
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.lens import Undistortion, opencv_matrix
from poseviewer.geometry.transform import RigidTransform

ENDINGS = (".yml", ".yaml", ".json")
FISHEYE = "OpenCV fisheye"
LENSES: Lenses = (
    *(("OpenCV", "opencv", count) for count in (5, 8, 12, 14)),
    (FISHEYE, "fisheye", 4),
)


def write_opencv(scene: SceneRecord, out: Path, *_: object) -> dict[Path, str]:
    """Write YAML or JSON, by the ending."""
    transform, camera, lens, k = next(cameras_as_taken(scene, "OpenCV", LENSES))[1:]
    ending = out.suffix.lower()
    if ending not in ENDINGS:
        raise PoseFileError(f"{out.name}: OpenCV files end in {', '.join(ENDINGS)}; name one so.")
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


def read_opencv(path: Path, request: ConvertOptions) -> SceneRecord:
    """Read ``camera_matrix`` or ``K``, ``rvec`` or ``R``, ``tvec`` or ``t``; JSON lists as well."""
    reading = Reading(path, numbers_as_text=True)
    data = reading.object(load_tree(reading), "its content")
    known = cameras_in(reading, data)[0]
    rotation = _numbers(reading, data, ("rvec", "R"), (3, 9))
    translation = _numbers(reading, data, ("tvec", "t"), (3,))
    if len(rotation) == 3:
        rotation = Rotation.from_rotvec(rotation).as_matrix()
    matrix = rotation.reshape(3, 3)
    place = RigidTransform(checked_rotation(reading, matrix), translation)
    undistortion = known.lens and Undistortion.of(known.lens, known.camera)
    view = ViewRecord.of(Path(), known.camera, undistortion=undistortion, place=place)
    return request.scene_of(reading, view)


def _numbers(
    reading: Reading, data: dict[str, Any], names: tuple[str, str], sizes: tuple[int, ...]
) -> FloatArray:
    name = next((name for name in names if data.get(name) is not None), " or ".join(names))
    numbers = reading.flat_numbers(data.get(name), name)
    if len(numbers) not in sizes:
        raise reading.error(f"{name} has {len(numbers)} numbers", f"wanted {sizes[0]}")
    return np.array(numbers)


OPENCV = Format(write_opencv, read_opencv, lenses=LENSES, several_photos=False)
