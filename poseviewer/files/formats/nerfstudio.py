"""nerfstudio's ``transforms.json``: camera to world, OpenGL axes, pixel centres at i + 0.5.

https://docs.nerf.studio/quickstart/data_conventions.html; its ``Cameras.generate_rays`` looks
through the pixel (i, j) at ``((j + 0.5 - cx) / fl_x, -(i + 0.5 - cy) / fl_y, -1)``.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from poseviewer.files.cameras import lens_of
from poseviewer.files.checks import Reading
from poseviewer.files.formats.lens import nerfstudio_lens, seen_as_taken
from poseviewer.files.formats.matrices import as_4x4, from_4x4
from poseviewer.files.formats.request import (
    Request,
    Written,
    json_text,
    make_record,
    photo_name,
    refuse_lens,
    size_of,
    the_one,
    write_new,
)
from poseviewer.files.pose import PoseRecord
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.lens import Lens

DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
FISHEYE = "OPENCV_FISHEYE"


def write_nerfstudio(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a file of one frame; the world is the model's frame."""
    camera, seen_through = seen_as_taken(record, "nerfstudio")
    found = nerfstudio_lens(seen_through)
    if found is None:
        refuse_lens(record, "nerfstudio")
    model, distortion = found or ("", {})
    name = photo_name(record) or "photo"
    if request.photo is not None:
        name = Path(os.path.relpath(request.photo, out.parent)).as_posix()
    world_from_camera = (OPENGL_FROM_OPENCV @ record.pose.camera_from_model).inverse()
    lens = {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
    data = {
        "camera_model": model,
        "w": camera.width,
        "h": camera.height,
        **{key: float(value) for key, value in lens.items()},
        **distortion,
        "frames": [{"file_path": name, "transform_matrix": as_4x4(world_from_camera).tolist()}],
    }
    return write_new(request, {out: json_text(data)})


def read_nerfstudio(path: Path, request: Request) -> PoseRecord:
    """Read one frame: ``request.image`` by its path or file name, or the only one."""
    reading = Reading(path)
    data = reading.load_object()
    frames = data.get("frames")
    frames = [reading.object(f, "a frame") for f in (frames if isinstance(frames, list) else [])]
    paths = [str(frame.get("file_path")) for frame in frames]
    frame = the_one(reading, request, "frames", paths, [Path(name).name for name in paths], frames)
    own = data | frame  # a frame's own lens comes first
    width, height = size_of(reading, request, own.get("w"), own.get("h"))
    fx = reading.positive(own.get("fl_x"), "fl_x")
    fy = reading.positive(own.get("fl_y", fx), "fl_y")
    cx, cy = (reading.number(own.get(name), name) for name in ("cx", "cy"))
    camera, lens = Perspective(fx, fy, cx, cy, width, height), _lens(reading, own)
    world_from_camera = from_4x4(reading, frame.get("transform_matrix"), "transform_matrix")
    place = OPENGL_FROM_OPENCV @ world_from_camera.inverse()
    name = Path(reading.text(frame.get("file_path"), "file_path") or "photo").name
    return make_record(reading, Pose(camera, place), name, request.unit, lens)


def _lens(reading: Reading, data: dict[str, Any]) -> Lens | None:
    model = data.get("camera_model", "OPENCV")
    if model not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", FISHEYE):
        raise reading.error(f"camera_model is {model!r}", f"wanted 'OPENCV' or {FISHEYE!r}")
    k1, k2, k3, k4, p1, p2 = (reading.number(data.get(name, 0.0), name) for name in DISTORTION)
    if model == FISHEYE:
        return lens_of(reading, "fisheye", [k1, k2, k3, k4])
    if k4:
        raise reading.error(f"k4 is {k4}", "OpenCV's lens model has no such term: wanted 0")
    return lens_of(reading, "opencv", [k1, k2, p1, p2, k3])
