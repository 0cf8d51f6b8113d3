"""OFF: counts, then a line for each vertex and one for each face (as Geomview has it).

Read here rather than by trimesh, which says nothing of lines that are missing or too many.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.obj import read_table
from poseviewer.files.mesh.parts import Part, fan_corners

HEADER = re.compile(r"\s*C?OFF\s+(\d+)\s+(\d+)(\s+\d+)?\s*\n", re.ASCII)
COMMENT = re.compile(r"#[^\n]*")


def read_off(path: Path) -> tuple[list[Part], list[str]]:
    """The one part of an OFF file (colours are left out), and no notes."""
    text = COMMENT.sub("", path.read_text("ascii", "replace"))
    header = HEADER.match(text)
    if header is None:
        raise MeshFileError(
            f"{path.name}: no OFF header; is it an OFF file in text? Export it again."
        )
    vertices, faces = int(header[1]), int(header[2])
    lines = [line for line in text[header.end() :].splitlines() if line.strip()]
    polygons = [line.split() for line in lines[vertices:]]
    counts = [int(words[0]) for words in polygons]
    corners = [
        int(word)
        for words, count in zip(polygons, counts, strict=True)
        for word in words[1 : count + 1]
    ]
    if len(lines) != vertices + faces or len(corners) != sum(counts):
        raise MeshFileError(
            f"{path.name}: not the {vertices:,} vertices and {faces:,} faces that it promises; it "
            "is damaged or cut short, export it again."
        )
    triangles = np.array(corners, dtype=np.int64)[fan_corners(np.array(counts))]
    return [Part("", read_table(lines[:vertices], 3), triangles)], []
