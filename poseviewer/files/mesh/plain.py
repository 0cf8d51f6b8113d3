"""STL (binary or text) and OFF: shapes without colours.

Read here rather than by trimesh, which refuses bytes behind STL's last triangle and a count of 0,
and says nothing of OFF's lines that are missing or too many.
"""

import re
from pathlib import Path

import numpy as np

from poseviewer.files.mesh.obj import read_table
from poseviewer.files.mesh.parts import Part, check_indices
from poseviewer.files.mesh.polygons import polygon_corners

STL_HEADER = 84
ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.MULTILINE | re.IGNORECASE)
LONGEST_NAME = 1000
"""Bytes of a text file's first and last lines."""
OFF_HEADER = re.compile(r"\s*C?OFF\s+(\d+)\s+(\d+)(\s+\d+)?\s*\n", re.ASCII)
COMMENT = re.compile(r"#[^\n]*")


def read_stl(path: Path) -> tuple[list[Part], list[str]]:
    """The one part of an STL file, and a note where its length is not what its header says."""
    data, notes = path.read_bytes(), []
    promised = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little")
    held = max(len(data) - STL_HEADER, 0) // ROW.itemsize
    is_text = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:LONGEST_NAME]
    if is_text and STL_HEADER + promised * ROW.itemsize != len(data):
        corners = np.array(VERTEX.findall(data)).astype(float)
        if len(corners) % 3 or b"endsolid" not in data[-LONGEST_NAME:]:
            raise ValueError("it is cut short")
    else:
        if promised > held:
            raise ValueError(f"it holds {held:,} of the {promised:,} triangles that it promises")
        if promised != held:
            notes.append(f"The file promises {promised:,} triangles, and holds {held:,}.")
        count = promised or held
        corners = np.frombuffer(data, ROW, count, STL_HEADER)["corners"].astype(float)
    vertices = corners.reshape(-1, 3)
    return [Part("", vertices, np.arange(len(vertices)).reshape(-1, 3))], notes


def read_off(path: Path) -> tuple[list[Part], list[str]]:
    """The one part of an OFF file (colours are left out), and no notes."""
    text = COMMENT.sub("", path.read_text("ascii", "replace"))
    header = OFF_HEADER.match(text)
    if header is None:
        raise ValueError("no OFF header")
    vertices, faces = int(header[1]), int(header[2])
    lines = [line for line in text[header.end() :].splitlines() if line.strip()]
    polygons = [line.split() for line in lines[vertices:]]
    counts = np.array([int(words[0]) for words in polygons], dtype=np.int64)
    corners = [words[1 : n + 1] for words, n in zip(polygons, counts, strict=True)]
    if len(lines) != vertices + faces or [len(words) for words in corners] != counts.tolist():
        raise ValueError(f"not the {vertices:,} vertices and {faces:,} faces that it promises")
    indices = np.array([word for words in corners for word in words], dtype=np.int64)
    points = read_table(lines[:vertices], 3)
    check_indices(indices, len(points))
    corners = polygon_corners(counts, points[indices])
    return [Part("", points, indices[corners])], []
