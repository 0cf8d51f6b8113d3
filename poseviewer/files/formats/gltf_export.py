"""glTF: the model, the camera that sees it, and the photo on a plane behind the model (GLB).

glTF cameras look through the middle of their picture: the view is widened until it holds the whole
photo, and ``extras`` say the photo's size and principal point. trimesh cannot write it: it keeps
linear colours in 8 bits and knows neither orthographic cameras nor materials without light.
"""

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile
from poseviewer.files.formats import conversion as c
from poseviewer.files.mesh.gltf import animated_nodes, gltf_header, world_matrices
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.scene_assets import open_view, view_of_file
from poseviewer.files.writing import write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import HALF_PIXEL, OPENGL_FROM_OPENCV
from poseviewer.geometry.image import linear_from_srgb
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.painted_model import Painting
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import Scene

PLANE_BEHIND = 1.05
"""Distance of the photo's plane, in those of the model's furthest point."""
FAR = 100.0
"""Distance of a model from its origin, in its diameters, at which 1e-5 of it are lost."""
NEAREST = 1e-3
MAX_ROUNDING = 0.01
"""Difference of two aspect ratios, over one of them, that comes of whole pixels."""
FLOAT = 5126
UNSIGNED = 5125
VERTICES = 34962
INDICES = 34963


class Track(NamedTuple):
    """The motion of an object."""

    times_s: list[float]
    places: list[FloatArray]
    """World from model, (4, 4) each."""


def write_gltf_scene(
    scene: Scene, out: Path, options: c.ConvertOptions, notes: list[str],
    tracks: Sequence[Track] = (),
) -> dict[Path, bytes]:  # fmt: skip
    """Write a GLB file of models and cameras ``in_one_world``.

    Args:
        scene: objects and views; lengths become metres if the models' unit is known.
        out: GLB file.
        options: unit of the models.
        notes: list for notes to the user.
        tracks: motion of each object before the first camera; empty: they stand still.
    """
    if out.suffix.lower() != ".glb":
        raise PoseFileError(f"{out.name}: binary glTF files end in .glb; name it so.")
    unit, (places, poses) = options.unit_of(scene), c.in_one_world(scene, bool(tracks))
    scale = 1.0 if unit is None else c.metres_per_unit(unit)
    if unit is None:
        notes.append("The model's unit is not known: it is taken for metres; say it with `unit`.")
    paths = [c.require_file(item.model.location, "model", "glTF") for item in scene.objects]
    meshes = {path: load_mesh(path) for path in dict.fromkeys(paths)}
    motions = [track.places for track in tracks] or [[place] for place in places]
    corners = list[FloatArray]()
    for path, own in zip(paths, motions, strict=True):
        mesh = meshes[path]
        shape = np.array([*product(*mesh.bounds.T)]) if tracks else mesh.vertices
        corners += [shape @ place[:3, :3].T + place[:3, 3] for place in own]
    points, file = np.concatenate(corners), _Glb(scale)
    index = {path: file.add_mesh(mesh) for path, mesh in meshes.items()}
    models = []
    for item, place in zip(scene.objects, places, strict=True):
        model = item.model.location
        moved = place @ RigidTransform(np.eye(3), _origin(meshes[model])).as_matrix()
        matrix = moved.T.ravel().tolist()
        where = {} if tracks else {"matrix": matrix}
        models.append(file.add("nodes", name=item.label, mesh=index[model], **where))
    for node, track, path in zip(models, tracks, paths, strict=False):
        file.animate(node, track, _origin(meshes[path]))
    nodes = [file.add("nodes", name="models", scale=[scale] * 3, children=models)]
    placed = [_before(pose, points) for pose in poses]
    names = ["photo", *(view.file.location.name or "another photo" for view in scene.views[1:])]
    for name, (pose, depth) in zip(names, placed, strict=True):
        nodes.append(file.add_camera(name, pose, depth))
    if not scene.views[0].file.location.is_file():
        notes.append("No photo is known: the file has no plane with it; add `photo`.")
        return {out: file.as_bytes(nodes)}
    photo = open_view(replace(scene.views[0], mask=None))[0].photo
    (pose, depth), rgb = placed[0], photo.as_rgb8(photo.width, photo.height)
    plane = _photo_plane(pose, PLANE_BEHIND * depth, scale, rgb)
    index, origin = file.add_mesh(plane, "photo"), _origin(plane).tolist()
    nodes.append(file.add("nodes", name="photo plane", mesh=index, translation=origin))
    return {out: file.as_bytes(nodes)}


def save_painting(path: Path, painting: Painting) -> None:
    """Write the ``painting_contents`` of a painted model.

    Raises:
        PoseFileError: the name does not end in .glb, or the file cannot be written.
    """
    if path.suffix.lower() != ".glb":
        raise PoseFileError(f"{path.name}: painted models are written as .glb; name it so.")
    write_whole(path, painting_contents(painting), PoseFileError)


def painting_contents(painting: Painting) -> bytes:
    """Return a painted model as GLB, in the model's own frame and unit.

    Its colours are those of vertices. Faces that no photo shows have the material ``unpainted``,
    the others ``painted``.
    """
    file, mesh, shown = _Glb(1.0), painting.mesh, painting.is_painted
    index = file.add_mesh(mesh, materials={"painted": shown, "unpainted": ~shown})
    node = file.add("nodes", name="model", mesh=index, translation=_origin(mesh).tolist())
    return file.as_bytes([node])


def _origin(mesh: Mesh) -> FloatArray:
    """Return the offset (3,) of a node, as its 32-bit floats are exact near 0 alone."""
    is_far = np.abs(mesh.bounds).max() > FAR * mesh.diameter
    return mesh.centre if is_far else np.zeros(3)


def _before(pose: Pose, points: FloatArray) -> tuple[Pose, float]:
    """Move a parallel camera back until all points are ahead; also return the furthest depth."""
    place, size = pose.camera_from_model, float(np.linalg.norm(np.ptp(points, axis=0)))
    depths = place.apply(points)[:, 2]
    if isinstance(pose.camera, Parallel):
        ahead = max(size - float(depths.min()), 0.0)
        place = RigidTransform(place.rotation, place.translation + np.array([0.0, 0.0, ahead]))
        pose, depths = replace(pose, camera_from_model=place), depths + ahead
    return pose, max(float(depths.max()), NEAREST * size)


class _Glb:
    """A glTF 2.0 document that grows; ``data`` is its one buffer."""

    def __init__(self, scale: float) -> None:
        self.scale = scale
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

    def add_array(self, values: NDArray, indices: bool = False, is_shape: bool = True) -> int:
        """An accessor of floats (N,), (N, 2) to (N, 4), or of indices (N,)."""
        values = np.ascontiguousarray(values, "<u4" if indices else "<f4")
        low, high = (np.atleast_1d(f(values, axis=0)).tolist() for f in (np.min, np.max))
        of_view = {"target": INDICES if indices else VERTICES} if is_shape else {}
        return self.add(
            "accessors",
            bufferView=self._add_view(values.tobytes(), **of_view),
            componentType=UNSIGNED if indices else FLOAT, count=len(values),
            type=f"VEC{values.shape[1]}" if values.ndim > 1 else "SCALAR", min=low, max=high,
        )  # fmt: skip

    def add_mesh(
        self, mesh: Mesh, unlit: str = "", materials: Mapping[str, NDArray[np.bool_]] | None = None
    ) -> int:
        """Add a model about its ``_origin``.

        Args:
            mesh: the model.
            unlit: its name, if it is shown without light.
            materials: faces (F,) of each material, by its name; None: all alike, without a name.
        """
        attributes = {
            "POSITION": self.add_array(mesh.vertices - _origin(mesh)),
            "NORMAL": self.add_array(mesh.normals),
            "COLOR_0": self.add_array(linear_from_srgb(mesh.colours)),
        }
        uvs = self.add_array(np.column_stack([mesh.uvs[:, 0], 1.0 - mesh.uvs[:, 1]]))
        primitives, more = [], {}
        if unlit:
            self.document["extensionsUsed"] = ["KHR_materials_unlit"]
            more = {"name": unlit, "extensions": {"KHR_materials_unlit": {}}}
        every = {"": np.ones(len(mesh.faces), bool)}
        named = [
            (name, texture, chosen & (mesh.face_texture == texture))
            for name, chosen in (materials or every).items()
            for texture in np.unique(mesh.face_texture[chosen])
        ]
        for name, texture, chosen in named:
            look: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
            if texture >= 0:
                rgb = np.ascontiguousarray(mesh.textures[texture][..., ::-1])
                view = self._add_view(cv2.imencode(".png", rgb)[1].tobytes())
                image = self.add("images", bufferView=view, mimeType="image/png")
                look["baseColorTexture"] = {"index": self.add("textures", source=image)}
            material = {"pbrMetallicRoughness": look, "doubleSided": True, **more}
            material |= {"name": name} if name else {}
            corners = mesh.faces[chosen].reshape(-1)
            primitives.append({
                "attributes": attributes | ({"TEXCOORD_0": uvs} if texture >= 0 else {}),
                "indices": self.add_array(corners, indices=True),
                "material": self.add("materials", **material),
            })  # fmt: skip
        return self.add("meshes", name=unlit or "model", primitives=primitives)

    def animate(self, node: int, track: Track, origin: FloatArray) -> None:
        """Move a node, whose mesh is about ``origin``, along a track from its first place on."""
        places = np.array(track.places)
        sizes = np.cbrt(np.linalg.det(places[:, :3, :3]))
        turns = Rotation.from_matrix(places[:, :3, :3] / sizes[:, None, None]).as_quat()
        along = np.sum(turns[1:] * turns[:-1], axis=1)  # below 0 a player would turn the long way
        turns[1:] *= np.cumprod(np.where(along < 0.0, -1.0, 1.0))[:, None]
        values = {
            "translation": places[:, :3, :3] @ origin + places[:, :3, 3], "rotation": turns,
            "scale": np.repeat(sizes[:, None], 3, axis=1),
        }  # fmt: skip
        self.document["nodes"][node] |= {name: own[0].tolist() for name, own in values.items()}
        times = self.add_array(np.array(track.times_s), is_shape=False)
        if "animations" not in self.document:
            self.add("animations", name="sequence", channels=[], samplers=[])
        animation = self.document["animations"][0]
        for name, own in values.items():
            target = {"sampler": len(animation["samplers"]), "target": {"node": node, "path": name}}
            output = self.add_array(own, is_shape=False)
            animation["samplers"].append({"input": times, "output": output})
            animation["channels"].append(target)

    def add_camera(self, name: str, pose: Pose, far: float) -> int:
        """Add the camera of a pose that sees up to a depth; returns the index of its node."""
        camera, scale = pose.camera, self.scale
        half_width, half_height = _half_view(camera.cx, camera.cy, camera.width, camera.height)
        if isinstance(camera, Perspective):
            tangents = half_width / camera.fx, half_height / camera.fy
            lens = {"yfov": 2.0 * math.atan(tangents[1]), "aspectRatio": tangents[0] / tangents[1]}
        else:
            magnification = scale / camera.scale
            lens = {"xmag": half_width * magnification, "ymag": half_height * magnification}
        kind = "perspective" if isinstance(camera, Perspective) else "orthographic"
        lens |= {"znear": NEAREST * far * scale, "zfar": PLANE_BEHIND * 2.0 * far * scale}
        extras = {"width": camera.width, "height": camera.height,
                  "cx": camera.cx - HALF_PIXEL, "cy": camera.cy - HALF_PIXEL}  # fmt: skip
        entry = {"extras": {"poseviewer": extras}, "type": kind, kind: lens}
        place = (OPENGL_FROM_OPENCV @ pose.camera_from_model).inverse().as_matrix()
        place[:3, 3] *= scale
        index = self.add("cameras", name=name, **entry)
        return self.add("nodes", name=name, camera=index, matrix=place.T.ravel().tolist())

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


def _photo_plane(pose: Pose, depth: float, scale: float, rgb: NDArray[np.uint8]) -> Mesh:
    """The photo (height, width, 3) at a depth before the camera, in the model's frame, scaled."""
    camera, place = pose.camera, pose.camera_from_model.inverse()
    uvs = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    corners = uvs * (camera.width, -camera.height) + (0.0, camera.height)
    return Mesh(
        vertices=place.apply(camera.points_at(corners, depth)) * scale,
        faces=np.array([[0, 3, 2], [0, 2, 1]], np.int32), uvs=uvs.astype(np.float32),
        normals=np.tile(-place.rotation[:, 2], (4, 1)), colours=np.ones((4, 3), np.float32),
        face_texture=np.zeros(2, np.int32), face_part=np.zeros(2, np.int32), textures=(rgb,),
    )  # fmt: skip


def read_gltf_scene(path: Path, request: c.ConvertOptions) -> Scene:
    """Read the only camera, or that of node ``request.image``; the world is the model's frame."""
    file = InputFile(path, kind="glTF file", largest=MAX_DATA_BYTES)
    with file.naming_errors():
        file.check_size()
        document = gltf_header(path)
        nodes = document.get("nodes", [])
        known = [(str(node.get("name")), i) for i, node in enumerate(nodes) if "camera" in node]
        index = request.the_one(file, "cameras", known)
        world_from_camera = world_matrices(nodes)[index]
        entry = document["cameras"][nodes[index]["camera"]]
        metres = c.metres_per_unit(request.unit or "m")
        camera = _camera(file, entry, request, metres)
        if not animated_nodes(document).isdisjoint(_with_parents(nodes, index)):
            file.warnings.append(f"{path.name}: its camera is animated; it is taken at rest.")
    lengths = np.linalg.norm(world_from_camera[:3, :3], axis=0)
    if not np.allclose(lengths, 1.0, rtol=0.0, atol=1e-12) and np.all(lengths > 0.0):
        world_from_camera[:3, :3] /= lengths  # cameras have no size
    place = c.from_4x4(file, world_from_camera.tolist(), "the camera's matrix")
    place = RigidTransform(place.rotation, place.translation / metres)
    view = view_of_file(Path(), camera, camera_from_world=OPENGL_FROM_OPENCV @ place.inverse())
    return request.scene_of(file, view, "m")


def _with_parents(nodes: list[dict[str, Any]], index: int) -> set[int]:
    """A node, and all that it is in."""
    parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    found = set[int]()
    while index not in found:
        found.add(index)
        index = parents.get(index, index)
    return found


def _camera(
    file: InputFile, entry: dict[str, Any], request: c.ConvertOptions, metres: float
) -> Camera:
    extras = entry.get("extras", {}).get("poseviewer", {})
    width, height = request.size_of(file, (extras.get("width"), extras.get("height")))
    cx = file.number(extras.get("cx", width / 2.0 - HALF_PIXEL), "cx") + HALF_PIXEL
    cy = file.number(extras.get("cy", height / 2.0 - HALF_PIXEL), "cy") + HALF_PIXEL
    half_width, half_height = _half_view(cx, cy, width, height)
    lens = entry[entry["type"]]
    if entry["type"] == "orthographic":
        scale = half_height / file.positive(lens.get("ymag"), "ymag") * metres
        return Parallel(scale, cx, cy, width, height)
    tangent = math.tan(file.positive(lens.get("yfov"), "yfov", math.pi) / 2.0)
    own = half_width / half_height
    aspect = file.positive(lens.get("aspectRatio", own), "aspectRatio")
    if not extras and abs(aspect / own - 1.0) > MAX_ROUNDING:
        said = f"its camera has an aspect ratio of {aspect:.3g}, the photo's is {own:.3g}"
        file.warnings.append(f"{file.path.name}: {said}; its yfov is taken for the photo's height.")
        aspect = own
    fx, fy = half_width / (tangent * aspect), half_height / tangent
    return Perspective(fx, fy, cx, cy, width, height)


GLTF = c.Format(write_gltf_scene, read_gltf_scene, ".glb", several_objects=True, is_upright=True)
