"""Load a model file as a Mesh. The only importer of trimesh and assimp."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError, printable
from poseviewer.files.checks import Reading, quiet_libraries
from poseviewer.files.mesh.named import find_named
from poseviewer.files.mesh.obj import read_obj
from poseviewer.files.mesh.off import read_off
from poseviewer.files.mesh.parts import (
    Part,
    load_textures,
    textures_from_images,
)
from poseviewer.files.mesh.ply import read_ply
from poseviewer.files.mesh.surface import as_mesh
from poseviewer.geometry.mesh import Mesh

if TYPE_CHECKING:
    import trimesh

Read = tuple[list[Part], list[str]]

LARGEST_FILE = 2_000_000_000
"""Bytes: 100 for each face of the largest model; the reader takes a small multiple of it."""
GLTF = (".glb", ".gltf")
GLB_START, GLB_CHUNK = 12, 8
"""Bytes of the headers of a GLB file and of each of its chunks; the first chunk is JSON."""
GLB_HEADER = GLB_START + GLB_CHUNK


def load_mesh(path: str | Path) -> Mesh:
    """The model in an OBJ, PLY, STL, OFF, GLB, glTF or 3DS file.

    Reflectance comes from textures, vertex colours or material colours, whichever the file has.
    Normals are the file's where they make sense, else computed. What had to be mended or left
    out stands in ``notes``.
    """
    path, known = Path(path), ", ".join(READERS)
    ending = path.suffix.lower()
    kind = f"{ending[1:].upper()} file" if ending in READERS else f"model file ({known})"
    reading = Reading(path, [], MeshFileError, kind, LARGEST_FILE)
    with reading.naming_errors(), quiet_libraries():
        reading.check_size()
        if ending not in READERS:
            found = f"unknown kind of model file {path.suffix!r}"
            raise reading.error(found, f"wanted one of {known}")
        parts, notes = READERS[ending](path)
        return as_mesh(printable(path.name), parts, notes, ending in GLTF)


def _read_3ds(path: Path) -> Read:
    """Read by assimp (an extra: ``pip install 'poseviewer[3ds]'``), in the file's own axes."""
    try:
        import assimp_py
    except ImportError:
        raise MeshFileError(
            f"{path.name}: 3DS files need assimp; pip install 'poseviewer[3ds]'."
        ) from None
    flags = assimp_py.Process_Triangulate | assimp_py.Process_JoinIdenticalVertices
    scene = assimp_py.import_file(str(path), flags)
    parts: list[Part] = []
    notes: list[str] = []
    names = [_picture_3ds(material) for material in scene.materials]
    textures = load_textures(path.parent, filter(None, names), notes)
    # Assimp's root turns the model y up; left out, so that a pose belongs to the file's own axes.
    root: Any = scene.root_node
    stack = [(root, np.eye(4))]
    while stack:
        node, matrix = stack.pop()
        stack += [(child, matrix @ np.asarray(child.transformation)) for child in node.children]
        for mesh in (scene.meshes[index] for index in node.mesh_indices):
            material = scene.materials[mesh.material_index]
            texture = textures.get(_picture_3ds(material) or "")
            parts.append(_assimp_part(node.name, mesh, material, texture).moved(matrix))
    return parts, notes


def _picture_3ds(material: Any) -> str | None:
    names = material.get("TEXTURES", {}).get(1)
    return names[0] if names else None


def _assimp_part(name: str, mesh: Any, material: Any, texture: NDArray | None) -> Part:
    vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
    faces = np.array(mesh.indices, dtype=np.int64).reshape(-1, 3)
    texture, uvs = texture if mesh.texcoords else None, None
    if texture is not None:
        uvs = np.array(mesh.texcoords[0], dtype=float).reshape(len(vertices), -1)[:, :2]
    diffuse = material.get("COLOR_DIFFUSE")
    colours = None if diffuse is None or texture is not None else np.asarray(diffuse)[:3]
    return Part(name, vertices, faces, None, colours, uvs, texture)


def _read_gltf(path: Path) -> Read:
    header = gltf_header(path)
    if not isinstance(header, dict):
        raise MeshFileError(f"{path.name}: not a glTF file, but other JSON; export it again.")
    for name in _missing_files(path, header, "buffers"):
        raise MeshFileError(f"{path.name}: needs the file {name}; put it beside the model.")
    compressed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
    if used := compressed & set(header.get("extensionsRequired", [])):
        raise MeshFileError(
            f"{path.name}: compressed with {used.pop()}, which is not read here; "
            "export it without compression."
        )
    # glTF's colours are linear by its specification; trimesh writes them as they are.
    linear = "trimesh" not in str(header.get("asset", {}).get("generator", ""))
    parts, notes = _read_scene(path, linear)
    # trimesh leaves out missing pictures silently.
    gone = _missing_files(path, header, "images")
    return parts, notes + [f"Texture left out: {name} is not there." for name in gone]


def gltf_header(path: Path) -> Any:
    """The JSON of a glTF or GLB file; raises MeshFileError or ValueError where it is none."""
    with path.open("rb") as file:
        head = file.read(GLB_HEADER)
        if path.suffix.lower() == ".gltf":
            return json.loads(head + file.read())
        if len(head) < GLB_HEADER or head[:4] != b"glTF":
            raise MeshFileError(f"{path.name}: no GLB header; is it a GLB file? Export it again.")
        size, end = path.stat().st_size, GLB_START
        whole, text = struct.unpack("<8xII4x", head)
        while end + GLB_CHUNK <= size:  # trimesh takes memory for what a chunk promises
            file.seek(end)
            end += GLB_CHUNK + struct.unpack("<I", file.read(4))[0]
        if max(whole, end) > size:
            raise MeshFileError(f"{path.name}: is cut short; copy or export it again.")
        file.seek(GLB_HEADER)
        return json.loads(file.read(text))


def _missing_files(path: Path, header: dict[str, Any], kind: str) -> list[str]:
    """Names of the files beside a glTF file that it asks for and that are not there."""
    names = [unquote(str(entry.get("uri", "data:"))) for entry in header.get(kind, [])]
    named = [name for name in names if not name.startswith("data:")]
    return [name[:80] for name in named if find_named(path.parent, name) is None]


def _read_scene(path: Path, linear: bool = False) -> Read:
    """All that trimesh finds, each piece moved to its place in the scene."""
    import trimesh  # only now: it takes a third of a second, and OBJ, PLY and 3DS do without
    from trimesh.resolvers import FilePathResolver

    class Beside(FilePathResolver):
        def get(self, name: str) -> bytes:
            found = find_named(path.parent, unquote(name))
            if found is None:
                raise FileNotFoundError(name)
            return found.read_bytes()

    beside = Beside(str(path))
    scene = trimesh.load_scene(path, resolver=beside, process=False, maintain_order=True)
    notes: list[str] = []
    shown: list[tuple[str, NDArray, trimesh.Trimesh]] = []
    for node in scene.graph.nodes_geometry:
        matrix, key = scene.graph[node]
        if isinstance(geometry := scene.geometry[key], trimesh.Trimesh):  # not a cloud of points
            shown.append((node, matrix, geometry))
    pictures = [_picture_of(geometry) for _, _, geometry in shown]
    images = {id(image): ("a picture", image) for image in pictures if image is not None}
    textures = textures_from_images(images, notes)
    parts: list[Part] = []
    for node, matrix, geometry in shown:
        name = ""
        if path.suffix.lower() in GLTF:
            # trimesh adds a random suffix where a node's mesh has several primitives.
            parent = scene.graph.transforms.parents.get(node)
            name = parent if parent is not None and node.startswith(f"{parent}_") else node
        parts.append(_trimesh_part(name, geometry, linear, textures).moved(matrix))
    return parts, notes


def _picture_of(geometry: Any) -> Any:
    """Picture of its colour; None where it has none that can be laid on it."""
    visual: Any = getattr(geometry, "visual", None)
    if getattr(visual, "kind", None) != "texture" or visual.uv is None:
        return None
    return getattr(visual.material, "baseColorTexture", None)


def _trimesh_part(
    name: str, geometry: trimesh.Trimesh, linear: bool, textures: dict[int, NDArray]
) -> Part:
    visual: Any = geometry.visual
    colours, texture, uvs = None, None, None
    if visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors)[:, :3] / 255.0
    elif visual.kind == "texture":
        factor = getattr(visual.material, "baseColorFactor", None)
        colours = np.ones(3) if factor is None else np.asarray(factor)[:3] / 255.0
        extra = visual.vertex_attributes.get("color")
        if extra is not None:
            extra = np.asarray(extra)[:, :3]
            top = np.iinfo(extra.dtype).max if extra.dtype.kind in "iu" else 1.0
            colours = colours * (extra / top)
        image = _picture_of(geometry)
        if image is not None:
            texture, uvs = textures.get(id(image)), visual.uv
    if colours is not None and linear:
        colours = srgb_from_linear(colours)
    # Asking for vertex_normals would compute them; only the cache tells whether the file had some.
    normals = geometry.vertex_normals if "vertex_normals" in geometry._cache else None
    return Part(name, geometry.vertices, geometry.faces, normals, colours, uvs, texture)


def srgb_from_linear(linear: NDArray) -> NDArray:
    """Display-encoded colours from linear ones, both in [0, 1] (IEC 61966-2-1)."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def linear_from_srgb(colours: NDArray) -> NDArray:
    """Linear colours from display-encoded ones, both in [0, 1]."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


READERS: dict[str, Callable[[Path], Read]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": _read_scene,
    ".off": read_off,
    ".glb": _read_gltf,
    ".gltf": _read_gltf,
    ".3ds": _read_3ds,
}
