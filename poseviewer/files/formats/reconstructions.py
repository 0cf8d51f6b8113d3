"""Cameras of COLMAP and nerfstudio; the world is the model's frame, pixel centres at i + 0.5."""

import json
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

from poseviewer.files.camera_forms import cameras_in
from poseviewer.files.checks import InputFile, is_there
from poseviewer.files.colmap_model import colmap_cameras, colmap_file, colmap_images, image_pose
from poseviewer.files.formats import conversion as c
from poseviewer.files.photo import orientation_of
from poseviewer.files.scene_assets import view_of_file
from poseviewer.files.scene_json import relative_name
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.scene.types import Scene, View

PHOTO_ENDINGS = ("", ".png", ".jpg", ".jpeg")
"""NeRF's own sets leave them out."""
INTRINSICS = ("fl_x", "fl_y", "cx", "cy")
COLMAP_LENSES: c.Lenses = (
    ("PINHOLE", "opencv", 0), ("OPENCV", "opencv", 4), ("FULL_OPENCV", "opencv", 8),
    ("OPENCV_FISHEYE", "fisheye", 4),
)  # fmt: skip
"""Models with two focal lengths."""
NERFSTUDIO_LENSES: c.Lenses = (("OPENCV", "opencv", 5), ("OPENCV_FISHEYE", "fisheye", 4))
COEFFICIENTS = {"OPENCV": "k1 k2 p1 p2 k3", "OPENCV_FISHEYE": "k1 k2 k3 k4"}
"""nerfstudio's names."""


def write_colmap(scene: Scene, out: Path, *_: object) -> dict[Path, str]:
    """Write a model's cameras and images, without points, into the folder ``out``."""
    cameras: dict[str, int] = {}
    images = ""
    taken = c.cameras_as_taken(scene, "COLMAP", COLMAP_LENSES)
    for index, (path, transform, camera, model, distortion) in enumerate(taken, 1):
        values = *transform.as_quaternion(), *transform.translation
        place = " ".join(repr(float(x)) for x in values)
        numbers = " ".join(map(repr, (camera.fx, camera.fy, camera.cx, camera.cy, *distortion)))
        said = f"{model} {camera.width} {camera.height} {numbers}"
        number = cameras.setdefault(said, len(cameras) + 1)
        images += f"{index} {place} {number} {path.name or 'photo'}\n\n"
    note = c.focal_guess_note(scene)
    lines = f"# {note}\n" if note else ""
    lines += "".join(f"{number} {said}\n" for said, number in cameras.items())
    texts = {"cameras.txt": lines, "images.txt": images, "points3D.txt": "# none\n"}
    return {out / name: text for name, text in texts.items()}


def read_colmap(path: Path, request: c.ConvertOptions) -> Scene:
    """Read the image ``request.image``, or the only one; the world is the model's frame."""
    file = InputFile(colmap_file(path, "images"))
    view = request.the_one(file, "images", colmap_views(path, file))
    return request.scene_of(file, view, is_of_stored=True)


def colmap_views(folder: Path, file: InputFile) -> list[tuple[str, View]]:
    """List name and view of each image of the model in a folder; ``file``: of its images."""
    of_cameras, views = InputFile(colmap_file(folder, "cameras"), file.warnings), []
    images, cameras = colmap_images(file), colmap_cameras(of_cameras)
    for name, key, pose in images:
        name = with_slashes(name)
        if key not in cameras:
            raise of_cameras.error(f"it has no camera {key}", "wanted the one that the image names")
        camera, lens = cameras[key]
        place = image_pose(file, pose)
        views.append((name, view_of_file(folder / name, camera, None, lens, place)))
    return views


def write_nerfstudio(scene: Scene, out: Path, *_: object) -> dict[Path, str]:
    """Write a file of a frame for each photo; the world is the model's frame."""
    shared, frames = {}, []
    taken = c.cameras_as_taken(scene, "nerfstudio", NERFSTUDIO_LENSES)
    for path, transform, camera, model, distortion in taken:
        name = relative_name(out, path) if path.is_file() else path.name or "photo"
        world_from_camera = (OPENGL_FROM_OPENCV @ transform).inverse()
        own = {
            "camera_model": model, "w": camera.width, "h": camera.height,
            **dict(zip(INTRINSICS, map(float, astuple(camera)), strict=False)),
            **dict(zip(COEFFICIENTS[model].split(), distortion, strict=True)),
        }  # fmt: skip
        shared = shared or own
        other = {key: value for key, value in own.items() if shared.get(key) != value}
        matrix = world_from_camera.as_matrix().tolist()
        frames.append({"file_path": name, **other, "transform_matrix": matrix})
    return {out: json.dumps({**shared, "frames": frames}, indent=2) + "\n"}


def read_nerfstudio(path: Path, request: c.ConvertOptions) -> Scene:
    """Read one frame: ``request.image`` by its path or file name, or the only one."""
    file = InputFile(path)
    data = file.load_object()
    frames = file.decode(data.get("frames", []), list[dict[str, Any]], "frames")
    named = [(with_slashes(frame.get("file_path")), frame) for frame in frames]
    frame = request.the_one(file, "frames", named)
    return request.scene_of(file, frame_view(file, data | frame, request), is_of_stored=True)


def with_slashes(name: Any) -> str:
    """A photo's path, which may have been written on Windows."""
    return str(name or "photo").replace("\\", "/")


def frame_view(file: InputFile, own: dict[str, Any], options: c.ConvertOptions) -> View:
    """The view of a frame together with what the file says of all frames."""
    name = with_slashes(file.text(own.get("file_path"), "file_path"))
    tried = [file.path.parent / f"{name}{ending}" for ending in PHOTO_ENDINGS]
    path = next((path for path in tried if is_there(path)), tried[0])
    size = file.size(own.get("w"), "w"), file.size(own.get("h"), "h")
    if None in size and own.get("fl_x") is None:  # NeRF's own sets have the angle of a width
        size = options.size_of(file, size, path)
        size = size[::-1] if orientation_of(path) > 4 else size
    width, height = size[0] or 0, size[1] or 0
    said = {key: value for key, value in own.items() if key != "frames"}
    known = cameras_in(replace(file, numbers_as_text=True), said, photo=(width, height))[0]
    camera = replace(known.camera, width=width, height=height)
    world_from_camera = c.from_4x4(file, own.get("transform_matrix"), "transform_matrix")
    place = OPENGL_FROM_OPENCV @ world_from_camera.inverse()
    return view_of_file(path, camera, None, known.lens, place)


COLMAP = c.Format(write_colmap, read_colmap, lenses=COLMAP_LENSES, is_of_stored=True)
NERFSTUDIO = c.Format(
    write_nerfstudio, read_nerfstudio, ".json", lenses=NERFSTUDIO_LENSES, is_of_stored=True
)
