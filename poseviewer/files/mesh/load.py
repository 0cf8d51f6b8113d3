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

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.named import find_named
from poseviewer.files.mesh.obj import read_obj
from poseviewer.files.mesh.parts import (
    Part,
    load_texture,
    no_faces,
    refuse_if_huge,
    refuse_many_words,
    texture_from_image,
)
from poseviewer.files.mesh.ply import read_ply
from poseviewer.files.mesh.surface import as_mesh
from poseviewer.files.quiet import quiet_libraries
from poseviewer.geometry.mesh import Mesh

if TYPE_CHECKING:
    import trimesh

Read = tuple[list[Part], list[str]]

LARGEST_FILE = 4_000_000_000
"""Bytes: 200 for each face of the largest model."""
STL_HEADER, STL_TRIANGLE = 84, 50
"""Bytes of a binary STL file: before the triangles, and for each."""
STL_SHORTEST_FACET = 60
"""Bytes of a facet in a text STL file, at the least."""
GLTF = (".glb", ".gltf")
GLTF_TRIANGLES = 4
"""glTF's mode for a list of triangles; strips and fans have nearly a face for each corner."""


def load_mesh(path: str | Path) -> Mesh:
    """The model in an OBJ, PLY, STL, OFF, GLB, glTF or 3DS file.

    Reflectance comes from textures, vertex colours or material colours, whichever the file has.
    Normals are the file's where they make sense, else computed. What had to be mended or left
    out stands in ``notes``.

    Raises:
        MeshFileError: there is no such file, or it cannot be used as a surface mesh.
    """
    path = Path(path)
    ending = path.suffix.lower()
    reader = _reader_for(path)
    try:
        with quiet_libraries():
            parts, notes = reader(path)
    except MeshFileError:
        raise
    except OSError as error:
        raise MeshFileError(
            f"{path.name}: cannot be read ({error.strerror or error}); check the file."
        ) from error
    except MemoryError as error:
        raise MeshFileError(f"{path.name}: too large for this machine's memory.") from error
    except Exception as error:  # third-party parsers raise anything on damaged files
        raise MeshFileError(
            f"{path.name}: not a readable {ending[1:].upper()} file ({_first_line(error)}); is it "
            "whole? Export it again."
        ) from error
    return as_mesh(path.name, parts, notes, ending in GLTF)


def _reader_for(path: Path) -> Callable[[Path], Read]:
    """The reader for a path that has been looked at: a file, not empty, of a known kind."""
    known = ", ".join(READERS)
    if path.is_dir():
        raise MeshFileError(f"{path.name or path}: is a folder; wanted a model file ({known}).")
    if not path.is_file():
        raise MeshFileError(f"{path.name}: no such file in {path.parent}; check the path.")
    reader, size = READERS.get(path.suffix.lower()), path.stat().st_size
    if reader is None:
        raise MeshFileError(
            f"{path.name}: unknown kind of model file {path.suffix!r}; wanted one of {known}."
        )
    if size == 0:
        raise MeshFileError(f"{path.name}: an empty file; wanted a model, copy or export it again.")
    if size > LARGEST_FILE:
        raise MeshFileError(
            f"{path.name}: {size:,} bytes; poseviewer takes up to {LARGEST_FILE:,}, "
            "simplify the model first."
        )
    return reader


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0][:120] if lines else type(error).__name__


def _read_3ds(path: Path) -> Read:
    """By way of assimp (an extra: ``pip install 'poseviewer[3ds]'``), in the file's own axes."""
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
    shown = 0
    # Assimp's root turns the model y up; left out, so that a pose belongs to the file's own axes.
    root: Any = scene.root_node
    stack = [(root, np.eye(4))]
    while stack:
        node, matrix = stack.pop()
        stack += [(child, matrix @ np.asarray(child.transformation)) for child in node.children]
        for mesh in (scene.meshes[index] for index in node.mesh_indices):
            shown += len(mesh.indices) // 3
            refuse_if_huge(path.name, shown)  # nodes may show one mesh again and again
            part = _assimp_part(path, node.name, mesh, scene.materials[mesh.material_index], notes)
            parts.append(part.moved(matrix))
    return parts, notes


def _assimp_part(path: Path, name: str, mesh: Any, material: Any, notes: list[str]) -> Part:
    vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
    faces = np.array(mesh.indices, dtype=np.int64).reshape(-1, 3)
    names, texture, uvs = material.get("TEXTURES", {}).get(1), None, None
    if names and mesh.texcoords:
        texture = load_texture(path.parent, names[0], notes)
        if texture is not None:
            uvs = np.array(mesh.texcoords[0], dtype=float).reshape(len(vertices), -1)[:, :2]
    diffuse = material.get("COLOR_DIFFUSE")
    colours = None if diffuse is None or texture is not None else np.asarray(diffuse)[:3]
    return Part(name, vertices, faces, None, colours, uvs, texture)


def _read_stl(path: Path) -> Read:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(STL_HEADER)
        file.seek(max(0, size - 1024))
        tail = file.read()
    count = struct.unpack("<I", head[80:84])[0] if len(head) == STL_HEADER else 0
    if size != STL_HEADER + STL_TRIANGLE * count or len(head) < STL_HEADER:
        if not head.lstrip().lower().startswith(b"solid"):
            raise MeshFileError(
                f"{path.name}: {size:,} bytes are not the {count:,} triangles that an STL header "
                "would promise here; it is cut short or not an STL file, export it again."
            )
        if b"endsolid" not in tail.lower():
            raise MeshFileError(
                f"{path.name}: the text ends without 'endsolid'; it is cut short, export it again."
            )
        refuse_many_words(path, STL_SHORTEST_FACET, {b"endfacet": "faces"})
    else:
        refuse_if_huge(path.name, count)
    return _read_scene(path)


def _read_off(path: Path) -> Read:
    with path.open("rb") as file:
        words = b" ".join(line.split(b"#")[0] for line in file.read(4096).splitlines()).split()
    if not words or words[0] not in (b"OFF", b"COFF"):
        raise MeshFileError(f"{path.name}: no OFF header; is it an OFF file? Export it again.")
    for word, what in zip(words[1:3], ("vertices", "faces"), strict=False):
        if word.isdigit():
            refuse_if_huge(path.name, int(word), what)
    try:
        return _read_scene(path)
    except (ValueError, IndexError) as error:
        raise MeshFileError(
            f"{path.name}: its lines do not fit its header ({_first_line(error)}); it is damaged "
            "or cut short, export it again."
        ) from error


def _read_gltf(path: Path) -> Read:
    header = gltf_header(path)
    if not isinstance(header, dict):
        raise MeshFileError(f"{path.name}: not a glTF file, but other JSON; export it again.")
    for name in _missing_files(path, header, "buffers"):
        raise MeshFileError(f"{path.name}: needs the file {name}; put it beside the model.")
    _refuse_huge_gltf(path.name, header)
    compressed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
    if used := compressed & set(header.get("extensionsRequired", [])):
        raise MeshFileError(
            f"{path.name}: compressed with {used.pop()}, which is not read here; "
            "export it without compression."
        )
    # glTF's colours are linear by its specification; trimesh writes them as they are.
    linear = "trimesh" not in str(header.get("asset", {}).get("generator", ""))
    parts, notes = _read_scene(path, linear)
    # trimesh leaves out pictures that are not there without a word.
    gone = _missing_files(path, header, "images")
    return parts, notes + [f"Texture left out: {name} is not there." for name in gone]


def gltf_header(path: Path) -> Any:
    """The JSON of a glTF or GLB file.

    Raises:
        MeshFileError, ValueError: it is not one, or cut short.
    """
    data = path.read_bytes()
    if path.suffix.lower() == ".gltf":
        return json.loads(data)
    if len(data) < 20 or data[:4] != b"glTF":
        raise MeshFileError(f"{path.name}: no GLB header; is it a GLB file? Export it again.")
    length, json_length = struct.unpack("<II", data[8:16])
    if length > len(data):
        raise MeshFileError(
            f"{path.name}: {len(data):,} bytes of {length:,}; it is cut short, "
            "copy or export it again."
        )
    return json.loads(data[20 : 20 + json_length])


def _missing_files(path: Path, header: dict[str, Any], kind: str) -> list[str]:
    """Names of the files beside a glTF file that it asks for and that are not there."""
    names = [unquote(str(entry.get("uri", "data:"))) for entry in header.get(kind, [])]
    named = [name for name in names if not name.startswith("data:")]
    return [name[:80] for name in named if find_named(path.parent, name) is None]


def _refuse_huge_gltf(name: str, header: dict[str, Any]) -> None:
    """A mesh counts as often as nodes show it, and a table without bytes in the file is made of
    zeros: both make much of little.
    """
    tables, faces = header.get("accessors", []), []
    for mesh in header.get("meshes", []):
        faces.append(0)
        for primitive in mesh.get("primitives", []):
            table = primitive.get("indices", primitive.get("attributes", {}).get("POSITION"))
            corners = 0 if table is None else tables[table]["count"]
            triangles = primitive.get("mode", GLTF_TRIANGLES) == GLTF_TRIANGLES
            faces[-1] += corners // 3 if triangles else corners
    shown = [node["mesh"] for node in header.get("nodes", []) if "mesh" in node]
    refuse_if_huge(name, sum(faces[mesh] for mesh in shown))
    refuse_if_huge(name, max((a["count"] for a in tables), default=0) // 3, "triples of numbers")
    empty = sum(a["count"] for a in tables if "bufferView" not in a)
    refuse_if_huge(name, empty // 3, "triples of zeros")


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
    parts: list[Part] = []
    notes: list[str] = []
    images: dict[int, NDArray | None] = {}
    for node in scene.graph.nodes_geometry:
        matrix, geometry_name = scene.graph[node]
        geometry: Any = scene.geometry[geometry_name]
        if not isinstance(geometry, trimesh.Trimesh):
            parts += no_faces(np.asarray(geometry.vertices)[:, :3])
            continue
        name = ""
        if path.suffix.lower() in GLTF:
            # trimesh adds a random suffix where a node's mesh has several primitives.
            parent = scene.graph.transforms.parents.get(node)
            name = parent if parent is not None and node.startswith(f"{parent}_") else node
        part = _trimesh_part(name, geometry, linear, images, notes)
        parts.append(part.moved(np.asarray(matrix)))
    return parts, notes


def _trimesh_part(
    name: str,
    geometry: trimesh.Trimesh,
    linear: bool,
    images: dict[int, NDArray | None],
    notes: list[str],
) -> Part:
    """``images``: textures by their pictures' ids, each decoded once for all the parts."""
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
        image = getattr(visual.material, "baseColorTexture", None)
        if image is not None and visual.uv is not None:
            if id(image) not in images:
                images[id(image)] = None
                try:
                    images[id(image)] = texture_from_image(image)
                except OSError as error:
                    notes.append(f"Texture left out: {_first_line(error)}.")
            texture, uvs = images[id(image)], visual.uv
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
    ".stl": _read_stl,
    ".off": _read_off,
    ".glb": _read_gltf,
    ".gltf": _read_gltf,
    ".3ds": _read_3ds,
}
