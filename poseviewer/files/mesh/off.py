"""OFF (http://www.geomview.org/docs/html/OFF.html): vertices and polygons in text."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.files.mesh.obj import read_table
from poseviewer.files.mesh.parts import GREY, ModelParts, Part, check_indices, colours_from_numbers
from poseviewer.files.mesh.polygons import polygon_corners

HEADER = re.compile(
    r"\s*(?:(?:ST)?(?P<colours>C)?(?P<normals>N)?(?P<other>4?n?)OFF(?P<binary>\s+BINARY)?)?"
    r"\s*(\d+)\s+(\d+)([^\S\n]+\d+)?[^\S\n]*\n", re.ASCII
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
    triangles = polygon_corners(counts, points[indices])
    part = Part("", points, indices[triangles])
    if header["normals"]:
        part = replace(part, normals=read_table(lines[:vertices], 6)[:, 3:])
    width = min((len(line.split()) for line in lines[:vertices]), default=0)
    if width >= first + 3:
        rgb = read_table(lines[:vertices], first + 3)[:, first:]
        if header["colours"] or np.all(rgb >= 0.0):
            return ModelParts([replace(part, colours=colours_from_numbers(rgb, notes))], notes)
        notes.append("Columns behind x y z, left out.")
    of_faces = [words[n + 1 : n + 4] for words, n in zip(polygons, counts, strict=True)]
    return ModelParts([_painted(part, of_faces, counts, notes)], notes)


def _painted(part: Part, of_faces: list[list[str]], counts: NDArray, notes: list[str]) -> Part:
    """The part in the colours of its polygons: RGB, or a colour map's number, which is not read."""
    has_some = np.array([len(words) == 3 for words in of_faces], bool)
    if any(len(words) in (1, 2) for words in of_faces):
        notes.append("Colours of faces by their number in a colour map, left out.")
    if not has_some.any():
        return part
    colours = np.full((len(counts), 3), GREY)
    rgb = np.array([words for words in of_faces if len(words) == 3], dtype=float)
    colours[has_some] = colours_from_numbers(rgb, notes)
    of_corners = np.repeat(colours, 3 * np.maximum(counts - 2, 0), axis=0)
    return replace(part.corners_of(slice(None)), colours=of_corners)
