"""OFF (http://www.geomview.org/docs/html/OFF.html): vertices and polygons in text."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseviewer.files.mesh.obj import read_table
from poseviewer.files.mesh.parts import ModelParts, Part, check_indices, colours_from_numbers
from poseviewer.files.mesh.polygons import polygon_corners

HEADER = re.compile(
    r"\s*+(?:(?:ST)?(?P<colours>C)?(?P<normals>N)?(?P<other>4?n?)OFF(?P<binary>\s++BINARY)?)?"
    r"\s*+(\d++)\s++(\d++)([^\S\n]++\d++)?[^\S\n]*+\n", re.ASCII
)  # fmt: skip
COMMENT = re.compile(r"#[^\n]*")


def read_off(path: Path) -> ModelParts:
    """The one part of an OFF file, coloured by its vertices, or else by its faces, and notes."""
    text = COMMENT.sub("", path.read_text("ascii", "replace").lstrip("\ufffd"))
    header, notes = HEADER.match(text), list[str]()
    if header is None or header["other"] or header["binary"]:
        raise ValueError("no OFF header of three dimensions in text")
    vertices, faces = int(header[5]), int(header[6])
    lines = [line for line in text[header.end() :].splitlines() if line.strip()]
    polygons = [line.split() for line in lines[vertices:]]
    counts = np.array([int(words[0]) for words in polygons], dtype=np.int64)
    corners = [words[1 : n + 1] for words, n in zip(polygons, counts, strict=True)]
    if len(lines) != vertices + faces or [len(words) for words in corners] != counts.tolist():
        raise ValueError(f"not the {vertices:,} vertices and {faces:,} faces that it promises")
    indices = np.array([word for words in corners for word in words], dtype=np.int64)
    points, first = read_table(lines[:vertices], 3), 6 if header["normals"] else 3
    check_indices(indices, len(points))
    part = Part("", points, indices[polygon_corners(counts, points[indices])])
    if header["normals"]:
        part = replace(part, normals=read_table(lines[:vertices], 6)[:, 3:])
    if min((len(line.split()) for line in lines[:vertices]), default=0) >= first + 3:
        rgb = read_table(lines[:vertices], first + 3)[:, first:]
        if header["colours"] or np.all(rgb >= 0.0):
            return ModelParts([replace(part, colours=colours_from_numbers(rgb, notes))], notes)
        notes.append("Columns behind x y z, left out.")
    of_faces = [words[n + 1 : n + 4] for words, n in zip(polygons, counts, strict=True)]
    if of_faces and all(len(words) == 3 for words in of_faces):
        rgb = np.repeat(np.array(of_faces, dtype=float), 3 * np.maximum(counts - 2, 0), axis=0)
        part = replace(part.corners_of(slice(None)), colours=colours_from_numbers(rgb, notes))
    elif any(of_faces):
        notes.append("Colours of some faces, or by their number in a colour map, left out.")
    return ModelParts([part], notes)
