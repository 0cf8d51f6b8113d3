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
from poseviewer.files.camera.colmap import MODELS
from poseviewer.files.formats.lens_models import colmap_lens, seen_as_taken
from poseviewer.files.formats.request import (
    Request,
    Written,
    lens_from,
    make_folder,
    make_record,
    no_such_lens,
    refuse_existing,
    size_of,
)
from poseviewer.files.pose.checks import Reading
from poseviewer.files.pose.file import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.lens import Lens
from poseviewer.geometry.transform import RigidTransform

FILES = ("cameras.txt", "images.txt", "points3D.txt")


def write_colmap(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a model of one camera and one image, without points, into the folder ``out``.

    Raises:
        PoseFileError: parallel projection, or a lens that COLMAP does not have; the folder holds a
            model already.
    """
    camera, lens = seen_as_taken(record, "COLMAP")
    model = colmap_lens(lens)
    if model is None:
        raise no_such_lens("COLMAP")
    paths = tuple(out / name for name in FILES)
    refuse_existing(request, *paths)
    make_folder(out)
    for path, text in zip(paths, _texts(record, camera, *model), strict=True):
        write_whole(path, text.encode(), PoseFileError)
    return Written(paths)


def _texts(
    record: PoseRecord, camera: Perspective, model: str, distortion: tuple[float, ...]
) -> tuple[str, str, str]:
    transform = record.pose.camera_from_model
    quaternion = Rotation.from_matrix(transform.rotation).as_quat(scalar_first=True)
    place = " ".join(repr(float(x)) for x in (*quaternion, *transform.translation))
    lens = " ".join(map(repr, (camera.fx, camera.fy, camera.cx, camera.cy, *distortion)))
    name = (record.photo.file if record.photo else None) or "photo"
    return (
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[] (fx, fy, cx, cy, distortion)\n"
        f"1 {model} {camera.width} {camera.height} {lens}\n",
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
        "# POINTS2D[] as (X, Y, POINT3D_ID)\n"
        f"1 {place} 1 {name}\n\n",
        "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n",
    )


def read_colmap(path: Path, request: Request) -> PoseRecord:
    """Read one image of a text model: ``request.image`` by its name, or the only one.

    The model's world is taken for the frame of poseviewer's model.

    Raises:
        PoseFileError: there is no such image, or its camera's model is not one of OpenCV's.
    """
    reading = Reading("images.txt", [])
    words = _chosen_image(reading, path / "images.txt", request)
    numbers = _floats(reading, words[1:8], "the image's pose")
    quaternion = np.array(numbers[:4])
    if not 0.99 < float(np.linalg.norm(quaternion)) < 1.01:
        raise reading.error(f"the quaternion is {quaternion.tolist()}", "wanted one of length 1")
    rotation = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    place = RigidTransform(rotation, np.array(numbers[4:]))
    camera, lens = _camera(Reading("cameras.txt", []), path / "cameras.txt", words[8], request)
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


def _chosen_image(reading: Reading, path: Path, request: Request) -> list[str]:
    """The words of an image's first line: ID, quaternion, translation, camera, name."""
    images = []
    lines = _lines(path)
    for line in lines:
        if line:
            images.append(line.split())
            next(lines, None)  # its points
    chosen = [words for words in images if request.image in (None, " ".join(words[9:]))]
    if len(chosen) != 1:
        raise reading.error(
            f"{len(chosen)} of its {len(images)} images are "
            + (repr(request.image) if request.image else "meant"),
            "wanted one, choose it with --image NAME",
        )
    if len(chosen[0]) < 10:
        raise reading.error(f"an image has {len(chosen[0])} entries", "wanted 10")
    return chosen[0]


def _camera(
    reading: Reading, path: Path, wanted: str, request: Request
) -> tuple[Perspective, Lens | None]:
    words = next((line.split() for line in _lines(path) if line.split()[:1] == [wanted]), None)
    if words is None or len(words) < 4:
        raise reading.error(f"it has no camera {wanted}", "wanted the one that the image names")
    kind = words[1]
    if kind not in MODELS:
        raise reading.error(
            f"camera {wanted} is of the model {kind}",
            f"wanted one of {', '.join(MODELS)}, or undistort the images first (colmap "
            "image_undistorter)",
        )
    sizes = [int(word) if word.isdecimal() else 0 for word in words[2:4]]
    found = (reading.size(sizes[0], "the width"), reading.size(sizes[1], "the height"))
    width, height = size_of(reading, request, found)
    focals, more, model, coefficients = MODELS[kind]
    numbers = _floats(reading, words[4:], f"camera {wanted}")
    if len(numbers) != focals + 2 + more:
        raise reading.error(
            f"camera {wanted} has {len(numbers)} numbers", f"wanted {focals + 2 + more}"
        )
    fx, fy = (reading.number(numbers[i], "the focal length", True) for i in (0, focals - 1))
    cx, cy = numbers[focals : focals + 2]
    found = coefficients(numbers[focals + 2 :]) if more else []
    return Perspective(fx, fy, cx, cy, width, height), lens_from(reading, model, found)


def _floats(reading: Reading, words: list[str], what: str) -> list[float]:
    try:
        return [reading.number(float(word), what) for word in words]
    except ValueError:
        raise reading.error(f"{what} is {' '.join(words)[:60]!r}", "wanted numbers") from None
