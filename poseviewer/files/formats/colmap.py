"""COLMAP's text model: ``cameras.txt``, ``images.txt``, ``points3D.txt``; the world is the model.

https://colmap.github.io/format.html: quaternions w first, world to camera, OpenCV axes, pixel
centres at i + 0.5.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.cameras import colmap_camera
from poseviewer.files.checks import Reading
from poseviewer.files.formats.lens import colmap_lens, seen_as_taken
from poseviewer.files.formats.request import (
    Request,
    Written,
    make_folder,
    make_record,
    photo_name,
    refuse_lens,
    size_of,
    the_one,
    write_new,
)
from poseviewer.files.pose import PoseRecord
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform


def write_colmap(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a model of one camera and one image, without points, into the folder ``out``."""
    camera, lens = seen_as_taken(record, "COLMAP")
    found = colmap_lens(lens)
    if found is None:
        refuse_lens(record, "COLMAP")
    model, distortion = found or ("", ())
    transform = record.pose.camera_from_model
    quaternion = Rotation.from_matrix(transform.rotation).as_quat(scalar_first=True)
    place = " ".join(repr(float(x)) for x in (*quaternion, *transform.translation))
    numbers = " ".join(map(repr, (camera.fx, camera.fy, camera.cx, camera.cy, *distortion)))
    make_folder(out)
    texts = {
        "cameras.txt": "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[] (fx, fy, cx, cy, distortion)\n"
        f"1 {model} {camera.width} {camera.height} {numbers}\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
        "# POINTS2D[] as (X, Y, POINT3D_ID)\n"
        f"1 {place} 1 {photo_name(record) or 'photo'}\n\n",
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, "
        "POINT2D_IDX)\n",
    }
    return write_new(request, {out / name: text for name, text in texts.items()})


def read_colmap(path: Path, request: Request) -> PoseRecord:
    """Read one image of a text model: ``request.image`` by its name, or the only one.

    The model's world is taken for the frame of poseviewer's model.
    """
    reading = Reading(path / "images.txt")
    lines, images = _lines(reading.path), []
    for line in lines:
        if line:
            images.append(line.split())
            next(lines, None)  # its points
    names = [" ".join(words[9:]) for words in images]
    words = the_one(reading, request, "images", names, images)
    if len(words) < 10:
        raise reading.error(f"an image has {len(words)} entries", "wanted 10")
    numbers = reading.words(" ".join(words[1:8]), "the image's pose")
    quaternion = np.array(numbers[:4])
    if not 0.99 < float(np.linalg.norm(quaternion)) < 1.01:
        raise reading.error(f"the quaternion is {quaternion.tolist()}", "wanted one of length 1")
    rotation = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    place = RigidTransform(rotation, np.array(numbers[4:]))
    rows = map(str.split, _lines(path / "cameras.txt"))
    row = next((row for row in rows if row[:1] == [words[8]]), None)
    of_cameras = Reading(path / "cameras.txt", reading.warnings)
    if row is None:
        raise of_cameras.error(
            f"it has no camera {words[8]}", "wanted the one that the image names"
        )
    camera, lens = colmap_camera(of_cameras, row)
    size_of(of_cameras, request, camera.width, camera.height)
    return make_record(reading, Pose(camera, place), " ".join(words[9:]), request.unit, lens)


def _lines(path: Path) -> Iterator[str]:
    """The lines that are no comments, empty ones included: they stand for images without points."""
    try:
        with path.open(encoding="utf-8") as file:
            yield from (line.strip() for line in file if not line.startswith("#"))
    except FileNotFoundError:
        raise PoseFileError(
            f"{path}: no such file; name the folder of a COLMAP text model (colmap "
            "model_converter --output_type TXT makes one)."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise PoseFileError(f"{path}: cannot be read ({reason}).") from error
