"""COLLADA (https://www.khronos.org/collada/) by pycollada.

trimesh's walk through it cuts concave polygons wrong, and passes over names of nodes, colours
beside a material, skins, and pictures that are not there.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh import parts as p
from poseviewer.files.mesh.polygons import polygon_corners

XML = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True,
                      remove_comments=True, remove_pis=True)  # fmt: skip
REFUSED = {"instance_controller": "a skin or morph", "ph": "polygons with holes",
           "skew": "a skewed node", "lookat": "a node turned by lookat"}  # fmt: skip
"""Elements that change the shape, and are not read."""
LOST = {"animation": "animations", "lines": "lines", "linestrips": "lines"}
IDLE = ("library_animations", "library_cameras", "library_lights", "library_controllers",
        "instance_camera", "instance_light", "extra")  # fmt: skip
"""Elements that say nothing of shape and base colour."""


def read_dae(path: Path) -> p.ModelParts:
    """Read a part for each group of polygons of each node of the scene.

    Raises:
        MeshFileError: the file has what is not read and changes the shape.
        ValueError: the file is damaged.
    """
    try:
        import collada
        from collada.common import DaeUnsupportedError
    except ImportError:
        wanted = "DAE files need pycollada; pip install 'poseviewer[dae]'"
        raise MeshFileError(f"{path.name}: {wanted}.") from None
    root = etree.parse(str(path), XML).getroot()
    notes = _prune(root, path.name)
    document: Any = collada.Collada(BytesIO(etree.tostring(root)), ignore=[DaeUnsupportedError])
    notes += [f"Not read, left out: {error.msg}." for error in document.errors]
    if document.scene is None:
        raise ValueError("it has no scene")
    pictures = (_picture(material.effect.diffuse) for material in document.materials)
    textures = p.load_textures(path.parent, filter(None, pictures), notes)
    wanted, others = _count_geometries(root, document.scene.id)
    p.check_count(path.name, "parts", wanted, p.MAX_PARTS)
    if others:
        notes.append(f"Geometries that the file's scene does not show, left out: {others:,}.")
    found = 0

    def place_parts() -> Iterator[p.Part]:
        nonlocal found
        waiting: list[tuple[Any, NDArray, str]] = [(n, np.eye(4), "") for n in document.scene.nodes]
        while waiting:
            node, matrix, name = waiting.pop()
            if not isinstance(node, collada.scene.GeometryNode):
                name, matrix = getattr(node, "node", node).name or name, matrix @ node.matrix
                waiting += [(child, matrix, name) for child in node.children]
                continue
            found += 1
            bound = {material.symbol: material for material in node.materials}
            for primitive in (each for each in node.geometry.primitives if each.vertex is not None):
                part = _part(primitive, bound.get(primitive.material), textures, notes)
                yield replace(part, name=name).transform(matrix)

    parts = p.take_parts(path.name, path.stat().st_size, place_parts())
    if found != wanted:
        raise ValueError(f"its scene shows {wanted:,} geometries, its nodes {found:,}")
    asset = document.assetInfo
    return p.ModelParts(parts, notes, asset.unitmeter, asset.upaxis == "Y_UP")


def _count_geometries(root: Any, scene: str) -> tuple[int, int]:
    """Count what the scene of an id shows, over all instances of nodes, and what others show."""
    nodes = {node.get("id"): node for node in root.iter("{*}node")}

    @cache
    def count(element: Any) -> int:
        total = 0
        for own in element:
            tag = etree.QName(own).localname
            total += tag == "instance_geometry"
            total += count(own) if tag == "node" else 0
            total += count(nodes[own.get("url")[1:]]) if tag == "instance_node" else 0
        return total

    scenes = list(root.iter("{*}visual_scene"))
    shown = sum(count(own) for own in scenes if own.get("id") == scene)
    return shown, sum(map(count, scenes)) - shown


def _prune(root: Any, name: str) -> list[str]:
    """Take out of a document what is not read; returns notes of it."""
    notes, shapes = [], ("{*}instance_geometry", "{*}instance_node")
    for element in list(root.iter()):
        tag, above = etree.QName(element).localname, element.getparent()
        if tag in REFUSED and (
            tag not in ("skew", "lookat") or next(above.iter(*shapes), None) is not None
        ):
            raise MeshFileError(f"{name}: it has {REFUSED[tag]}, not read here; export it as GLB.")
        if tag in LOST:
            notes.append(f"Not read, left out: {LOST[tag]}.")
        if tag in (*LOST, *IDLE, *REFUSED):
            above.remove(element)
    for accessor in root.iter("{*}accessor"):
        layout = accessor.get("stride", "1"), accessor.get("offset", "0")
        if accessor.get("count") != "0" and layout != (str(len(accessor)), "0"):
            raise ValueError("numbers between those of its accessors, not read here")
    return notes


def _part(primitive: Any, material: Any, textures: dict[str, NDArray], notes: list[str]) -> p.Part:
    index = primitive.index.reshape(-1, primitive.nindices)

    def values(kind: str, wanted: str | None = None) -> Any:
        """Return values (C, k) of the corners, those of the wanted set, or None."""
        inputs = primitive.sources.get(kind)
        if not inputs:
            return None
        offset, *_, source = next((each for each in inputs if each[3] == wanted), inputs[0])
        p.check_indices(index[:, offset], len(source.data), kind)
        return source.data[index[:, offset]].astype(float)

    points, colours = values("VERTEX"), values("COLOR")
    counts = getattr(primitive, "vcounts", np.full(len(points) // 3, 3))
    if counts.sum() != len(points):
        raise ValueError("polygons have other corners than they count")
    part = p.Part("", points, polygon_corners(counts, points), values("NORMAL"))
    look: Any = None if material is None else material.target.effect.diffuse
    if material is not None and (texture := textures.get(_picture(look))) is not None:
        sets = {semantic: number for semantic, _, number in material.inputs}
        uvs = values("TEXCOORD", sets.get(look.texcoord))
        if uvs is not None:
            wraps = {e.text for e in look.sampler.xmlnode.iter("{*}wrap_s", "{*}wrap_t")}
            p.note_edges(uvs[:, :2], [wraps <= {"WRAP"}] * 2, notes)
            return replace(part, uvs=uvs[:, :2], texture=texture)
    if colours is not None:
        return replace(part, colours=p.colours_from_numbers(colours[:, :3], notes))
    if look is None or _picture(look):
        return part
    return replace(part, colours=np.clip(np.resize(look, 3).astype(float), 0.0, 1.0))


def _picture(look: Any) -> str:
    return unquote(look.sampler.surface.image.path.strip()) if hasattr(look, "sampler") else ""
