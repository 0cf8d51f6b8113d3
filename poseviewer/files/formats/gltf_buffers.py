"""Geometry and pictures into the binary part of a GLB file (glTF 2.0)."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.files.mesh.load import linear_from_srgb
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh

FLOAT, UNSIGNED = 5126, 5125
VERTICES, INDICES = 34962, 34963
"""What a buffer view is for, in OpenGL's numbers."""
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}


@dataclass(slots=True)
class GltfBuilder:
    """A glTF document that grows; ``data`` is its one buffer."""

    document: dict[str, Any] = field(default_factory=dict)
    data: bytearray = field(default_factory=bytearray)

    def add(self, kind: str, **entry: Any) -> int:
        """Append to one of the document's lists; returns the index there."""
        entries = self.document.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def add_array(self, values: NDArray, *, indices: bool = False) -> int:
        """An accessor of floats (N,), (N, 2), (N, 3), or of indices (N,)."""
        values = np.ascontiguousarray(values, "<u4" if indices else "<f4")
        columns = values.reshape(len(values), -1)
        view = self._add_view(values.tobytes(), target=INDICES if indices else VERTICES)
        return self.add(
            "accessors",
            bufferView=view,
            componentType=UNSIGNED if indices else FLOAT,
            count=len(values),
            type=KINDS[columns.shape[1]],
            min=columns.min(axis=0).tolist(),
            max=columns.max(axis=0).tolist(),
        )

    def add_picture(self, rgb: NDArray[np.uint8]) -> int:
        """A texture of a picture (height, width, 3), kept as PNG."""
        _, encoded = cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))
        view = self._add_view(encoded.tobytes())
        image = self.add("images", bufferView=view, mimeType="image/png")
        return self.add("textures", source=image)

    def as_glb(self) -> bytes:
        """The whole file: header, JSON, binary."""
        self.document["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.document, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _add_view(self, content: bytes, **more: Any) -> int:
        self.data.extend(b"\0" * (-len(self.data) % 4))
        start = len(self.data)
        self.data.extend(content)
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(content), **more)


def add_mesh(builder: GltfBuilder, mesh: Mesh, name: str) -> int:
    """The model, a primitive for each of its textures; returns the mesh's index."""
    attributes = {
        "POSITION": builder.add_array(mesh.vertices),
        "NORMAL": builder.add_array(mesh.normals),
        "COLOR_0": builder.add_array(linear_from_srgb(mesh.colours)),
    }
    uvs = builder.add_array(np.column_stack([mesh.uvs[:, 0], 1.0 - mesh.uvs[:, 1]]))
    primitives = []
    for texture in np.unique(mesh.face_texture):
        corners = mesh.faces[mesh.face_texture == texture].reshape(-1)
        textured = texture >= 0
        look: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        if textured:
            look["baseColorTexture"] = {"index": builder.add_picture(mesh.textures[texture])}
        primitives.append(
            {
                "attributes": attributes | ({"TEXCOORD_0": uvs} if textured else {}),
                "indices": builder.add_array(corners, indices=True),
                "material": builder.add("materials", pbrMetallicRoughness=look, doubleSided=True),
            }
        )
    return builder.add("meshes", name=name, primitives=primitives)


def add_picture_plane(builder: GltfBuilder, corners: FloatArray, rgb: NDArray[np.uint8]) -> int:
    """A picture on a quadrangle (4, 3): its upper left, upper right, lower right, lower left."""
    texture = builder.add_picture(rgb)
    material = builder.add(
        "materials",
        name="photo",
        pbrMetallicRoughness={"baseColorTexture": {"index": texture}, "metallicFactor": 0.0},
        extensions={"KHR_materials_unlit": {}},
        doubleSided=True,
    )
    builder.document["extensionsUsed"] = ["KHR_materials_unlit"]
    primitive = {
        "attributes": {
            "POSITION": builder.add_array(corners),
            "TEXCOORD_0": builder.add_array(np.array([[0, 0], [1, 0], [1, 1], [0, 1]])),
        },
        "indices": builder.add_array(np.array([0, 3, 2, 0, 2, 1]), indices=True),
        "material": material,
    }
    return builder.add("meshes", name="photo", primitives=[primitive])
