"""glTF 2.0 and GLB (https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html) with extensions."""

import json
import struct
from base64 import b64decode
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
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
    parts = [part for node in document.find_meshes() for part in document.parts_of(*node)]
    document.notes += [f"{what}: {count:,}." for what, count in document.counts.items() if count]
    return ModelParts(parts, document.notes, 1.0, y_up=True)


@dataclass(eq=False)
class _Document:
    path: Path
    data: dict[str, Any]
    worlds: dict[int, Matrix]
    notes: list[str] = field(default_factory=list)
    _buffers: dict[int, bytes] = field(default_factory=dict)
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

    def parts_of(self, index: int, name: str, world: Matrix) -> Iterator[Part]:
        """The parts of a node's mesh, wherever the node, its instances or its skin put them."""
        node = self.data["nodes"][index]
        mesh = self.data["meshes"][node["mesh"]]
        weights = node.get("weights", mesh.get("weights", []))
        places = [world]
        if instancing := _extension(node, "EXT_mesh_gpu_instancing"):
            read = {k.lower(): self.array(v) for k, v in instancing["attributes"].items()}
            (count,) = {len(values) for values in read.values()}
            p.check_count(self.path.name, "instances", count, p.MAX_PARTS)
            places = [world @ node_matrix({k: v[i] for k, v in read.items()}) for i in range(count)]
        for primitive in mesh["primitives"]:
            part = self._part(name, primitive, weights)
            if part is None:
                continue
            if "skin" in node:
                skin = self.data["skins"][node["skin"]]
                yield self._apply_skin(part, primitive["attributes"], skin)
            else:
                yield from (part.transform(place) for place in places)

    def _part(self, name: str, primitive: dict[str, Any], weights: list[float]) -> Part | None:
        attributes, mode = primitive["attributes"], primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            self.notes.append("Points or lines, left out.")
            return None
        if "bufferView" not in self.data["accessors"][attributes["POSITION"]]:
            for extension in primitive.get("extensions", {}):
                raise ValueError(f"it is compressed with {extension}")
        vertices = self.array(attributes["POSITION"]).astype(float)
        normals = self.array(attributes["NORMAL"]) if "NORMAL" in attributes else None
        for weight, target in zip(weights, primitive.get("targets", []), strict=False):
            if weight and "POSITION" in target:
                vertices, normals = vertices + weight * self.array(target["POSITION"]), None
        order = np.arange(len(vertices))
        if "indices" in primitive:
            order = self.array(primitive["indices"]).reshape(-1).astype(np.int64)
        faces = strip_corners(order) if mode == STRIP else order
        if mode == FAN:
            faces = np.stack([np.full(len(order) - 2, order[0]), order[1:-1], order[2:]], axis=1)
        part = Part(name, vertices, faces.reshape(-1, 3), normals)
        rgba, has_colours = np.ones(4), "COLOR_0" in attributes
        if has_colours:
            colours = self.array(attributes["COLOR_0"])
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
        self, part: Part, material: dict[str, Any], attributes: dict[str, int], alpha: NDArray
    ) -> Part:
        """Add the texture, and leave out triangles that ``alpha``, (V,) or (), makes invisible."""
        info = _look(material)[1] or {}
        transform = _extension(info, "KHR_texture_transform") or {}
        coordinates = f"TEXCOORD_{transform.get('texCoord', info.get('texCoord', 0))}"
        image = self._image_of(info) if info else None
        texture, mode = self.textures.get(image), material.get("alphaMode", "OPAQUE")
        shown = np.broadcast_to(alpha, len(part.vertices))[part.faces] @ ALPHA_SAMPLES.T
        if texture is not None and coordinates in attributes:
            uvs = _transform_uvs(self.array(attributes[coordinates]), transform)
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
        opened: dict[int | None, tuple[str, Image.Image]] = {}
        for index, entry in enumerate(self.data.get("images", [])):
            uri, view = entry.get("uri", "data:"), entry.get("bufferView")
            name = "a picture" if uri.startswith("data:") else unquote(uri)[:80]
            if index not in used:
                continue
            with p.note_errors(name, self.notes):
                content = self.fetch(uri) if view is None else self.view(view)
                image = Image.open(BytesIO(content))
                if used[index] and image.width * image.height <= p.MAX_TEXELS:
                    self.alphas[index] = np.asarray(image.convert("RGBA").getchannel("A"))
                opened[index] = name, image
        return p.textures_from_images(opened, self.notes)

    def _apply_skin(self, part: Part, attributes: dict[str, int], skin: dict[str, Any]) -> Part:
        matrices = np.array([self.worlds[joint] for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:
            inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            matrices = matrices @ inverse[: len(matrices)].swapaxes(1, 2).astype(float)
        blend, total = np.zeros((len(part.vertices), 4, 4)), np.zeros(len(part.vertices))
        for number in range(len(attributes)):
            if f"JOINTS_{number}" in attributes:
                weights = self.array(attributes[f"WEIGHTS_{number}"]).astype(float)
                joints = self.array(attributes[f"JOINTS_{number}"]).astype(np.int64)
                blend += np.einsum("vj,vjab->vab", weights, matrices[joints])
                total += weights.sum(axis=1)
        blend /= np.where(total > 0.0, total, 1.0)[:, None, None]
        vertices = np.einsum("vab,vb->va", blend[:, :3, :3], part.vertices) + blend[:, :3, 3]
        part = replace(part, vertices=vertices)
        if part.normals is None:
            return part
        return replace(part, normals=np.einsum("vab,vb->va", blend[:, :3, :3], part.normals))

    def array(self, index: int) -> NDArray:
        """Values of an accessor (count, width); normalised integers as what they stand for."""
        accessor = self.data["accessors"][index]
        width, kind = WIDTHS[accessor["type"]], np.dtype(TYPES[accessor["componentType"]])
        values = self._table(accessor, accessor["count"], width, kind)
        if sparse := accessor.get("sparse"):
            of_indices = np.dtype(TYPES[sparse["indices"]["componentType"]])
            which = self._table(sparse["indices"], sparse["count"], 1, of_indices)[:, 0]
            values = values.copy()
            values[which] = self._table(sparse["values"], sparse["count"], width, kind)
        if accessor.get("normalized"):
            values = np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def _table(self, entry: dict[str, Any], count: int, width: int, kind: np.dtype) -> NDArray:
        if "bufferView" not in entry:
            return np.zeros((min(count, MAX_DATA_BYTES // (width * kind.itemsize)), width), kind)
        data = self.view(entry["bufferView"])
        row, start = width * kind.itemsize, entry.get("byteOffset", 0)
        stride = self.data["bufferViews"][entry["bufferView"]].get("byteStride", row)
        if count < 1 or stride < row or start < 0 or start + (count - 1) * stride + row > len(data):
            raise ValueError("an accessor reaches beyond its buffer")
        return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view."""
        entry = self.data["bufferViews"][index]
        start, number = entry.get("byteOffset", 0), entry["buffer"]
        if number not in self._buffers:
            buffer = self.data["buffers"][number]
            self._buffers[number] = self.fetch(buffer["uri"]) if "uri" in buffer else self._chunk()
        whole, end = memoryview(self._buffers[number]), start + entry["byteLength"]
        if not 0 <= start <= end <= len(whole):
            raise ValueError("a buffer view reaches beyond its buffer")
        return whole[start:end]

    def _chunk(self) -> bytes:
        with self.path.open("rb") as file:
            (text,) = struct.unpack("<12xI4x", file.read(GLB_HEADER))
            file.seek(GLB_HEADER + text + GLB_CHUNK)
            return file.read()

    def fetch(self, uri: str) -> bytes:
        """The bytes that a URI means: its own, or those of a file beside the model."""
        if uri.startswith("data:"):
            return b64decode(uri.partition(",")[2])
        path = find_named(self.path.parent, unquote(uri))
        if path is None:
            raise ValueError(f"{unquote(uri)[:80]} {NOT_THERE}")
        return InputFile(path, [], MeshFileError, "file of a model", MAX_DATA_BYTES).load_bytes()


def _extension(entry: dict[str, Any], name: str) -> Any:
    return entry.get("extensions", {}).get(name)


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
    rotation = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]), dtype=float)
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix
