"""Load a model file as a Mesh."""

import math
import subprocess
from collections.abc import Callable
from dataclasses import replace
from itertools import starmap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError, printable
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, quiet_libraries
from poseviewer.files.mesh.dae import read_dae
from poseviewer.files.mesh.gltf import read_gltf
from poseviewer.files.mesh.obj import read_obj
from poseviewer.files.mesh.off import read_off
from poseviewer.files.mesh.parts import ModelParts, Part, load_textures, take_parts
from poseviewer.files.mesh.ply import read_ply
from poseviewer.files.mesh.size import METRES
from poseviewer.files.mesh.stl import read_stl
from poseviewer.files.mesh.surface import as_mesh
from poseviewer.files.mesh.three_mf import read_3mf
from poseviewer.geometry.mesh import Mesh
from poseviewer.processes import call_in_subprocess

DEADLINE_S = 20.0
"""Time that a reader may take for a small file."""
BYTES_PER_S = 250_000
"""Bytes of a file that give its reader a second more."""
MAX_MEMORY_BYTES = 4_000_000_000
"""Memory that a reader may take for a small file."""
MEMORY_PER_BYTE = 40
"""Memory that a reader may take for each byte of the file besides."""
FINE_ANGLE = 0.2
"""Largest angle (rad) between triangles of a curved face."""


def load_mesh(path: str | Path) -> Mesh:
    """Load the model in a file of one of the formats of ``READERS``.

    Reflectance is that of textures, vertex colours or material colours. Normals are the file's, or
    computed where these make no sense. ``notes`` say what was mended or left out.
    """
    path, known = Path(path), ", ".join(READERS)
    ending = path.suffix.lower()
    kind = f"{ending[1:].upper()} file" if ending in READERS else f"model file ({known})"
    file = InputFile(path, [], MeshFileError, kind, MAX_DATA_BYTES)
    with file.naming_errors(), quiet_libraries():
        file.check_size()
        if ending not in READERS:
            found = f"unknown kind of model file {path.suffix!r}"
            wanted = "export it as GLB" if ending in ELSEWHERE else f"wanted one of {known}"
            wanted = "export it as STEP or GLB" if ending in (".iges", ".igs") else wanted
            raise file.error(found, wanted)
        parts, notes, metres, y_up = READERS[ending](path)
        units = {round(math.log(length), 4): name for name, length in METRES.items()}
        unit = None
        if metres is not None and (unit := units.get(round(math.log(metres), 4))) is None:
            parts = [part.transform(np.diag([metres, metres, metres, 1.0])) for part in parts]
            notes.append(f"Lengths in units of {metres:g} m were made lengths in m.")
            unit = "m"
        return replace(as_mesh(printable(path.name), parts, notes), unit=unit, y_up=y_up)


def isolate(reader: Callable[[Path], ModelParts]) -> Callable[[Path], ModelParts]:
    """Run a reader, whose library can end the process, in one of its own, with bounds."""

    def read(path: Path) -> ModelParts:
        size = path.stat().st_size
        seconds, memory = DEADLINE_S + size / BYTES_PER_S, MAX_MEMORY_BYTES + MEMORY_PER_BYTE * size
        try:
            return call_in_subprocess(_read, reader, path, seconds=seconds, memory=memory)
        except subprocess.TimeoutExpired:
            found = f"its reader was not done after {seconds:.0f} s and was stopped"
        except subprocess.CalledProcessError:
            found = "its reader ended at it: damaged, or too large for the memory"
        raise MeshFileError(f"{path.name}: {found}; export it again, or as GLB.") from None

    return read


def _read(reader: Callable[[Path], ModelParts], path: Path) -> ModelParts:
    kind = f"{path.suffix[1:].upper()} file"
    with InputFile(path, [], MeshFileError, kind).naming_errors(), quiet_libraries():
        return reader(path)


def _read_3ds(path: Path) -> ModelParts:
    """Read by assimp (an extra: ``pip install 'poseviewer[3ds]'``), in the file's own axes."""
    try:
        import assimp_py
    except ImportError:
        wanted = "3DS files need assimp; pip install 'poseviewer[3ds]'"
        raise MeshFileError(f"{path.name}: {wanted}.") from None
    flags = assimp_py.Process_Triangulate | assimp_py.Process_JoinIdenticalVertices
    scene = assimp_py.import_file(str(path), flags)
    notes: list[str] = []
    names = [next(iter(paint.get("TEXTURES", {}).get(1, [])), "") for paint in scene.materials]
    textures = load_textures(path.parent, filter(None, names), notes)
    # Assimp's root turns the model y up; left out, so that a pose belongs to the file's own axes.
    root: Any = scene.root_node
    stack, places = [(root, np.eye(4))], list[tuple[int, str, NDArray]]()
    while stack:
        node, matrix = stack.pop()
        stack += [(child, matrix @ np.asarray(child.transformation)) for child in node.children]
        places += [(index, node.name, matrix) for index in node.mesh_indices]
    if alone := sorted(set(range(len(scene.meshes))) - {index for index, *_ in places}):
        notes.append(f"Objects that no node places, shown where they are drawn: {len(alone):,}.")
        places += [(index, scene.meshes[index].name, np.eye(4)) for index in alone]

    def place_part(index: int, name: str, matrix: NDArray) -> Part:
        mesh = scene.meshes[index]
        vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
        part = Part(name, vertices, np.array(mesh.indices, np.int64).reshape(-1, 3))
        texture = textures.get(names[mesh.material_index]) if mesh.texcoords else None
        diffuse = scene.materials[mesh.material_index].get("COLOR_DIFFUSE")
        if texture is not None:
            uvs = np.array(mesh.texcoords[0], dtype=float).reshape(len(vertices), -1)[:, :2]
            part = replace(part, uvs=uvs, texture=texture)
        elif diffuse is not None:
            part = replace(part, colours=np.asarray(diffuse)[:3])
        return part.transform(matrix)

    parts = take_parts(path.name, path.stat().st_size, starmap(place_part, places))
    return ModelParts(parts, notes)


def _read_step(path: Path) -> ModelParts:
    """Read by cascadio (an extra: ``pip install 'poseviewer[step]'``): OpenCASCADE, in m."""
    try:
        import cascadio  # pyright: ignore[reportMissingImports]
    except ImportError:
        wanted = "STEP files need cascadio; pip install 'poseviewer[step]'"
        raise MeshFileError(f"{path.name}: {wanted}.") from None
    with TemporaryDirectory() as folder:
        out = Path(folder, "m.glb")
        cascadio.step_to_glb(str(path), str(out), tol_relative=True, tol_angular=FINE_ANGLE)
        if not out.exists():
            raise MeshFileError(f"{path.name}: not a readable STEP file; export it again.")
        return read_gltf(out)._replace(y_up=False)


READERS: dict[str, Callable[[Path], ModelParts]] = {
    ".obj": read_obj, ".ply": read_ply, ".stl": read_stl, ".off": read_off,
    ".glb": read_gltf, ".gltf": read_gltf, ".3ds": isolate(_read_3ds), ".3mf": isolate(read_3mf),
    ".dae": isolate(read_dae), ".step": isolate(_read_step), ".stp": isolate(_read_step),
}  # fmt: skip
ELSEWHERE = (".fbx", ".usd", ".usda", ".usdc", ".usdz", ".blend", ".ifc", ".x", ".wrl", ".iges",
             ".igs")  # fmt: skip
"""Endings of models that other programs make GLB of."""
