"""Photographs with exactly known poses, path-traced by Blender in a process of its own."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.errors import RendererUnavailableError
from poseviewer.files.formats.blender_script import blender_view
from poseviewer.files.mesh.load import linear_from_srgb, srgb_from_linear
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.study.cycles.finishes import FINISHES, corner_colours, find_finishes
from poseviewer.study.cycles.stage import FURTHEST, make_stage
from poseviewer.study.synthetic import PhotoQuality, as_photographed
from poseviewer.vehicle.keypoints import VehicleKeypoints

VARIABLE = "POSEVIEWER_BLENDER_PYTHON"
SAMPLES = 48
GROUND_SIZE = 200.0
"""Of the ground that catches shadows, in the stage's metres."""
NEAREST = 0.01
"""Where Blender's view begins, in the stage's metres."""
Job = tuple[dict[str, Any], dict[str, NDArray]]
KNEE = 0.7
"""Light above it is compressed, as a camera does; below, the picture is as it was lit."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a vehicle is photographed in; directions are the stage's: z up, x ahead, y left."""

    sun_towards: FloatArray
    """(3,), towards the sun."""
    sun_light: FloatArray
    """(3,): linear RGB that a white surface facing the sun gains."""
    sun_angle: float
    """Diameter of the sun in the sky, radians: shadows are the softer the larger it is."""
    surroundings: NDArray[np.float32]
    """(h, w, 3) linear RGB, as ``surroundings`` makes it."""
    ground: FloatArray
    """(3,): linear RGB reflectance of the ground, as the paint mirrors it."""
    behind: NDArray[np.float32]
    """(3,) or (h, w, 3) display-encoded RGB in [0, 1]: what the shadow falls on, and all else."""
    paint: FloatArray | None = None
    """(3,): display-encoded RGB of another paint; None: the model's own."""
    exposure: float = 1.0
    seed: int = 0


class CyclesPhotographer:
    """A vehicle to be photographed in many poses."""

    def __init__(self, mesh: Mesh, keypoints: VehicleKeypoints) -> None:
        """Find out what its parts are made of.

        Raises:
            RendererUnavailableError: the model has textures, which are not drawn here.
        """
        if mesh.textures:
            raise RendererUnavailableError(
                "path-traced photos are of models with colours of vertices or materials; this one "
                "has textures: take --photographer opengl"
            )
        self.mesh, self.keypoints = mesh, keypoints
        self.finishes = find_finishes(mesh)

    def photograph(
        self, pose: Pose, scene: Scene, quality: PhotoQuality, samples: int = SAMPLES
    ) -> NDArray[np.uint8]:
        """(h, w, 3) RGB.

        Raises:
            RendererUnavailableError: there is no Blender.
        """
        picture = _run(*self._job(pose, scene, samples))
        behind = linear_from_srgb(np.asarray(scene.behind))
        light = scene.exposure * picture[..., :3] + (1.0 - picture[..., 3:]) * behind
        return as_photographed(srgb_from_linear(_compressed(light)), quality, scene.seed)

    def silhouette(self, pose: Pose, samples: int = 16) -> NDArray[np.float32]:
        """(h, w): the share of each pixel that the vehicle covers, in [0, 1].

        Raises:
            RendererUnavailableError: there is no Blender.
        """
        return _run(*self._job(pose, None, samples))[..., 3]

    def fingerprint(
        self, pose: Pose, scene: Scene, quality: PhotoQuality, samples: int = SAMPLES
    ) -> str:
        """The same for what gives the same photo: model, pose, scene, Blender, and this code.

        Raises:
            RendererUnavailableError: there is no Blender.
        """
        job, arrays = self._job(pose, scene, samples)
        digest = hashlib.sha256(json.dumps(job, sort_keys=True).encode())
        for part in (blender_version(), repr(quality), repr(scene.exposure), *_sources()):
            digest.update(part.encode())
        for array in (*arrays.values(), np.asarray(scene.behind)):
            digest.update(repr((array.shape, array.dtype.str)).encode())
            digest.update(np.ascontiguousarray(array).data)
        return digest.hexdigest()

    def _job(self, pose: Pose, scene: Scene | None, samples: int) -> Job:
        """What Blender is told; no scene: the silhouette alone."""
        stage = make_stage(self.mesh, self.keypoints, pose)
        view = blender_view(stage.pose, stage.mesh)
        view["clip"] = [NEAREST, FURTHEST]
        job: dict[str, Any] = {
            "finishes": list(FINISHES),
            "view": view,
            "silhouette": scene is None,
            "samples": samples,
            "seed": 0,
        }
        arrays: dict[str, NDArray] = {
            "vertices": stage.mesh.vertices,
            "normals": stage.mesh.normals,
            "faces": stage.mesh.faces,
            "face_finish": self.finishes,
            "corner_colours": corner_colours(self.mesh, self.finishes, scene and scene.paint),
        }
        if scene is not None:
            arrays["surroundings"] = scene.surroundings
            job |= _lit(scene)
        return job, arrays


@cache
def blender_version() -> str:
    """Of the ``bpy`` that draws.

    Raises:
        RendererUnavailableError: there is none.
    """
    result = _python("-c", "import bpy; print('bpy', bpy.app.version_string)")
    found = [line for line in result.stdout.splitlines() if line.startswith("bpy ")]
    if result.returncode or not found:
        raise RendererUnavailableError(
            f"path-traced photos are drawn by Blender: {_last_line(result)}; pip install "
            f"'poseviewer[photo]', or name a Python that has bpy in {VARIABLE}"
        )
    return found[-1].removeprefix("bpy ")


def _lit(scene: Scene) -> dict[str, Any]:
    brightest = float(np.max(scene.sun_light))
    return {
        "seed": scene.seed % 2**31,
        "sun": {
            "towards": _listed(scene.sun_towards),
            # A sun of strength pi lights a white surface that faces it to 1.
            "strength": np.pi * brightest,
            "colour": _listed(scene.sun_light / brightest),
            "angle": scene.sun_angle,
        },
        "ground": {"size": GROUND_SIZE, "colour": _listed(scene.ground)},
    }


def _listed(values: ArrayLike) -> list[float]:
    return np.asarray(values, dtype=float).tolist()


def _run(job: dict[str, Any], arrays: dict[str, NDArray]) -> NDArray[np.float32]:
    """(h, w, 4) linear RGB times alpha, and alpha."""
    blender_version()
    with tempfile.TemporaryDirectory(prefix="poseviewer-") as name:
        folder = Path(name)
        (folder / "job.json").write_text(json.dumps(job))
        np.savez(folder / "arrays.npz", **arrays)  # type: ignore[arg-type]
        result = _python("-m", "blender", name)
        picture = folder / "picture.npy"
        if result.returncode or not picture.is_file():
            raise RendererUnavailableError(f"Blender drew no photo: {_last_line(result)}")
        return np.load(picture)


def _python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Python with ``bpy``; a process of its own, as it does not go with other libraries."""
    program = os.environ.get(VARIABLE) or sys.executable
    # Its own folder alone: our libraries are not that Python's.
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    try:
        return subprocess.run(
            [program, *arguments], env=environment, capture_output=True, text=True, check=False
        )
    except OSError as error:
        raise RendererUnavailableError(
            f"{program}: cannot be started ({error.strerror}); {VARIABLE} names a Python that has "
            "bpy"
        ) from None


def _last_line(result: subprocess.CompletedProcess[str]) -> str:
    lines = (result.stderr or result.stdout).strip().splitlines()
    return lines[-1] if lines else f"exit code {result.returncode}"


@cache
def _sources() -> tuple[str, ...]:
    """The code that makes a picture of a job."""
    folder = Path(__file__).parent
    found = [Path(__file__), *sorted((folder / "blender").glob("*.py"))]
    return tuple(path.read_text("utf-8") for path in found)


def _compressed(light: FloatArray) -> FloatArray:
    over = np.maximum(light - KNEE, 0.0) / (1.0 - KNEE)
    return np.where(light <= KNEE, light, KNEE + (1.0 - KNEE) * (1.0 - np.exp(-over)))
