"""OFF: counts, then a line for each vertex and one for each face (as Geomview has it).

Read here rather than by trimesh, which says nothing of lines that are missing or too many.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.obj import read_table
from poseviewer.files.mesh.parts import Part, fan_corners, no_faces

HEADER = re.compile(r"\s*C?OFF\s+(\d+)\s+(\d+)(\s+\d+)?\s*\n", re.ASCII)
COMMENT = re.compile(r"#[^\n]*")
LONGEST_HEADER = 100_000
"""Bytes of it and the comments before and in it."""


def read_off(path: Path) -> tuple[list[Part], list[str]]:
    """The one part of an OFF file (colours are left out), and no notes."""
    with path.open("rb") as file:
        start = file.read(LONGEST_HEADER)
        found = HEADER.match(COMMENT.sub("", start.decode("ascii", "replace")))
        if found is None:
            raise MeshFileError(
                f"{path.name}: no OFF header; is it an OFF file in text? Export it again."
            )
        vertices, faces = int(found[1]), int(found[2])
        text = COMMENT.sub("", (start + file.read()).decode("ascii", "replace"))
    lines = [line for line in text[found.end() :].splitlines() if line.strip()]
    if len(lines) != vertices + faces:
        raise MeshFileError(
            f"{path.name}: {len(lines):,} lines of {vertices:,} vertices and {faces:,} faces; it "
            "is damaged or cut short, export it again."
        )
    points = read_table(path.name, "vertex", lines[:vertices], 3)
    counts = np.zeros(faces, dtype=np.int64)
    corners: list[int] = []
    for number, line in enumerate(lines[vertices:]):
        words = line.split()
        try:
            counts[number] = count = int(words[0])
            corners += map(int, words[1 : count + 1])
        except (ValueError, OverflowError):
            count = -1
        if not 0 <= count < len(words):
            raise MeshFileError(
                f"{path.name}: the face {line.strip()[:60]!r} makes no sense; it is damaged or "
                "cut short, export it again."
            )
    if not faces:
        return no_faces(points), []
    return [Part("", points, np.array(corners)[fan_corners(counts)])], []
