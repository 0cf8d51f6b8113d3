"""3MF (https://3mf.io/spec).

trimesh passes over colours, and loses copies of what is built of components of components.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.parts import (
    GREY,
    MAX_PARTS,
    ModelParts,
    Part,
    check_count,
    check_indices,
    take_parts,
)

METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 0.01, "inch": 0.0254, "foot": 0.3048,
          "meter": 1.0}  # fmt: skip
READ = ("/core/", "/material/", "/production/")
"""Parts of the names of extensions that are read."""
LOST = {
    "texture2dgroup": "textures", "compositematerials": "mixed materials",
    "multiproperties": "layers of materials", "beamlattice": "beams",
}  # fmt: skip
"""Elements that are not read, and what is lost with them."""
MAX_XML_BYTES = 500_000_000
"""Bytes of the unpacked objects: their tree takes about ten times as many."""
BUILD = ""
"""Number, which no object has, of the list of what is built."""
XML = etree.XMLParser(resolve_entities=False, no_network=True)


def read_3mf(path: Path) -> ModelParts:
    """Read a part for each object that the file builds, as often as it does.

    Raises:
        MeshFileError: an extension is needed that is not read, objects are in further files, or
            there are too many of them.
        ValueError: the file is damaged.
    """
    with ZipFile(path) as archive:
        names = archive.namelist()
        starts = [name for name in names if name.lower().endswith("3d/3dmodel.model")]
        if len(starts) != 1:
            raise ValueError("it has no 3D/3dmodel.model")
        size = archive.getinfo(starts[0]).file_size
        check_count(path.name, "bytes unpacked", size, MAX_XML_BYTES)
        text = archive.read(starts[0])
    root = etree.fromstring(text, XML)
    for prefix in root.get("requiredextensions", "").split():
        if not any(part in (space := root.nsmap.get(prefix, prefix)) for part in READ):
            wanted = "not read here; export it without, or as GLB"
            raise MeshFileError(f"{path.name}: needs {space[:120]}, {wanted}.")
    objects, copies = _count_copies(root, path.name)
    lost = [words for tag, words in LOST.items() if root.find(f".//{{*}}{tag}") is not None]
    lost += ["a slicer's settings"] if any(name.endswith(".config") for name in names) else []
    materials = root.iter("{*}basematerials", "{*}colorgroup")
    groups = {material.get("id"): _rgb(material) for material in materials}
    meshes = {
        number: [_part(element, mesh, groups) for mesh in element.iter("{*}mesh")]
        for number, element in objects.items()
        if copies[number]
    }

    def place_parts() -> Iterator[Part]:
        waiting = [(BUILD, np.eye(4))]
        while waiting:
            number, above = waiting.pop()
            yield from (part.transform(above) for part in meshes.get(number, ()))
            inner = objects[number].iter("{*}item", "{*}component") if copies[number] else ()
            waiting.extend((own.get("objectid"), above @ _matrix(own)) for own in [*inner][::-1])

    parts = take_parts(path.name, len(text), place_parts())
    notes = [f"Not read, left out: {words}." for words in lost]
    return ModelParts(parts, notes, METRES[root.get("unit", "millimeter")])


def _count_copies(root: Any, name: str) -> tuple[dict[str, Any], Counter[str]]:
    """Objects by their numbers, the build by ``BUILD``, and how many meshes each shows."""
    objects, copies, inside = dict[str, Any](), Counter[str](), BUILD
    for element in root.iter("{*}object", "{*}build", "{*}mesh", "{*}component", "{*}item"):
        tag, number = etree.QName(element).localname, element.get("objectid")
        if tag in ("object", "build"):
            inside = element.get("id", BUILD)
            if inside in objects:
                raise ValueError(f"object {inside} is there twice")
            objects[inside] = element
        elif tag == "mesh" and element.find("{*}triangles") is None:
            raise ValueError("an object has no triangles")
        elif any(key.endswith("}path") for key in element.attrib):
            found = "its objects are in several files of the package, not read here"
            raise MeshFileError(f"{name}: {found}; export them as one, or as STL or GLB.")
        elif tag == "mesh":
            copies[inside] += 1
        elif number not in objects or number == inside:
            raise ValueError(f"object {number} is not there before it is used")
        else:
            check_count(name, "parts", copies[number], MAX_PARTS)
            copies[inside] += copies[number]
    check_count(name, "parts", copies[BUILD], MAX_PARTS)
    return objects, copies


def _matrix(element: Any) -> NDArray[np.float64]:
    """Matrix (4, 4) of an item or a component, whose file has its columns."""
    matrix = np.eye(4)
    if (text := element.get("transform")) is not None:
        matrix[:3] = np.array(text.split(), dtype=float).reshape(4, 3).T
    return matrix


def _part(element: Any, mesh: Any, groups: dict[str, NDArray]) -> Part:
    points = [[own.get(axis) for axis in "xyz"] for own in mesh.iterfind("{*}vertices/{*}vertex")]
    triangles = mesh.findall("{*}triangles/{*}triangle")
    faces = [[own.get(corner) for corner in ("v1", "v2", "v3")] for own in triangles]
    vertices = np.array(points, dtype=float).reshape(-1, 3)
    part = Part(element.get("name", ""), vertices, np.array(faces, np.int64).reshape(-1, 3))
    colours = _colours_of(element, triangles, groups) if groups else np.full(3, np.nan)
    if np.all(np.isnan(colours)):
        return part
    check_indices(part.faces, len(vertices))
    colours = np.where(np.isnan(colours), GREY, colours)
    return replace(part.corners_of(slice(None)), colours=colours)


def _rgb(group: Any) -> NDArray[np.float64]:
    values = [entry.get("displaycolor") or entry.get("color") for entry in group]
    return np.array([list(bytes.fromhex(value[1:7])) for value in values]).reshape(-1, 3) / 255.0


def _colours_of(
    element: Any, triangles: list[Any], groups: dict[str, NDArray]
) -> NDArray[np.float64]:
    """RGB of the corners of an object's triangles (3 F, 3), NaN where it says none."""
    rows = []
    for triangle in triangles:
        group = groups.get(triangle.get("pid", element.get("pid")))
        first = triangle.get("p1", element.get("pindex", "0"))
        indices = (int(triangle.get(name, first)) for name in ("p1", "p2", "p3"))
        rows += [(np.nan,) * 3] * 3 if group is None else [group[index] for index in indices]
    return np.array(rows, dtype=float).reshape(-1, 3)
