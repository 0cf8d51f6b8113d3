"""nerfstudio's ``transforms.json``: camera to world, OpenGL axes, pixel centres at i + 0.5.

https://docs.nerf.studio/quickstart/data_conventions.html; its ``Cameras.generate_rays`` looks
through the pixel (i, j) at ``((j + 0.5 - cx) / fl_x, -(i + 0.5 - cy) / fl_y, -1)``.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.lens_models import nerfstudio_lens, seen_as_taken
from poseviewer.files.formats.matrix import as_4x4, from_4x4
from poseviewer.files.formats.request import (
    Request,
    Written,
    lens_from,
    make_record,
    no_such_lens,
    refuse_existing,
    size_of,
)
from poseviewer.files.pose.checks import Reading, read_json
from poseviewer.files.pose.file import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.lens import Lens

DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
FISHEYE = "OPENCV_FISHEYE"


def write_nerfstudio(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a file of one frame; the world is the model's frame.

    Raises:
        PoseFileError: parallel projection, or a lens that nerfstudio does not have; the file is
            there already.
    """
    camera, seen_through = seen_as_taken(record, "nerfstudio")
    model = nerfstudio_lens(seen_through)
    if model is None:
        raise no_such_lens("nerfstudio")
    refuse_existing(request, out)
    name = (record.photo.file if record.photo else None) or "photo"
    if request.photo is not None:
        name = Path(os.path.relpath(request.photo, out.parent)).as_posix()
    world_from_camera = (OPENGL_FROM_OPENCV @ record.pose.camera_from_model).inverse()
    frame = {"file_path": name, "transform_matrix": as_4x4(world_from_camera).tolist()}
    lens = {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
    data = {
        "camera_model": model[0],
        "w": camera.width,
        "h": camera.height,
        **{key: float(value) for key, value in lens.items()},
        **model[1],
        "frames": [frame],
    }
    write_whole(out, (json.dumps(data, indent=2) + "\n").encode(), PoseFileError)
    return Written((out,))


def read_nerfstudio(path: Path, request: Request) -> PoseRecord:
    """Read one frame: ``request.image`` by its path or file name, or the only one.

    Raises:
        PoseFileError: there is no such frame, or its lens is not one of OpenCV's.
    """
    reading = Reading(path.name, [])
    data = reading.object(read_json(path), "its content")
    frame = _chosen_frame(reading, data, request)
    own = data | frame  # a frame's own lens comes first
    camera, lens = _camera(reading, own, request), _lens(reading, own)
    world_from_camera = from_4x4(reading, frame.get("transform_matrix"), "transform_matrix")
    place = OPENGL_FROM_OPENCV @ world_from_camera.inverse()
    name = Path(reading.text(frame.get("file_path"), "file_path") or "photo").name
    return make_record(reading, Pose(camera, place), name, request.unit, lens)


def _chosen_frame(reading: Reading, data: dict[str, Any], request: Request) -> dict[str, Any]:
    frames = data.get("frames")
    frames = [reading.object(f, "a frame") for f in (frames if isinstance(frames, list) else [])]
    if request.image is None:
        chosen = frames
    else:
        paths = [str(frame.get("file_path")) for frame in frames]
        chosen = [
            frame
            for frame, name in zip(frames, paths, strict=True)
            if request.image in (name, Path(name).name)
        ]
    if len(chosen) != 1:
        raise reading.error(
            f"{len(chosen)} of its {len(frames)} frames are "
            + (repr(request.image) if request.image else "meant"),
            "wanted one, choose it with --image NAME",
        )
    return chosen[0]


def _camera(reading: Reading, data: dict[str, Any], request: Request) -> Perspective:
    found = (reading.size(data.get("w"), "w"), reading.size(data.get("h"), "h"))
    width, height = size_of(reading, request, found)
    fx = reading.number(data.get("fl_x"), "fl_x", positive=True)
    fy = reading.number(data.get("fl_y", fx), "fl_y", positive=True)
    cx, cy = (reading.number(data.get(name), name) for name in ("cx", "cy"))
    return Perspective(fx, fy, cx, cy, width, height)


def _lens(reading: Reading, data: dict[str, Any]) -> Lens | None:
    model = data.get("camera_model", "OPENCV")
    if model not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", FISHEYE):
        raise reading.error(f"camera_model is {model!r}", f"wanted 'OPENCV' or {FISHEYE!r}")
    k1, k2, k3, k4, p1, p2 = (reading.number(data.get(name, 0.0), name) for name in DISTORTION)
    if model == FISHEYE:
        return lens_from(reading, "fisheye", [k1, k2, k3, k4])
    if k4:
        raise reading.error(f"k4 is {k4}", "OpenCV's lens model has no such term: wanted 0")
    return lens_from(reading, "opencv", [k1, k2, p1, p2, k3])
