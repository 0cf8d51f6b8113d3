"""3MF (https://3mf.io/spec): triangles and places by trimesh, which passes over colours."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.parts import GREY, ModelParts, Part

METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 0.01, "inch": 0.0254, "foot": 0.3048,
          "meter": 1.0}  # fmt: skip
READ = ("/core/", "/material/", "/production/")
"""Parts of the names of extensions that are read."""
LOST = {
    "texture2dgroup": "textures", "compositematerials": "mixed materials",
    "multiproperties": "layers of materials", "beamlattice": "beams",
}  # fmt: skip
"""Elements that are not read, and what is lost with them."""
XML = etree.XMLParser(resolve_entities=False, no_network=True)


def read_3mf(path: Path) -> ModelParts:
    """Read a part for each object that the file builds, as often as it does.

    Raises:
        MeshFileError: an extension is needed that is not read, or objects are in further files.
        ValueError: the file is damaged.
    """
    from trimesh.exchange.threemf import load_3MF

    with ZipFile(path) as archive:
        names = archive.namelist()
        starts = [name for name in names if name.lower().endswith("3d/3dmodel.model")]
        if len(starts) != 1:
            raise ValueError("it has no 3D/3dmodel.model")
        root = etree.fromstring(archive.read(starts[0]), XML)
    for prefix in root.get("requiredextensions", "").split():
        if not any(part in (space := root.nsmap.get(prefix, prefix)) for part in READ):
            wanted = "not read here; export it without, or as GLB"
            raise MeshFileError(f"{path.name}: needs {space[:120]}, {wanted}.")
    objects, inside = dict[str, Any](), ""
    for element in root.iter("{*}object", "{*}mesh", "{*}component", "{*}item"):
        tag, number = etree.QName(element).localname, element.get("objectid")
        if tag == "object":
            inside = element.get("id")
            objects[inside] = element
        elif tag == "mesh" and element.find("{*}triangles") is None:
            raise ValueError("an object has no triangles")
        elif any(key.endswith("}path") for key in element.attrib):
            found = "its objects are in several files of the package, not read here"
            raise MeshFileError(f"{path.name}: {found}; export them as one, or as STL or GLB.")
        elif tag != "mesh" and (number not in objects or (tag, number) == ("component", inside)):
            raise ValueError(f"object {number} is not there before it is used")
    lost = [words for tag, words in LOST.items() if root.find(f".//{{*}}{tag}") is not None]
    lost += ["a slicer's settings"] if any(name.endswith(".config") for name in names) else []
    with path.open("rb") as file:
        loaded = load_3MF(file, postprocess=False)
    solid = (element for element in objects.values() if element.find("{*}mesh") is not None)
    elements, parts = dict(zip(loaded["geometry"], solid, strict=True)), []
    materials = root.iter("{*}basematerials", "{*}colorgroup")
    groups = {material.get("id"): _rgb(material) for material in materials}
    for place in loaded["graph"]:
        if (element := elements.get(place["geometry"])) is None:
            continue
        mesh = loaded["geometry"][place["geometry"]]
        part = Part(element.get("name", ""), mesh["vertices"], mesh["faces"])
        colours = _colours_of(element, groups) if groups else np.full(3, np.nan)
        if not np.all(np.isnan(colours)):
            colours = np.where(np.isnan(colours), GREY, colours)
            part = replace(part.corners_of(slice(None)), colours=colours)
        parts.append(part.transform(place["matrix"]))
    notes = [f"Not read, left out: {words}." for words in lost]
    return ModelParts(parts, notes, METRES[root.get("unit", "millimeter")])


def _rgb(group: Any) -> NDArray[np.float64]:
    values = [entry.get("displaycolor") or entry.get("color") for entry in group]
    return np.array([list(bytes.fromhex(value[1:7])) for value in values]).reshape(-1, 3) / 255.0


def _colours_of(element: Any, groups: dict[str, NDArray]) -> NDArray[np.float64]:
    """RGB of the corners of an object's triangles (3 F, 3), NaN where it says none."""
    rows = []
    for triangle in element.iter("{*}triangle"):
        group = groups.get(triangle.get("pid", element.get("pid")))
        first = triangle.get("p1", element.get("pindex", "0"))
        indices = (int(triangle.get(name, first)) for name in ("p1", "p2", "p3"))
        rows += [(np.nan,) * 3] * 3 if group is None else [group[index] for index in indices]
    return np.array(rows, dtype=float).reshape(-1, 3)
