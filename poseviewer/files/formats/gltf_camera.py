"""Read a camera from glTF; the scene's world is taken for the model's frame."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.matrix import from_4x4
from poseviewer.files.formats.request import Request, make_record, metres_per_unit, size_of
from poseviewer.files.pose.checks import Reading
from poseviewer.files.pose.file import PoseRecord
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import HALF_PIXEL, OPENGL_FROM_OPENCV
from poseviewer.geometry.transform import RigidTransform

LARGEST_JSON = 100_000_000
"""Bytes of JSON in a glTF file."""


def read_gltf(path: Path, request: Request) -> PoseRecord:
    """Read the camera of a GLB or glTF file: the only one, or that of the node ``request.image``.

    Without poseviewer's ``extras``, the principal point is the photo's middle.

    Raises:
        PoseFileError: there is no such camera.
    """
    reading = Reading(path.name, [])
    document = reading.object(_load_document(reading, path), "its content")
    try:
        index, world_from_camera = _chosen_node(reading, document, request)
        entry = document["cameras"][document["nodes"][index]["camera"]]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise reading.error(f"its nodes are broken ({error})", "export it again") from error
    metres = metres_per_unit(request.unit or "m")
    camera = _camera(reading, reading.object(entry, "the camera"), request, metres)
    place = from_4x4(reading, _without_scale(world_from_camera).tolist(), "the camera's matrix")
    place = RigidTransform(place.rotation, place.translation / metres)
    pose = Pose(camera, OPENGL_FROM_OPENCV @ place.inverse())
    return make_record(reading, pose, unit=request.unit or "m")


def _load_document(reading: Reading, path: Path) -> Any:
    try:
        with path.open("rb") as file:
            head = file.read(20)
            if head[:4] == b"glTF" and len(head) == 20:
                length = struct.unpack("<I", head[12:16])[0]
                text = file.read(min(length, LARGEST_JSON))
            else:
                text = head + file.read(LARGEST_JSON)
        return json.loads(text)
    except OSError as error:
        raise reading.error(f"cannot be read ({error.strerror})", "check the path") from error
    except (ValueError, RecursionError) as error:
        raise reading.error("not glTF", "wanted a .glb or .gltf file with a camera") from error


def _chosen_node(
    reading: Reading, document: dict[str, Any], request: Request
) -> tuple[int, FloatArray]:
    nodes = document.get("nodes", [])
    with_camera = [i for i, node in enumerate(nodes) if "camera" in node]
    chosen = [i for i in with_camera if request.image in (None, nodes[i].get("name"))]
    if len(chosen) != 1:
        raise reading.error(
            f"{len(chosen)} of its {len(with_camera)} cameras are "
            + (repr(request.image) if request.image else "meant"),
            "wanted one, choose it with --image NAME",
        )
    return chosen[0], _world_matrix(nodes, chosen[0])


def _world_matrix(nodes: list[dict[str, Any]], index: int) -> FloatArray:
    """``world_from_node`` (4, 4): the product of the matrices of all above."""
    parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    matrix, seen = _own_matrix(nodes[index]), {index}
    while index in parents:
        index = parents[index]
        if index in seen:
            raise ValueError("a node is above itself")
        seen.add(index)
        matrix = _own_matrix(nodes[index]) @ matrix
    return matrix


def _own_matrix(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T  # glTF: column-major
    matrix = np.eye(4)
    rotation = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]), dtype=float)
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def _without_scale(matrix: FloatArray) -> FloatArray:
    """Cameras have no size: the columns of the rotation at length 1."""
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.allclose(lengths, 1.0, rtol=0.0, atol=1e-12) or not np.all(lengths > 0.0):
        return matrix
    matrix = matrix.copy()
    matrix[:3, :3] /= lengths
    return matrix


def _camera(reading: Reading, entry: dict[str, Any], request: Request, metres: float) -> Camera:
    extras = reading.object(entry.get("extras", {}), "extras")
    extras = reading.object(extras.get("poseviewer", {}), "extras.poseviewer")
    found = (
        reading.size(extras.get("width"), "width"),
        reading.size(extras.get("height"), "height"),
    )
    width, height = size_of(reading, request, found)
    cx = reading.number(extras.get("cx", width / 2.0 - HALF_PIXEL), "cx") + HALF_PIXEL
    cy = reading.number(extras.get("cy", height / 2.0 - HALF_PIXEL), "cy") + HALF_PIXEL
    half_width, half_height = max(cx, width - cx), max(cy, height - cy)
    kind = entry.get("type")
    lens = reading.object(entry.get(kind if isinstance(kind, str) else ""), "the camera's lens")
    if kind == "orthographic":
        ymag = reading.number(lens.get("ymag"), "ymag", positive=True)
        return Parallel(half_height / ymag * metres, cx, cy, width, height)
    yfov = reading.number(lens.get("yfov"), "yfov", positive=True)
    if yfov >= math.pi:
        raise PoseFileError(f"{reading.name}: yfov is {yfov}; wanted less than pi.")
    fy = half_height / math.tan(yfov / 2.0)
    aspect = reading.number(
        lens.get("aspectRatio", half_width / half_height), "aspectRatio", positive=True
    )
    fx = half_width / (math.tan(yfov / 2.0) * aspect)
    return Perspective(fx, fy, cx, cy, width, height)
