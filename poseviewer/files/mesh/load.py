"""Load a model file as a Mesh. The only importer of trimesh and assimp."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import replace
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
from poseviewer.files.writing import keep
from poseviewer.geometry.image import srgb_from_linear
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
    names = [next(iter(paint.get("TEXTURES", {}).get(1, [])), "") for paint in scene.materials]
    textures = load_textures(path.parent, filter(None, names), notes)
    # Assimp's root turns the model y up; left out, so that a pose belongs to the file's own axes.
    root: Any = scene.root_node
    stack = [(root, np.eye(4))]
    while stack:
        node, matrix = stack.pop()
        stack += [(child, matrix @ np.asarray(child.transformation)) for child in node.children]
        for mesh in (scene.meshes[index] for index in node.mesh_indices):
            vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
            part = Part(node.name, vertices, np.array(mesh.indices, np.int64).reshape(-1, 3))
            texture = textures.get(names[mesh.material_index]) if mesh.texcoords else None
            diffuse = scene.materials[mesh.material_index].get("COLOR_DIFFUSE")
            if texture is not None:
                uvs = np.array(mesh.texcoords[0], dtype=float).reshape(len(vertices), -1)[:, :2]
                part = replace(part, uvs=uvs, texture=texture)
            elif diffuse is not None:
                part = replace(part, colours=np.asarray(diffuse)[:3])
            parts.append(part.moved(matrix))
    return parts, notes


def _read_gltf(path: Path) -> Read:
    header = gltf_header(path)
    compressed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
    if used := compressed & set(header.get("extensionsRequired", [])):
        raise MeshFileError(
            f"{path.name}: compressed with {used.pop()}, which is not read here; "
            "export it without compression."
        )
    # glTF's colours are linear by its specification; trimesh writes them as they are.
    linear = "trimesh" not in str(header.get("asset", {}).get("generator", ""))
    return _read_scene(path, linear)


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


def _read_scene(path: Path, linear: bool = False) -> Read:
    """All that trimesh finds, each piece moved to its place in the scene."""
    import trimesh  # only now: it takes a third of a second, and OBJ, PLY and 3DS do without
    from trimesh.resolvers import FilePathResolver

    missing: list[str] = []

    class Beside(FilePathResolver):
        def get(self, name: str) -> bytes:
            name = unquote(name)
            file = find_named(path.parent, name)
            if file is None:  # trimesh does without pictures, and says nothing
                missing.append(f"Texture left out: {name[:80]} is not there.")
                wanted = f"needs the file {name[:80]}; put it beside the model"
                raise MeshFileError(f"{path.name}: {wanted}.")
            keep(file)
            return file.read_bytes()

    scene = trimesh.load_scene(path, resolver=Beside(str(path)), process=False, maintain_order=True)
    nodes = [(node, *scene.graph[node]) for node in scene.graph.nodes_geometry]
    meshes = {k: m for k, m in scene.geometry.items() if isinstance(m, trimesh.Trimesh)}
    pictures = {key: _picture_of(mesh.visual) for key, mesh in meshes.items()}
    notes: list[str] = []
    images = {id(image): ("a picture", image) for image in pictures.values() if image is not None}
    textures = textures_from_images(images, notes)
    parts: list[Part] = []
    for node, matrix, key in nodes:
        name = ""
        if path.suffix.lower() in GLTF:
            # trimesh adds a random suffix where a node's mesh has several primitives.
            parent = scene.graph.transforms.parents.get(node)
            name = parent if parent is not None and node.startswith(f"{parent}_") else node
        if key in meshes:  # not a cloud of points
            texture = textures.get(id(pictures[key]))
            parts.append(_trimesh_part(name, meshes[key], linear, texture).moved(matrix))
    return parts, notes + missing


def _picture_of(visual: Any) -> Any:
    """Picture of a mesh's colour; None where it has none that can be laid on it."""
    if visual.kind != "texture" or visual.uv is None:
        return None
    return getattr(visual.material, "baseColorTexture", None)


def _trimesh_part(
    name: str, geometry: trimesh.Trimesh, linear: bool, texture: NDArray | None
) -> Part:
    visual: Any = geometry.visual
    colours = None
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
    if colours is not None and linear:
        colours = srgb_from_linear(colours)
    # Asking for vertex_normals would compute them; only the cache tells whether the file had some.
    normals = geometry.vertex_normals if "vertex_normals" in geometry._cache else None
    uvs = None if texture is None else visual.uv
    return Part(name, geometry.vertices, geometry.faces, normals, colours, uvs, texture)


READERS: dict[str, Callable[[Path], Read]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": _read_scene,
    ".off": read_off,
    ".glb": _read_gltf,
    ".gltf": _read_gltf,
    ".3ds": _read_3ds,
}
