"""3DS files, by way of assimp (an extra: ``pip install 'poseviewer[3ds]'``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.part import Part, moved_part, refuse_if_huge
from poseviewer.files.mesh.texture import load_texture


def read_3ds(path: Path) -> tuple[list[Part], list[str]]:
    """The parts of a 3DS file in the file's own axes, and notes for the user.

    Raises:
        MeshFileError: assimp is not installed.
    """
    try:
        import assimp_py
    except ImportError:
        raise MeshFileError(
            f"{path.name}: 3DS files need assimp; pip install 'poseviewer[3ds]'."
        ) from None
    flags = assimp_py.Process_Triangulate | assimp_py.Process_JoinIdenticalVertices
    scene = assimp_py.import_file(str(path), flags)
    notes: list[str] = []
    parts: list[Part] = []
    shown = 0
    # Assimp's root turns the model y up; left out, so that a pose belongs to the file's own axes.
    root: Any = scene.root_node
    stack = [(root, np.eye(4))]
    while stack:
        node, matrix = stack.pop()
        stack += [(child, matrix @ np.asarray(child.transformation)) for child in node.children]
        for index in node.mesh_indices:
            shown += len(scene.meshes[index].indices) // 3
            refuse_if_huge(path.name, shown)  # nodes may show one mesh again and again
            part = _assimp_part(path, node.name, scene, scene.meshes[index], notes)
            parts.append(moved_part(part, matrix))
    return parts, notes


def _assimp_part(path: Path, name: str, scene: Any, mesh: Any, notes: list[str]) -> Part:
    vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
    faces = np.array(mesh.indices, dtype=np.int64).reshape(-1, 3)
    material = scene.materials[mesh.material_index]
    texture, uvs = None, None
    names = material.get("TEXTURES", {}).get(1)
    if names and mesh.texcoords:
        try:
            texture = load_texture(path.parent, names[0])
            uvs = np.array(mesh.texcoords[0], dtype=float).reshape(len(vertices), -1)[:, :2]
        except OSError as error:
            notes.append(f"Texture left out: {error}.")
    diffuse = material.get("COLOR_DIFFUSE")
    colours = None if diffuse is None or texture is not None else np.asarray(diffuse)[:3]
    return Part(name, vertices, faces, None, colours, uvs, texture)
