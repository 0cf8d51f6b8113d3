"""OFF (http://www.geomview.org/docs/html/OFF.html): vertices and polygons in text."""

import re
from pathlib import Path

import numpy as np

from poseviewer.files.mesh.obj import read_table
from poseviewer.files.mesh.parts import ModelParts, Part, check_indices
from poseviewer.files.mesh.polygons import polygon_corners

OFF_HEADER = re.compile(r"\s*C?OFF\s+(\d+)\s+(\d+)(\s+\d+)?\s*\n", re.ASCII)
COMMENT = re.compile(r"#[^\n]*")


def read_off(path: Path) -> ModelParts:
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
    return ModelParts([Part("", points, indices[corners])], [])
