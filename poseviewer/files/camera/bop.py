"""BOP's ``camera.json`` and ``scene_camera.json``: pinholes, pixel centres at integers.

https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

from typing import Any

from poseviewer.files.camera.file_camera import FileCamera, camera_of_matrix, number, numbers, size
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import camera_from_integer_centres


def is_bop(data: dict[str, Any]) -> bool:
    """Whether a JSON object is one of the two files."""
    return {"fx", "fy", "cx", "cy"} <= set(data) or _is_scene(data)


def bop_cameras(name: str, data: dict[str, Any]) -> list[FileCamera]:
    """The one camera of ``camera.json``, or those of a scene, named by their photos' numbers.

    A scene's cameras say no size.

    Raises:
        CalibrationFileError: a camera is not one.
    """
    if _is_scene(data):
        return [_of_scene(name, key, entry) for key, entry in data.items()]
    fx, fy = (number(name, data[key], key, positive=True) for key in ("fx", "fy"))
    cx, cy = (number(name, data[key], key) for key in ("cx", "cy"))
    width, height = (
        size(name, data[key], key) if key in data else 0 for key in ("width", "height")
    )
    camera = Perspective(fx, fy, cx, cy, width, height)
    return [FileCamera("", camera_from_integer_centres(camera))]


def _is_scene(data: dict[str, Any]) -> bool:
    return bool(data) and all(isinstance(v, dict) and "cam_K" in v for v in data.values())


def _of_scene(name: str, key: str, entry: dict[str, Any]) -> FileCamera:
    what = f"cam_K of {key}"
    camera = camera_of_matrix(name, numbers(name, entry["cam_K"], what), what, (0, 0))
    return FileCamera(key, camera_from_integer_centres(camera))
