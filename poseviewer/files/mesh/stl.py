"""STL, binary or text: triangles alone.

Read here rather than by trimesh, which refuses bytes behind the last triangle and a count of 0.
"""

import re
from pathlib import Path

import numpy as np

from poseviewer.files.mesh.parts import Part

HEADER, ROW = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.MULTILINE | re.IGNORECASE)


def read_stl(path: Path) -> tuple[list[Part], list[str]]:
    """The one part of an STL file, and a note where its length is not what its header says."""
    data, notes = path.read_bytes(), []
    promised = int.from_bytes(data[HEADER - 4 : HEADER], "little")
    held = max(len(data) - HEADER, 0) // ROW.itemsize
    is_text = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:LONGEST_NAME]
    if is_text and HEADER + promised * ROW.itemsize != len(data):
        corners = np.array(VERTEX.findall(data)).astype(float)
        if len(corners) % 3 or b"endsolid" not in data[-LONGEST_NAME:]:
            raise ValueError("it is cut short")
    else:
        if promised > held:
            raise ValueError(f"it holds {held:,} of the {promised:,} triangles that it promises")
        if promised != held:
            notes.append(f"The file promises {promised:,} triangles, and holds {held:,}.")
        count = promised or held
        corners = np.frombuffer(data, ROW, count, HEADER)["corners"].astype(float)
    vertices = corners.reshape(-1, 3)
    return [Part("", vertices, np.arange(len(vertices)).reshape(-1, 3))], notes


LONGEST_NAME = 1000
"""Bytes of a text file's first and last lines."""
