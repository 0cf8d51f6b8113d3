"""glTF: the model, the camera that sees it, and the photo on a plane behind the model (GLB).

The model's frame is glTF's world. glTF cameras look through the middle of their picture; where
the principal point is elsewhere, the view is widened until it holds the whole photo, and the
photo's plane still lies exactly where it belongs. ``extras`` of the camera say the photo's size
and principal point.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.gltf_buffers import GltfBuilder, add_mesh, add_picture_plane
from poseviewer.files.formats.matrix import as_4x4
from poseviewer.files.formats.request import (
    Request,
    Written,
    metres_per_unit,
    refuse_existing,
    refuse_lens,
    require_file,
    unit_of,
)
from poseviewer.files.formats.view_depths import ViewDepths, in_front, view_depths
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo.load import load_photo
from poseviewer.files.pose.file import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV, camera_as_integer_centres

PLANE_BEHIND = 1.05
"""Distance of the photo's plane, in those of the model's furthest point."""


def write_gltf(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a GLB file. Lengths become metres where the model's unit is known.

    Raises:
        PoseViewerError: the model or photo is not known or unusable; the file is there already.
    """
    refuse_lens(record, "glTF")
    if out.suffix.lower() != ".glb":
        raise PoseFileError(f"{out.name}: binary glTF files end in .glb; name it so.")
    mesh = load_mesh(require_file(request.model, "model", "glTF"))
    refuse_existing(request, out)
    pose = in_front(record.pose, mesh)
    depths = view_depths(pose, mesh)
    unit = unit_of(record, request)
    scale = 1.0 if unit is None else metres_per_unit(unit)
    builder = GltfBuilder({"asset": {"version": "2.0", "generator": "poseviewer"}})
    model = builder.add("nodes", name="model", mesh=add_mesh(builder, mesh, "model"))
    nodes = [model]
    if scale != 1.0:
        nodes = [builder.add("nodes", name="metres", scale=[scale] * 3, children=[model])]
    nodes.append(_add_camera(builder, pose, depths, scale))
    notes = []
    if request.photo is None:
        notes.append("No photo is known: the file has no plane with it; add --photo FILE.")
    else:
        nodes.append(_add_photo(builder, pose, depths, scale, request.photo))
    builder.document |= {"scene": 0, "scenes": [{"nodes": nodes}]}
    write_whole(out, builder.as_glb(), PoseFileError)
    return Written((out,), tuple(notes))


def _add_camera(builder: GltfBuilder, pose: Pose, depths: ViewDepths, scale: float) -> int:
    camera = pose.camera
    width, height = _half_view(camera)
    clip = {"znear": depths.near * scale, "zfar": PLANE_BEHIND * 2.0 * depths.far * scale}
    if isinstance(camera, Perspective):
        tangents = width / camera.fx, height / camera.fy
        lens = {"yfov": 2.0 * math.atan(tangents[1]), "aspectRatio": tangents[0] / tangents[1]}
        entry: dict[str, Any] = {"type": "perspective", "perspective": lens | clip}
    else:
        sides = {"xmag": width / camera.scale * scale, "ymag": height / camera.scale * scale}
        entry = {"type": "orthographic", "orthographic": sides | clip}
    inside = camera_as_integer_centres(camera)
    extras = {"width": camera.width, "height": camera.height, "cx": inside.cx, "cy": inside.cy}
    index = builder.add("cameras", name="photo", extras={"poseviewer": extras}, **entry)
    place = (OPENGL_FROM_OPENCV @ pose.camera_from_model).inverse()
    matrix = as_4x4(place)
    matrix[:3, 3] *= scale
    return builder.add("nodes", name="photo", camera=index, matrix=matrix.T.reshape(-1).tolist())


def _half_view(camera: Camera) -> tuple[float, float]:
    """Half the sides, in px, of the least picture about the principal point with all the photo."""
    return max(camera.cx, camera.width - camera.cx), max(camera.cy, camera.height - camera.cy)


def _add_photo(
    builder: GltfBuilder, pose: Pose, depths: ViewDepths, scale: float, path: Path
) -> int:
    photo = load_photo(path)
    camera = pose.camera
    if (photo.width, photo.height) != (camera.width, camera.height):
        raise PoseFileError(
            f"{path.name}: {photo.width}x{photo.height} px, and the pose is one for "
            f"{camera.width}x{camera.height} px; name the photo of the pose with --photo."
        )
    corners = _plane(pose, PLANE_BEHIND * depths.far) * scale
    mesh = add_picture_plane(builder, corners, photo.as_rgb8(photo.width, photo.height))
    return builder.add("nodes", name="photo plane", mesh=mesh)


def _plane(pose: Pose, depth: float) -> FloatArray:
    """The photo's corners (4, 3) at a depth before the camera, in the model's frame."""
    camera = pose.camera
    sides = (0.0, 0.0), (camera.width, 0.0), (camera.width, camera.height), (0.0, camera.height)
    corners = np.array(sides, dtype=float)
    if isinstance(camera, Perspective):
        points = depth * camera.rays(corners)
    else:
        flat = (corners - (camera.cx, camera.cy)) / camera.scale
        points = np.column_stack([flat, np.full(4, depth)])
    return pose.camera_from_model.inverse().apply(points)
