"""COLLADA (https://www.khronos.org/collada/) by pycollada, the parser that trimesh has for it.

The walk through what pycollada gives is ours: trimesh's cuts concave polygons wrong, and passes
over names of nodes, colours beside a material, skins, and pictures that are not there.
"""

from dataclasses import replace
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
"""Elements that change the shape and are not read."""
LOST = {"animation": "animations", "lines": "lines", "linestrips": "lines"}
"""Elements that are left out with a note."""
IDLE = ("library_animations", "library_cameras", "library_lights", "library_controllers",
        "instance_camera", "instance_light", "extra")  # fmt: skip
"""Elements that say nothing of shape and base colour."""
TURNS, SHAPES = ("skew", "lookat"), ("{*}instance_geometry", "{*}instance_node")
"""Elements that only matter in a node with one of others."""


def read_dae(path: Path) -> p.ModelParts:
    """A part for each group of polygons of each node of the scene, and notes.

    Raises:
        ValueError: The file is damaged, or has what is not read and changes the shape.
    """
    try:
        import collada
        from collada.common import DaeUnsupportedError
    except ImportError:
        wanted = "DAE files need pycollada; pip install 'poseviewer[dae]'"
        raise MeshFileError(f"{path.name}: {wanted}.") from None
    root = etree.parse(str(path), XML).getroot()
    notes = _without_what_is_not_read(root)
    source = BytesIO(etree.tostring(root))
    document: Any = collada.Collada(source, ignore=[DaeUnsupportedError])
    notes += [f"Not read, left out: {error.msg}." for error in document.errors]
    if document.scene is None:
        raise ValueError("it has no scene")
    pictures = (_picture(_look(material.effect)) for material in document.materials)
    textures = p.load_textures(path.parent, filter(None, pictures), notes)
    parts: list[p.Part] = []
    roots = reversed(document.scene.nodes)
    waiting: list[tuple[Any, NDArray, str]] = [(node, np.eye(4), "") for node in roots]
    while waiting:
        node, matrix, name = waiting.pop()
        if not isinstance(node, collada.scene.GeometryNode):
            name, matrix = getattr(node, "node", node).name or name, matrix @ node.matrix
            waiting += [(child, matrix, name) for child in reversed(node.children)]
            continue
        bound = {material.symbol: material for material in node.materials}
        for primitive in (each for each in node.geometry.primitives if each.vertex is not None):
            material = bound.get(primitive.material)
            parts.append(_part(name, primitive, material, textures, notes).moved(matrix))
    asset = document.assetInfo
    return p.ModelParts(parts, notes, asset.unitmeter, asset.upaxis == "Y_UP")


def _without_what_is_not_read(root: Any) -> list[str]:
    """Take out of a document what is not read; returns notes of it."""
    notes = []
    for element in list(root.iter()):
        tag, above = etree.QName(element).localname, element.getparent()
        if tag in REFUSED and (tag not in TURNS or next(above.iter(*SHAPES), None) is not None):
            raise ValueError(f"it has {REFUSED[tag]}, not read here")
        if tag in LOST:
            notes.append(f"Not read, left out: {LOST[tag]}.")
        if tag in (*LOST, *IDLE, *REFUSED):
            above.remove(element)
    for accessor in root.iter("{*}accessor"):
        layout = accessor.get("stride", "1"), accessor.get("offset", "0")
        if accessor.get("count") != "0" and layout != (str(len(accessor)), "0"):
            raise ValueError("numbers between those of its accessors, not read here")
    return notes


def _part(
    name: str, primitive: Any, material: Any, textures: dict[str, NDArray], notes: list[str]
) -> p.Part:
    """The part of polygons with the material that is bound to them, or None."""
    index = primitive.index.reshape(-1, primitive.nindices)

    def values(kind: str, wanted: str | None = None) -> Any:
        """(C, k): values of the corners, those of the wanted set of several; None: none."""
        inputs = primitive.sources.get(kind)
        if not inputs:
            return None
        offset, *_, source = next((each for each in inputs if each[3] == wanted), inputs[0])
        p.check_indices(index[:, offset], len(source.data), kind)
        return source.data[index[:, offset]].astype(float)

    points = values("VERTEX")
    faces = np.arange(len(points)).reshape(-1, 3)
    if hasattr(primitive, "vcounts"):
        if primitive.vcounts.sum() != len(points):
            raise ValueError("polygons have other corners than they count")
        faces = polygon_corners(primitive.vcounts, points)
    part, colours = p.Part(name, points, faces, values("NORMAL")), values("COLOR")
    look: Any = None if material is None else _look(material.target.effect)
    if material is not None and (texture := textures.get(_picture(look))) is not None:
        sets = {semantic: number for semantic, _, number in material.inputs}
        uvs = values("TEXCOORD", sets.get(look.texcoord))
        if uvs is not None:
            return replace(part, uvs=uvs[:, :2], texture=texture)
    if colours is not None:
        return replace(part, colours=p.colours_from_numbers(colours[:, :3], notes))
    if look is None or _picture(look):
        return part
    return replace(part, colours=np.clip(np.resize(look, 3).astype(float), 0.0, 1.0))


def _look(effect: Any) -> Any:
    """What gives an effect its base colour: RGBA, a texture's map, or None."""
    is_constant = effect.diffuse is None and effect.shadingtype == "constant"
    return effect.emission if is_constant else effect.diffuse


def _picture(look: Any) -> str:
    """The file that a texture's map names, or ""."""
    return unquote(look.sampler.surface.image.path.strip()) if hasattr(look, "sampler") else ""
