"""A textured quad in files of several kinds, which name their picture."""

from pathlib import Path
from urllib.parse import quote

import numpy as np

from tests.writing import write

CORNERS = ((-1.0, -0.7, 0.0), (1.0, -0.7, 0.0), (1.0, 0.7, 0.2), (-1.0, 0.7, 0.2))
UVS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
FACES = ((0, 1, 2), (0, 2, 3))


def write_obj(folder: Path, picture: str) -> Path:
    """``quad.obj`` with ``quad.mtl``."""
    lines = ["mtllib quad.mtl", "usemtl paint"]
    lines += [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"vt {u} {v}" for u, v in UVS]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}" for i in face) for face in FACES]
    (folder / "quad.mtl").write_text(f"newmtl paint\nmap_Kd {picture}\n")
    path = folder / "quad.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def write_ply(folder: Path, picture: str) -> Path:
    """``quad.ply``."""
    header = ["ply", "format ascii 1.0", f"comment TextureFile {picture}", "element vertex 4"]
    header += [f"property float {axis}" for axis in ("x", "y", "z", "s", "t")]
    header += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(str, (*c, *uv))) for c, uv in zip(CORNERS, UVS, strict=True)]
    rows += ["3 " + " ".join(map(str, face)) for face in FACES]
    path = folder / "quad.ply"
    path.write_text("\n".join([*header, *rows]) + "\n")
    return path


def write_gltf(folder: Path, picture: str) -> Path:
    """``quad.gltf`` with a file of its numbers, ``quad.bin``."""
    uvs = np.array(UVS, np.float32) * [1, -1] + [0, 1]  # v points down in glTF
    arrays = [np.array(CORNERS, "<f4"), uvs.astype("<f4"), np.array(FACES, "<u2")]
    data = b"".join(array.tobytes() for array in arrays)
    starts = np.cumsum([0, *(array.nbytes for array in arrays)])
    (folder / "quad.bin").write_bytes(data)
    low, high = np.min(CORNERS, axis=0).tolist(), np.max(CORNERS, axis=0).tolist()
    views = [
        {"buffer": 0, "byteOffset": int(start), "byteLength": array.nbytes}
        for start, array in zip(starts, arrays, strict=False)
    ]
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": quote(picture)}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": low,
             "max": high},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"uri": "quad.bin", "byteLength": len(data)}],
    }  # fmt: skip
    return write(folder / "quad.gltf", content)
