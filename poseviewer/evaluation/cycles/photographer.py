"""Photographs with exactly known poses, path-traced by Blender in a process of its own."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PhotoFileError, RendererUnavailableError
from poseviewer.evaluation.cycles.stage import (
    FINISHES,
    FURTHEST,
    Surroundings,
    corner_colours,
    find_finishes,
    make_stage,
)
from poseviewer.evaluation.synthetic import PhotoQuality, as_photographed
from poseviewer.files.formats.gltf import view_depths
from poseviewer.files.formats.scenes import blender_view
from poseviewer.files.mesh.load import linear_from_srgb, srgb_from_linear
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.state.folder import state_folder
from poseviewer.files.writing import make_folder
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.keypoints import VehicleKeypoints

VARIABLE = "POSEVIEWER_BLENDER_PYTHON"
SCRIPT = Path(__file__).with_name("blender.py")
SAMPLES = 48
"""Light paths per pixel at most."""
QUALITY = PhotoQuality(blur_px=0.5, noise=2.0)
CACHE = "traced"
"""Folder of path-traced photos in the user's state folder."""
GROUND_SIZE = 200.0
"""Of the ground that catches shadows, in the stage's metres."""
NEAREST = 0.01
"""Where Blender's view begins, in the stage's metres."""
Job = tuple[dict[str, Any], dict[str, NDArray]]
KNEE = 0.7
"""Light above it is compressed, as a camera does; below, the picture is as it was lit."""


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
        self, pose: Pose, scene: Surroundings, quality: PhotoQuality, samples: int = SAMPLES
    ) -> NDArray[np.uint8]:
        """(h, w, 3) RGB."""
        picture = _run(*self._job(pose, scene, samples))
        behind = linear_from_srgb(np.asarray(scene.behind))
        light = scene.exposure * picture[..., :3] + (1.0 - picture[..., 3:]) * behind
        return as_photographed(srgb_from_linear(_compressed(light)), quality, scene.seed)

    def silhouette(self, pose: Pose, samples: int = 16) -> NDArray[np.float32]:
        """(h, w): the share of each pixel that the vehicle covers, in [0, 1]."""
        return _run(*self._job(pose, None, samples))[..., 3]

    def fingerprint(
        self, pose: Pose, scene: Surroundings, quality: PhotoQuality, samples: int = SAMPLES
    ) -> str:
        """The same for what gives the same photo: model, pose, scene, Blender, and this code."""
        job, arrays = self._job(pose, scene, samples)
        sources = (path.read_text("utf-8") for path in (Path(__file__), SCRIPT))
        digest = hashlib.sha256(json.dumps(job, sort_keys=True).encode())
        for part in (blender_version(), repr(quality), repr(scene.exposure), *sources):
            digest.update(part.encode())
        for array in (*arrays.values(), np.asarray(scene.behind)):
            digest.update(repr((array.shape, array.dtype.str)).encode())
            digest.update(np.ascontiguousarray(array).data)
        return digest.hexdigest()

    def _job(self, pose: Pose, scene: Surroundings | None, samples: int) -> Job:
        """What Blender is told; no scene: the silhouette alone."""
        stage = make_stage(self.mesh, self.keypoints, pose)
        view = blender_view(stage.pose, view_depths(stage.pose, stage.mesh))
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
            brightest = float(np.max(scene.sun_light))
            job["seed"] = scene.seed % 2**31
            job["sun"] = {
                "towards": scene.sun_towards.tolist(),
                # A sun of strength pi lights a white surface that faces it to 1.
                "strength": np.pi * brightest,
                "colour": (scene.sun_light / brightest).tolist(),
                "angle": scene.sun_angle,
            }
            job["ground"] = {"size": GROUND_SIZE, "colour": scene.ground.tolist()}
        return job, arrays


def draw_traced(
    photographer: CyclesPhotographer, pose: Pose, scene: Surroundings, tell: Callable[[str], None]
) -> NDArray[np.uint8]:
    """The photo, (h, w, 3) RGB: from the cache, if one like it was drawn before."""
    folder = state_folder() / CACHE
    make_folder(folder, PhotoFileError)
    path = folder / f"{photographer.fingerprint(pose, scene, QUALITY)}.png"
    if path.is_file():
        return load_photo(path).as_rgb8(pose.camera.width, pose.camera.height)
    began = perf_counter()
    pixels = photographer.photograph(pose, scene, QUALITY)
    tell(f"a photo was path-traced in {perf_counter() - began:.0f} s")
    save_image(path, pixels)
    return pixels


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


def _run(job: dict[str, Any], arrays: dict[str, NDArray]) -> NDArray[np.float32]:
    """(h, w, 4) linear RGB times alpha, and alpha."""
    blender_version()
    with tempfile.TemporaryDirectory(prefix="poseviewer-") as name:
        folder = Path(name)
        (folder / "job.json").write_text(json.dumps(job))
        np.savez(folder / "arrays.npz", **arrays)  # type: ignore[arg-type]
        result = _python(str(SCRIPT), name)
        picture = folder / "picture.npy"
        if result.returncode or not picture.is_file():
            raise RendererUnavailableError(f"Blender drew no photo: {_last_line(result)}")
        return np.load(picture)


def _python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Python with ``bpy``; a process of its own, as it does not go with other libraries."""
    program = os.environ.get(VARIABLE) or sys.executable
    # Our libraries are not that Python's.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
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


def _compressed(light: FloatArray) -> FloatArray:
    over = np.maximum(light - KNEE, 0.0) / (1.0 - KNEE)
    return np.where(light <= KNEE, light, KNEE + (1.0 - KNEE) * (1.0 - np.exp(-over)))
