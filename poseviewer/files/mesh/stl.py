"""STL, binary or text, by trimesh, once what trimesh refuses or passes over is mended."""

import re
from io import BytesIO
from pathlib import Path

import numpy as np

from poseviewer.files.mesh.parts import ModelParts, Part

HEADER_BYTES = 84
TRIANGLE_BYTES = 50
SOLID = re.compile(r"^[ \t]*+(end)?[ \t]*+solid\b", re.MULTILINE | re.IGNORECASE)
VERTEX = re.compile(r"^[ \t]*+vertex\b[^\n]*+", re.MULTILINE | re.IGNORECASE)


def read_stl(path: Path) -> ModelParts:
    """Read the one part of an STL file.

    Raises:
        ValueError: less is there than promised.
    """
    import trimesh

    data = path.read_bytes()
    notes = []
    text = ""
    count = promised = int.from_bytes(data[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    held = max(len(data) - HEADER_BYTES, 0) // TRIANGLE_BYTES
    if len(data) != HEADER_BYTES + promised * TRIANGLE_BYTES:
        text = data.decode("ascii", "replace").replace("\r", "\n")
    if lines := VERTEX.findall(text):
        ends = [bool(end) for end in SOLID.findall(text)]
        count = len(lines) / 3 if 2 * sum(ends) >= len(ends) else -1
        data = "\n".join(["solid", *lines, "endsolid"]).encode()
    elif promised > held:
        raise ValueError(f"it holds {held:,} of the {promised:,} triangles that it promises")
    else:
        if promised != held:
            notes.append(f"The file promises {promised:,} triangles, and holds {held:,}.")
        count = promised or held
        data = (
            data[: HEADER_BYTES - 4]
            + count.to_bytes(4, "little")
            + data[HEADER_BYTES:][: count * TRIANGLE_BYTES]
        )
    scene = trimesh.load_scene(BytesIO(data), file_type="stl", process=False)
    corners = np.zeros((0, 3))
    for mesh in scene.geometry.values():
        corners = mesh.triangles.reshape(-1, 3)
        if np.any(mesh.face_attributes.get("stl", 0)):
            notes.append("Attributes of triangles (colours, with some programs), left out.")
    if len(corners) != 3 * count:
        raise ValueError("it is cut short")
    return ModelParts([Part("", corners, np.arange(len(corners)).reshape(-1, 3))], notes)
