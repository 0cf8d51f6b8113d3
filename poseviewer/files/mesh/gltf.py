"""glTF 2.0 and GLB (https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html) with extensions."""

import json
import struct
from base64 import b64decode
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile
from poseviewer.files.mesh import parts as p
from poseviewer.files.mesh.named import NOT_THERE, find_named
from poseviewer.files.mesh.parts import ModelParts, Part
from poseviewer.files.mesh.polygons import strip_corners
from poseviewer.geometry.image import srgb_from_linear

GLTF = (".glb", ".gltf")
GLB_HEADER = 20
"""Bytes of a GLB file's header and that of its first chunk, JSON."""
GLB_CHUNK = 8
"""Bytes of the header of its second chunk."""
UNDERSTOOD = (
    "KHR_mesh_quantization", "KHR_texture_transform", "EXT_mesh_gpu_instancing",
    "KHR_materials_pbrSpecularGlossiness", "EXT_texture_webp", "KHR_node_visibility",
)  # fmt: skip
"""Extensions that change shape or colour, and are read."""
SPARED = (
    "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression",
    "KHR_texture_basisu", "EXT_texture_avif",
)  # fmt: skip
"""Extensions that are not read, and that change nothing in a file that does not require them."""
HARMLESS = ("KHR_materials_", "KHR_lights_", "KHR_xmp", "KHR_animation_", "EXT_lights_", "MSFT_lod")
"""Beginnings of extensions that change neither shape nor base colour."""
TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
STRIP = 5
FAN = 6
TRIANGLES = 4
REPEAT = 10497
CUT = ("MASK", "BLEND")
"""Modes in which alpha makes something invisible."""
MIN_ALPHA = 0.05
"""Least alpha of a blended face that is visible: less can hardly be seen."""
READ = ("POSITION", "NORMAL", "COLOR_0", "TEXCOORD_", "JOINTS_", "WEIGHTS_")
"""Beginnings of attributes that are read."""
MAX_BUFFERS = 1000
"""Files of numbers that count for a model's size: each is sought in several folders."""
FREE_VALUES = 10_000_000
"""Values of vertices that a small file may have read: several of each of its copies."""
BYTES_PER_VALUE = 4
"""Fewest bytes of a value of a vertex: the specification aligns them."""
ALPHA_SAMPLES = np.array([(a, b, 1.0 - a - b) for a in (0.05, 0.35, 0.65) for b in (0.05, 0.3)])
"""Barycentric coordinates at which a triangle is asked whether its texture's alpha cuts it away."""

Matrix = NDArray[np.float64]


def gltf_header(path: Path) -> Any:
    """Return the JSON of a glTF or GLB file.

    Raises:
        ValueError: there is none.
    """
    with path.open("rb") as file:
        head = file.read(GLB_HEADER)
        if path.suffix.lower() == ".gltf":
            return json.loads((head + file.read()).decode("utf-8-sig"))
        if len(head) < GLB_HEADER or head[:4] != b"glTF":
            raise ValueError("no GLB header")
        (text,) = struct.unpack("<12xI4x", head)
        return json.loads(file.read(min(text, path.stat().st_size)))


def animated_nodes(document: Any) -> set[int]:
    """Indices of the nodes that an animation moves or bends."""
    animations = document.get("animations", [])
    channels = (channel for own in animations for channel in own.get("channels", []))
    nodes = (channel.get("target", {}).get("node") for channel in channels)
    return {node for node in nodes if isinstance(node, int)}


def read_gltf(path: Path) -> ModelParts:
    """The parts of a glTF or GLB file, one for each primitive of each node, and notes."""
    header = gltf_header(path)
    document = _Document(path, header, world_matrices(header.get("nodes", [])))
    required, used = (
        sorted({n for n in header.get(key, []) if not n.startswith(HARMLESS)} - set(UNDERSTOOD))
        for key in ("extensionsRequired", "extensionsUsed")
    )
    if required:
        wanted = "not read here; export it without (compression, KTX2 pictures ...)"
        raise MeshFileError(f"{path.name}: needs {', '.join(required)[:120]}, {wanted}.")
    document.notes += [f"Not read, left out: {name[:80]}." for name in used if name not in SPARED]
    nodes = list(document.find_meshes())
    document.check_counts([index for index, *_ in nodes])
    parts = [part for node in nodes for part in document.parts_of(*node)]
    document.notes += [f"{what}: {count:,}." for what, count in document.counts.items() if count]
    return ModelParts(parts, document.notes, 1.0, y_up=True)


@dataclass(eq=False)
class _Document:
    path: Path
    data: dict[str, Any]
    worlds: dict[int, Matrix]
    notes: list[str] = field(default_factory=list)
    _fetched: dict[str, bytes] = field(default_factory=dict)
    alphas: dict[int | None, NDArray[np.uint8]] = field(default_factory=dict)
    """Alpha of pictures that cut, by their indices."""
    counts: Counter[str] = field(default_factory=Counter)

    def find_meshes(self) -> Iterator[tuple[int, str, Matrix]]:
        """Each node of the scene that has a mesh: its index, name, and world from node."""
        nodes, scenes = self.data.get("nodes", []), self.data.get("scenes")
        roots = scenes[self.data.get("scene", 0)].get("nodes", []) if scenes else roots_of(nodes)
        names, taken = [], Counter[str]()
        for i, node in enumerate(nodes):
            name = node.get("name") or str(i)
            names.append(f"{name}_{taken[name]}" if taken[name] else name)
            taken[name] += 1
        waiting, visited = list(roots), set[int]()
        while waiting:
            index = waiting.pop()
            if index in visited:
                raise ValueError(f"node {index} is there twice")
            if (_extension(nodes[index], "KHR_node_visibility") or {}).get("visible", True):
                visited.add(index)
                waiting += nodes[index].get("children", [])
                if "mesh" in nodes[index]:
                    yield index, names[index], self.worlds[index]
        others = sum("mesh" in node and i not in visited for i, node in enumerate(nodes))
        self.counts["Nodes that the file's scene does not show, left out"] = others
        moved = animated_nodes(self.data) & visited
        moving = sum("camera" not in nodes[index] for index in moved)
        self.counts["Animated nodes, shown at rest"] = moving

    def check_counts(self, shown: list[int]) -> None:
        """Raise where the nodes show too much, as the header counts it, before any is built."""
        sizes = cache(self._size_of)
        parts, faces, vertices, values = 0, 0, 0, 0
        for node in (self.data["nodes"][index] for index in shown):
            mesh = self.data["meshes"][node["mesh"]]
            weights = tuple(node.get("weights", mesh.get("weights", [])))
            primitives, of_faces, of_vertices, read = sizes(node["mesh"], weights)
            copies = self._count_copies(node)
            parts, faces = parts + copies * primitives, faces + copies * of_faces
            vertices, values = vertices + copies * of_vertices, values + read
        uris = {buffer.get("uri", "data:") for buffer in self.data.get("buffers", [])}
        named = [uri for uri in uris if not uri.startswith("data:")][:MAX_BUFFERS]
        files = {find_named(self.path.parent, unquote(uri)) for uri in named} - {None}
        size = sum(file.stat().st_size for file in (self.path, *files) if file)
        p.check_counts(self.path.name, size, parts, faces, vertices)
        most = FREE_VALUES + size // BYTES_PER_VALUE
        p.check_count(self.path.name, "values of vertices with all copies", values, most)

    def _size_of(self, mesh: int, weights: tuple[float, ...]) -> tuple[int, int, int, int]:
        """Count a mesh's parts, faces, vertices, and values to be read of these."""
        accessors, sizes = self.data["accessors"], [(0, 0, 0, 0)]
        for primitive in self.data["meshes"][mesh]["primitives"]:
            mode, targets = primitive.get("mode", TRIANGLES), primitive.get("targets", [])
            if mode not in (TRIANGLES, STRIP, FAN):
                continue
            morphs = [t for weight, t in zip(weights, targets, strict=False) if weight]
            used = [*_read(primitive).values(), *(t["POSITION"] for t in morphs if "POSITION" in t)]
            if len(counts := {accessors[index]["count"] for index in used}) > 1:
                raise ValueError("its corners have attributes of several numbers")
            (count,) = counts
            corners = accessors[primitive["indices"]]["count"] if "indices" in primitive else count
            if min(count, corners) < 1:
                raise ValueError("an accessor of no values")
            changed = [own["count"] for i in used if (own := accessors[i].get("sparse"))]
            vertices = min(count, corners)
            faces = corners // 3 if mode == TRIANGLES else corners - 2
            sizes.append(
                (1, faces, vertices, vertices * len(used) + count * len(changed) + sum(changed))
            )
        parts, faces, vertices, values = map(sum, zip(*sizes, strict=True))
        return parts, faces, vertices, values

    def _count_copies(self, node: dict[str, Any]) -> int:
        if not (instancing := _extension(node, "EXT_mesh_gpu_instancing")):
            return 1
        accessors = self.data["accessors"]
        (count,) = {accessors[index]["count"] for index in instancing["attributes"].values()}
        p.check_count(self.path.name, "instances", count, p.MAX_PARTS)
        return count

    def parts_of(self, index: int, name: str, world: Matrix) -> Iterator[Part]:
        """The parts of a node's mesh, wherever the node, its instances or its skin put them."""
        node = self.data["nodes"][index]
        mesh = self.data["meshes"][node["mesh"]]
        weights = node.get("weights", mesh.get("weights", []))
        places = [np.eye(4) if "skin" in node else world]
        instancing = _extension(node, "EXT_mesh_gpu_instancing")
        if instancing and "skin" not in node:
            read = {k.lower(): self.array(v) for k, v in instancing["attributes"].items()}
            each = ({k: v[i] for k, v in read.items()} for i in range(self._count_copies(node)))
            places = [world @ node_matrix(one) for one in each]
        skin = self.data["skins"][node["skin"]] if "skin" in node else None
        for primitive in mesh["primitives"]:
            self.counts["Shapes with morph targets, shown at rest"] += "targets" in primitive
            part = self._part(name, primitive, weights, skin)
            if part is not None:
                yield from (part.transform(place) for place in places)

    def _part(
        self,
        name: str,
        primitive: dict[str, Any],
        weights: list[float],
        skin: dict[str, Any] | None,
    ) -> Part | None:
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            self.notes.append("Points or lines, left out.")
            return None
        positions = self.data["accessors"][primitive["attributes"]["POSITION"]]
        if "bufferView" not in positions:
            for extension in primitive.get("extensions", {}):
                raise ValueError(f"it is compressed with {extension}")
        count, rows = positions["count"], slice(None)
        order = np.arange(count)
        if "indices" in primitive:
            order = self.array(primitive["indices"]).reshape(-1).astype(np.int64)
            p.check_indices(order, count)
        if len(order) < count:  # such as of vertices that many primitives share
            rows, order = np.unique(order, return_inverse=True)
        attributes = {key: self.array(index, rows) for key, index in _read(primitive).items()}
        vertices, normals = attributes["POSITION"].astype(float), attributes.get("NORMAL")
        for weight, target in zip(weights, primitive.get("targets", []), strict=False):
            if weight and "POSITION" in target:
                vertices, normals = vertices + weight * self.array(target["POSITION"], rows), None
        faces = strip_corners(order) if mode == STRIP else order
        if mode == FAN:
            faces = np.stack([np.full(len(order) - 2, order[0]), order[1:-1], order[2:]], axis=1)
        part = Part(name, vertices, faces.reshape(-1, 3), normals)
        if skin is not None:
            part = self._apply_skin(part, attributes, skin)
        rgba, has_colours = np.ones(4), "COLOR_0" in attributes
        if has_colours:
            colours = attributes["COLOR_0"]
            rgba = np.ones((len(colours), 4))
            rgba[:, :3] = p.colours_from_numbers(colours[:, :3], self.notes)
            rgba[:, 3 : colours.shape[1]] = colours[:, 3:]
        if "material" in primitive:
            material = self.data["materials"][primitive["material"]]
            rgba = _look(material)[0] * rgba
            part = self._add_texture(part, material, attributes, rgba[..., 3])
        elif not has_colours:
            return part
        rgb = np.ascontiguousarray(rgba[..., :3])
        # trimesh writes display-encoded colours, against the rules.
        is_encoded = "trimesh" in str(self.data.get("asset", {}).get("generator", ""))
        return replace(part, colours=rgb if is_encoded else srgb_from_linear(rgb))

    def _add_texture(
        self, part: Part, material: dict[str, Any], attributes: dict[str, NDArray], alpha: NDArray
    ) -> Part:
        """Add the texture, and leave out triangles that ``alpha``, (V,) or (), makes invisible."""
        info = _look(material)[1] or {}
        transform = _extension(info, "KHR_texture_transform") or {}
        coordinates = f"TEXCOORD_{transform.get('texCoord', info.get('texCoord', 0))}"
        image = self._image_of(info) if info else None
        texture, mode = self.textures.get(image), material.get("alphaMode", "OPAQUE")
        shown = np.broadcast_to(alpha, len(part.vertices))[part.faces] @ ALPHA_SAMPLES.T
        if texture is not None and coordinates in attributes:
            uvs = _transform_uvs(attributes[coordinates], transform)
            uvs = np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)
            part = replace(part, uvs=uvs, texture=texture)
            number = self.data["textures"][info["index"]].get("sampler")
            wraps = {} if number is None else self.data["samplers"][number]
            is_wrapped = [wraps.get(name, REPEAT) == REPEAT for name in ("wrapS", "wrapT")]
            p.note_edges(uvs, is_wrapped, self.notes)
            if mode in CUT and (picture := self.alphas.get(image)) is not None:
                uvs = np.einsum("sk,fkd->fsd", ALPHA_SAMPLES, uvs[part.faces]) % 1.0
                height, width = picture.shape
                rows = ((1.0 - uvs[..., 1]) * height).astype(int).clip(0, height - 1)
                columns = (uvs[..., 0] * width).astype(int).clip(0, width - 1)
                shown = shown * picture[rows, columns] / 255.0
        if mode not in CUT:
            return part
        shown = shown >= (material.get("alphaCutoff", 0.5) if mode == "MASK" else MIN_ALPHA) - 1e-6
        whole, partly = shown.all(axis=1), shown.any(axis=1)
        self.counts["Invisible triangles, left out"] += int(np.sum(~partly))
        note = "Triangles cut out in part by a texture, shown whole"
        self.counts[note] += int(np.sum(partly & ~whole))
        return replace(part, faces=part.faces[partly])

    def _image_of(self, info: dict[str, Any]) -> int | None:
        texture = self.data["textures"][info["index"]]
        index = (_extension(texture, "EXT_texture_webp") or texture).get("source")
        index = texture.get("source") if index is None else index
        if index is None:
            kinds = ", ".join(texture.get("extensions", {}))[:80] or "no kind"
            self.notes.append(f"Texture left out: its picture is of {kinds}.")
        return index

    @cached_property
    def textures(self) -> dict[int | None, NDArray[np.uint8]]:
        """Pictures of base colours by their indices, RGB (h, w, 3); fills ``alphas``."""
        used: dict[int | None, bool] = {}
        for material in self.data.get("materials", []):
            if (info := _look(material)[1]) is not None:
                index = self._image_of(info)
                used[index] = used.get(index, False) or material.get("alphaMode") in CUT
        opened: dict[int, tuple[str, Image.Image]] = {}
        first_of: dict[tuple[str, bool], int] = {}
        same: dict[int | None, int] = {}
        if len(used) > p.MAX_TEXTURES:
            self.notes.append(f"Textures left out: all but {p.MAX_TEXTURES:,} of {len(used):,}.")
        room = p.MAX_TEXELS
        for index, entry in enumerate(self.data.get("images", [])):
            uri, view = entry.get("uri", "data:"), entry.get("bufferView")
            name = "a picture" if uri.startswith("data:") else unquote(uri)[:80]
            if index not in used or len(same) == p.MAX_TEXTURES:
                continue
            place = uri if view is None else str(self.data["bufferViews"][view])
            same[index] = first_of.setdefault((place, used[index]), index)
            if same[index] != index:  # it is read already
                continue
            with p.note_errors(name, self.notes):
                content = self.fetch(uri) if view is None else self.view(view)
                image = Image.open(BytesIO(content))
                if used[index] and (texels := image.width * image.height) <= p.MAX_TEXELS:
                    room -= texels
                    if room < 0:
                        raise Image.DecompressionBombError
                    self.alphas[index] = np.asarray(image.convert("RGBA").getchannel("A"))
                opened[index] = name, image
        textures = p.textures_from_images(opened, self.notes)
        self.alphas |= {i: self.alphas[first] for i, first in same.items() if first in self.alphas}
        return {i: textures[first] for i, first in same.items() if first in textures}

    def _apply_skin(self, part: Part, attributes: dict[str, NDArray], skin: dict[str, Any]) -> Part:
        matrices = np.array([self.worlds[joint] for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:
            inverse = self.array(skin["inverseBindMatrices"], slice(len(matrices)))
            matrices = matrices @ inverse.reshape(-1, 4, 4).swapaxes(1, 2).astype(float)
        blend, total = np.zeros((len(part.vertices), 4, 4)), np.zeros(len(part.vertices))
        for number in range(len(attributes)):
            if f"JOINTS_{number}" in attributes:
                weights = attributes[f"WEIGHTS_{number}"].astype(float)
                joints = attributes[f"JOINTS_{number}"].astype(np.int64)
                for weight, joint in zip(weights.T, joints.T, strict=True):
                    blend += weight[:, None, None] * matrices[joint]
                total += weights.sum(axis=1)
        blend /= np.where(total > 0.0, total, 1.0)[:, None, None]
        vertices = np.einsum("vab,vb->va", blend[:, :3, :3], part.vertices) + blend[:, :3, 3]
        part = replace(part, vertices=vertices)
        if part.normals is None:
            return part
        return replace(part, normals=np.einsum("vab,vb->va", blend[:, :3, :3], part.normals))

    def array(self, index: int, rows: NDArray | slice = slice(None)) -> NDArray:
        """Rows of an accessor (count, width); normalised integers as what they stand for."""
        accessor = self.data["accessors"][index]
        width, kind = WIDTHS[accessor["type"]], np.dtype(TYPES[accessor["componentType"]])
        values = np.broadcast_to(np.zeros((), kind), (accessor["count"], width))
        if "bufferView" in accessor:
            values = self._table(accessor, accessor["count"], width, kind)
        if sparse := accessor.get("sparse"):
            of_indices = np.dtype(TYPES[sparse["indices"]["componentType"]])
            which = self._table(sparse["indices"], sparse["count"], 1, of_indices)[:, 0]
            values = values.copy()
            values[which] = self._table(sparse["values"], sparse["count"], width, kind)
        values = values[rows]
        if accessor.get("normalized"):
            values = np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def _table(self, entry: dict[str, Any], count: int, width: int, kind: np.dtype) -> NDArray:
        data = self.view(entry["bufferView"])
        row, start = width * kind.itemsize, entry.get("byteOffset", 0)
        stride = self.data["bufferViews"][entry["bufferView"]].get("byteStride", row)
        if count < 1 or stride < row or start < 0 or start + (count - 1) * stride + row > len(data):
            raise ValueError("an accessor reaches beyond its buffer")
        return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view."""
        entry = self.data["bufferViews"][index]
        start, buffer = entry.get("byteOffset", 0), self.data["buffers"][entry["buffer"]]
        whole = memoryview(self.fetch(buffer["uri"]) if "uri" in buffer else self._chunk)
        end = start + entry["byteLength"]
        if not 0 <= start <= end <= len(whole):
            raise ValueError("a buffer view reaches beyond its buffer")
        return whole[start:end]

    @cached_property
    def _chunk(self) -> bytes:
        with self.path.open("rb") as file:
            (text,) = struct.unpack("<12xI4x", file.read(GLB_HEADER))
            file.seek(GLB_HEADER + text + GLB_CHUNK)
            return file.read()

    def fetch(self, uri: str) -> bytes:
        """The bytes that a URI means: its own, or those of a file beside the model."""
        if uri not in self._fetched:
            self._fetched[uri] = self._fetch(uri)
        return self._fetched[uri]

    def _fetch(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            return b64decode(uri.partition(",")[2])
        path = find_named(self.path.parent, unquote(uri))
        if path is None:
            raise ValueError(f"{unquote(uri)[:80]} {NOT_THERE}")
        return InputFile(path, [], MeshFileError, "file of a model", MAX_DATA_BYTES).load_bytes()


def _extension(entry: dict[str, Any], name: str) -> Any:
    return entry.get("extensions", {}).get(name)


def _read(primitive: dict[str, Any]) -> dict[str, int]:
    """Accessors by the attributes that are read."""
    return {k: index for k, index in primitive["attributes"].items() if k.startswith(READ)}


def _look(material: dict[str, Any]) -> tuple[NDArray, dict[str, Any] | None]:
    """Base colour RGBA (linear), and what is said of its texture."""
    look, names = material.get("pbrMetallicRoughness", {}), ("baseColorFactor", "baseColorTexture")
    if glossy := _extension(material, "KHR_materials_pbrSpecularGlossiness"):
        look, names = glossy, ("diffuseFactor", "diffuseTexture")
    return np.array(look.get(names[0], [1.0] * 4), dtype=float), look.get(names[1])


def _transform_uvs(uvs: NDArray, transform: dict[str, Any]) -> NDArray:
    """Texture coordinates (n, 2), v downwards, as KHR_texture_transform moves them."""
    c, s = (f(transform.get("rotation", 0.0)) for f in (np.cos, np.sin))
    scaled = uvs * np.array(transform.get("scale", (1.0, 1.0)))
    return scaled @ np.array([[c, -s], [s, c]]) + np.array(transform.get("offset", (0.0, 0.0)))


def roots_of(nodes: list[dict[str, Any]]) -> list[int]:
    """Indices of the nodes that have no parent."""
    below = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in below]


def world_matrices(nodes: list[dict[str, Any]]) -> dict[int, Matrix]:
    """``world_from_node`` (4, 4) by the index of each node that is not below itself."""
    waiting = [(index, np.eye(4)) for index in roots_of(nodes)]
    worlds: dict[int, Matrix] = {}
    while waiting:
        index, above = waiting.pop()
        if index in worlds:
            raise ValueError(f"node {index} is there twice")
        worlds[index] = above @ node_matrix(nodes[index])
        waiting += [(child, worlds[index]) for child in nodes[index].get("children", [])]
    return worlds


def node_matrix(node: dict[str, Any]) -> Matrix:
    """A node's own matrix (4, 4): translation, rotation (x y z w) and scale, or all in one."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T  # glTF: column-major
    matrix = np.eye(4)
    if not {"rotation", "scale", "translation"} & node.keys():
        return matrix
    rotation = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]), dtype=float)
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix
