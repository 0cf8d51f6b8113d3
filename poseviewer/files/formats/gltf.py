"""glTF: the model, the camera that sees it, and the photo on a plane behind the model (GLB).

The model's frame is glTF's world. glTF cameras look through the middle of their picture; where
the principal point is elsewhere, the view is widened until it holds the whole photo, and the
photo's plane still lies exactly where it belongs. ``extras`` of the camera say the photo's size
and principal point; without them, it is the photo's middle.

Written here rather than by trimesh, which keeps linear colours in 8 bits (dark ones run into each
other) and knows neither orthographic cameras nor materials without light.
"""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import Reading
from poseviewer.files.formats.conversion import (
    ConvertOptions,
    Format,
    Written,
    from_4x4,
    in_one_world,
    load_photo_of,
    make_record,
    metres_per_unit,
    require_file,
    size_of,
    the_one,
    unit_of,
    write_new,
)
from poseviewer.files.mesh.load import LARGEST_FILE, linear_from_srgb, load_mesh
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_file import SceneRecord
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import HALF_PIXEL, OPENGL_FROM_OPENCV
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform, Similarity

PLANE_BEHIND = 1.05
"""Distance of the photo's plane, in those of the model's furthest point."""
NEAREST = 1e-3
"""The near plane, in the models' diameters at the least: for cameras inside a model."""
LARGEST_JSON = 100_000_000
"""Bytes of JSON in a glTF file."""
FLOAT, UNSIGNED, VERTICES, INDICES = 5126, 5125, 34962, 34963
"""OpenGL's numbers of what a buffer holds and is for."""
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}


def write_gltf(scene: SceneRecord, out: Path, options: ConvertOptions) -> Written:
    """Write a GLB file of models and cameras ``in_one_world``, which is glTF's; lengths become
    metres where the models' unit is known.
    """
    if out.suffix.lower() != ".glb":
        raise PoseFileError(f"{out.name}: binary glTF files end in .glb; name it so.")
    unit, (places, poses) = unit_of(scene, options), in_one_world(scene)
    scale = 1.0 if unit is None else metres_per_unit(unit)
    paths = [require_file(one.path, "model", "glTF") for one in scene.objects]
    meshes = {path: load_mesh(path) for path in dict.fromkeys(paths)}
    corners = [
        meshes[path].vertices @ place[:3, :3].T + place[:3, 3]
        for path, place in zip(paths, places, strict=True)
    ]
    points, file = np.concatenate(corners), _Glb()
    index = {path: file.add_mesh(mesh) for path, mesh in meshes.items()}
    models = [
        file.add("nodes", name=one.label, mesh=index[one.path], matrix=_column_major(place))
        for one, place in zip(scene.objects, places, strict=True)
    ]
    nodes = [file.add("nodes", name="models", scale=[scale] * 3, children=models)]
    poses = [_in_front(pose, points) for pose in poses]
    names = ["photo", *(view.path.name or "another photo" for view in scene.views[1:])]
    for name, pose in zip(names, poses, strict=True):
        nodes.append(file.add_camera(name, pose, _depths(pose, points), scale))
    notes, view = [], scene.views[0]
    if not view.path.is_file():
        notes.append("No photo is known: the file has no plane with it; add --photo FILE.")
    else:
        photo, (_, far) = load_photo_of(view), _depths(poses[0], points)
        rgb = photo.as_rgb8(photo.width, photo.height)
        plane = file.add_photo(_plane(poses[0], PLANE_BEHIND * far) * scale, rgb)
        nodes.append(file.add("nodes", name="photo plane", mesh=plane))
    return write_new(options, {out: file.as_bytes(nodes)}, *notes)


def _depths(pose: Pose, points: FloatArray) -> tuple[float, float]:
    """Depths of a plane before the points and of the furthest of them."""
    depths = pose.camera_from_model.apply(points)[:, 2]
    least = NEAREST * _size(points)
    return max(0.5 * float(depths.min()), least), max(float(depths.max()), 2.0 * least)


def _in_front(pose: Pose, points: FloatArray) -> Pose:
    """The pose with the points before the camera: parallel projection has no depth to keep."""
    if not isinstance(pose.camera, Parallel):
        return pose
    place = pose.camera_from_model
    ahead = max(_size(points) - float(place.apply(points)[:, 2].min()), 0.0)
    moved = RigidTransform(place.rotation, place.translation + np.array([0.0, 0.0, ahead]))
    return replace(pose, camera_from_model=moved)


def _size(points: FloatArray) -> float:
    """Diagonal of the points' bounding box."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _column_major(matrix: FloatArray) -> list[float]:
    return matrix.T.reshape(-1).tolist()


class _Glb:
    """A glTF 2.0 document that grows; ``data`` is its one buffer."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "poseviewer"}}
        self.data = bytearray()

    def add(self, kind: str, **entry: Any) -> int:
        """Append to one of the document's lists; returns the index there."""
        entries = self.document.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def _add_view(self, content: bytes, **more: Any) -> int:
        self.data.extend(b"\0" * (-len(self.data) % 4))
        start = len(self.data)
        self.data.extend(content)
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(content), **more)

    def add_array(self, values: NDArray, indices: bool = False) -> int:
        """An accessor of floats (N,), (N, 2), (N, 3), or of indices (N,)."""
        values = np.ascontiguousarray(values, "<u4" if indices else "<f4")
        columns = values.reshape(len(values), -1)
        return self.add(
            "accessors",
            bufferView=self._add_view(values.tobytes(), target=INDICES if indices else VERTICES),
            componentType=UNSIGNED if indices else FLOAT,
            count=len(values),
            type=KINDS[columns.shape[1]],
            min=columns.min(axis=0).tolist(),
            max=columns.max(axis=0).tolist(),
        )

    def add_picture(self, rgb: NDArray[np.uint8]) -> dict[str, int]:
        """A texture of a picture (height, width, 3), kept as PNG, as materials name it."""
        _, encoded = cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))
        view = self._add_view(encoded.tobytes())
        image = self.add("images", bufferView=view, mimeType="image/png")
        return {"index": self.add("textures", source=image)}

    def add_mesh(self, mesh: Mesh) -> int:
        """The model, a primitive for each of its textures; returns the mesh's index."""
        attributes = {
            "POSITION": self.add_array(mesh.vertices),
            "NORMAL": self.add_array(mesh.normals),
            "COLOR_0": self.add_array(linear_from_srgb(mesh.colours)),
        }
        uvs = self.add_array(np.column_stack([mesh.uvs[:, 0], 1.0 - mesh.uvs[:, 1]]))
        primitives = []
        for texture in np.unique(mesh.face_texture):
            look: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
            if texture >= 0:
                look["baseColorTexture"] = self.add_picture(mesh.textures[texture])
            corners = mesh.faces[mesh.face_texture == texture].reshape(-1)
            primitives.append(
                {
                    "attributes": attributes | ({"TEXCOORD_0": uvs} if texture >= 0 else {}),
                    "indices": self.add_array(corners, indices=True),
                    "material": self.add("materials", pbrMetallicRoughness=look, doubleSided=True),
                }
            )
        return self.add("meshes", name="model", primitives=primitives)

    def add_camera(self, name: str, pose: Pose, depths: tuple[float, float], scale: float) -> int:
        """The camera of a pose that sees what is at some depths; returns the index of its node."""
        near, far = depths
        clip = {"znear": near * scale, "zfar": PLANE_BEHIND * 2.0 * far * scale}
        place = Similarity((OPENGL_FROM_OPENCV @ pose.camera_from_model).inverse()).matrix
        place[:3, 3] *= scale
        camera = self.add("cameras", name=name, **_camera_as_json(pose.camera, clip, scale))
        return self.add("nodes", name=name, camera=camera, matrix=_column_major(place))

    def add_photo(self, corners: FloatArray, rgb: NDArray[np.uint8]) -> int:
        """The photo on a quadrangle (4, 3): upper left, upper right, lower right, lower left."""
        self.document["extensionsUsed"] = ["KHR_materials_unlit"]
        look = {"baseColorTexture": self.add_picture(rgb), "metallicFactor": 0.0}
        material = self.add(
            "materials",
            name="photo",
            pbrMetallicRoughness=look,
            extensions={"KHR_materials_unlit": {}},
            doubleSided=True,
        )
        uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        primitive = {
            "attributes": {"POSITION": self.add_array(corners), "TEXCOORD_0": self.add_array(uvs)},
            "indices": self.add_array(np.array([0, 3, 2, 0, 2, 1]), indices=True),
            "material": material,
        }
        return self.add("meshes", name="photo", primitives=[primitive])

    def as_bytes(self, nodes: list[int]) -> bytes:
        """The whole file, with one scene of these nodes: header, JSON, binary."""
        buffers = [{"byteLength": len(self.data)}]
        document = self.document | {"scene": 0, "scenes": [{"nodes": nodes}], "buffers": buffers}
        text = json.dumps(document, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _half_view(cx: float, cy: float, width: int, height: int) -> tuple[float, float]:
    """Half the sides, in px, of the least picture about the principal point with all the photo."""
    return max(cx, width - cx), max(cy, height - cy)


def _camera_as_json(camera: Camera, clip: dict[str, float], scale: float) -> dict[str, Any]:
    half_width, half_height = _half_view(camera.cx, camera.cy, camera.width, camera.height)
    if isinstance(camera, Perspective):
        tangents = half_width / camera.fx, half_height / camera.fy
        lens = {"yfov": 2.0 * math.atan(tangents[1]), "aspectRatio": tangents[0] / tangents[1]}
        kind = "perspective"
    else:
        sides = half_width / camera.scale * scale, half_height / camera.scale * scale
        lens, kind = dict(zip(("xmag", "ymag"), sides, strict=True)), "orthographic"
    extras = {"width": camera.width, "height": camera.height,
              "cx": camera.cx - HALF_PIXEL, "cy": camera.cy - HALF_PIXEL}  # fmt: skip
    return {"extras": {"poseviewer": extras}, "type": kind, kind: lens | clip}


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


def read_gltf(path: Path, request: ConvertOptions) -> PoseRecord:
    """Read the only camera, or that of node ``request.image``; the world is the model's frame."""
    reading = Reading(path, kind="glTF file", largest=LARGEST_FILE)
    document = reading.object(_load_document(reading), "its content")
    try:
        nodes = document.get("nodes", [])
        indices = [i for i, node in enumerate(nodes) if "camera" in node]
        names = [nodes[i].get("name") for i in indices]
        index = the_one(reading, request, "cameras", names, indices)
        world_from_camera = _world_matrix(nodes, index)
        entry = document["cameras"][nodes[index]["camera"]]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise reading.error(f"its nodes are broken ({error})", "export it again") from error
    metres = metres_per_unit(request.unit or "m")
    camera = _camera(reading, reading.object(entry, "the camera"), request, metres)
    lengths = np.linalg.norm(world_from_camera[:3, :3], axis=0)
    if not np.allclose(lengths, 1.0, rtol=0.0, atol=1e-12) and np.all(lengths > 0.0):
        world_from_camera[:3, :3] /= lengths  # cameras have no size
    place = from_4x4(reading, world_from_camera.tolist(), "the camera's matrix")
    place = RigidTransform(place.rotation, place.translation / metres)
    pose = Pose(camera, OPENGL_FROM_OPENCV @ place.inverse())
    return make_record(reading, pose, unit=request.unit or "m")


def _load_document(reading: Reading) -> Any:
    try:
        with reading.open() as file:
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


def _camera(
    reading: Reading, entry: dict[str, Any], request: ConvertOptions, metres: float
) -> Camera:
    extras = reading.object(entry.get("extras", {}), "extras")
    extras = reading.object(extras.get("poseviewer", {}), "extras.poseviewer")
    width, height = size_of(reading, request, extras.get("width"), extras.get("height"))
    cx = reading.number(extras.get("cx", width / 2.0 - HALF_PIXEL), "cx") + HALF_PIXEL
    cy = reading.number(extras.get("cy", height / 2.0 - HALF_PIXEL), "cy") + HALF_PIXEL
    half_width, half_height = _half_view(cx, cy, width, height)
    kind = entry.get("type")
    lens = reading.object(entry.get(kind if isinstance(kind, str) else ""), "the camera's lens")
    if kind == "orthographic":
        ymag = reading.positive(lens.get("ymag"), "ymag")
        return Parallel(half_height / ymag * metres, cx, cy, width, height)
    yfov = reading.positive(lens.get("yfov"), "yfov")
    if yfov >= math.pi:
        raise reading.error(f"yfov is {yfov}", "wanted less than pi")
    aspect = lens.get("aspectRatio", half_width / half_height)
    aspect = reading.positive(aspect, "aspectRatio")
    tangent = math.tan(yfov / 2.0)
    return Perspective(
        half_width / (tangent * aspect), half_height / tangent, cx, cy, width, height
    )


GLTF = Format(write_gltf, read_gltf, several_objects=True)
