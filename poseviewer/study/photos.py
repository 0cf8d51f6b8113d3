"""The photos of the study, each with its true pose: drawn once, then kept beside the trials."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import RendererUnavailableError
from poseviewer.files.photo.load import save_image
from poseviewer.files.pose.file import PoseRecord, load_pose, save_pose
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl.renderer import opengl_unavailable_reason
from poseviewer.study.cycles.photographer import CyclesPhotographer
from poseviewer.study.cycles.stage import upright
from poseviewer.study.deviations import make_seed
from poseviewer.study.light import Lighting, random_lighting
from poseviewer.study.synthetic import Photographer, PhotoQuality
from poseviewer.study.traced import GREYS as TRACED_GREYS
from poseviewer.study.traced import draw_traced, random_scene
from poseviewer.study.views import random_view
from poseviewer.vehicle.keypoints import VehicleKeypoints

Kind = Literal[
    "plain", "grey", "background",
    "plain-traced", "grey-traced", "background-traced",
    "photo-parallel", "photo-perspective",
]  # fmt: skip
KINDS: dict[Kind, str] = {
    "plain": "synthetic, plain black ground",
    "grey": "synthetic, plain grey ground",
    "background": "synthetic, real background",
    "plain-traced": "path-traced, plain black ground",
    "grey-traced": "path-traced, plain grey ground",
    "background-traced": "path-traced, real background",
    "photo-parallel": "photo, parallel",
    "photo-perspective": "photo, perspective, 7 numbers",
}
"""What each is called in tables. The first three are drawn here by OpenGL, the next three by
Blender; the others are taken as they are.

``plain`` is black, as the paper's unclipped loss has it: there the ground looks like a black part
of the model. ``grey`` shows what becomes of that on another ground."""
DRAWN = ("plain", "grey", "background")
TRACED = ("plain-traced", "grey-traced", "background-traced")

GREYS = (0.1, 0.9)
"""From which a ``grey`` ground, of one grey all over, is drawn."""
QUALITY = PhotoQuality(blur_px=0.7, noise=2.0)


@dataclass(frozen=True, slots=True, eq=False)
class StudyPhoto:
    """A photo that starts are drawn on."""

    kind: Kind
    index: int
    photo: Path
    model: Path
    truth: Pose
    """What fits are judged against."""
    centre: Pose
    """What starts are drawn about: the truth, or the nearest pose that the fit's camera can have.
    """
    accuracy_percent: float
    """How far the truth itself may be off, as a share of the model's size in the photo."""

    @property
    def free_focal(self) -> bool:
        """Whether the focal length is one of the numbers."""
        return self.kind == "photo-perspective"

    def is_found(self, error_px: float, error_percent: float) -> bool:
        """Within 1 px where the photo is drawn here, else within the truth's accuracy + 1 %."""
        if self.kind in DRAWN:
            return error_px < 1.0
        return error_percent < self.accuracy_percent + 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """What synthetic photos are made of."""

    model: Path
    mesh: Mesh
    keypoints: VehicleKeypoints
    size: tuple[int, int]
    parallel: bool
    backgrounds: Sequence[NDArray[np.uint8]]
    seed: int


def make_photos(
    studio: Studio, kind: Kind, count: int, folder: Path, tell: Callable[[str], None]
) -> Iterator[StudyPhoto]:
    """``count`` photos in ``folder``; those that are there already are taken from it.

    Views, lights and backgrounds are random, the same for the same seed.

    Raises:
        RendererUnavailableError: there are photos to be drawn, and no OpenGL, or no Blender.
        PhotoFileError: the folder cannot be written to.
    """
    for index in range(count):
        photo, truth = folder / f"{kind}-{index}.png", folder / f"{kind}-{index}.json"
        # The pose is written last: where it is, the photo is whole.
        if not truth.exists():
            pose, pixels = _drawn(studio, kind, index, tell)
            save_image(photo, pixels)
            save_pose(truth, PoseRecord(pose))
        pose = load_pose(truth, *studio.size).pose
        yield StudyPhoto(kind, index, photo, studio.model, pose, pose, 0.0)


def _drawn(
    studio: Studio, kind: Kind, index: int, tell: Callable[[str], None]
) -> tuple[Pose, NDArray[np.uint8]]:
    seed = make_seed(studio.seed, kind, index)
    random = np.random.default_rng(seed)
    pose = random_view(studio.mesh, studio.keypoints, studio.size, studio.parallel, random)
    if kind in TRACED:
        behind = _behind(studio, kind, index, TRACED_GREYS, random)
        # Every other vehicle has the model's own paint.
        scene = random_scene(pose, upright(studio.keypoints), behind, index % 2 == 1, random)
        photographer = CyclesPhotographer(studio.mesh, studio.keypoints)
        return pose, draw_traced(photographer, pose, scene, tell)
    lighting = random_lighting(random)
    behind = _behind(studio, kind, index, GREYS, random)
    return pose, _rasterised(studio.mesh, pose, lighting, behind, seed)


def _rasterised(
    mesh: Mesh, pose: Pose, lighting: Lighting, behind: NDArray, seed: int
) -> NDArray[np.uint8]:
    if reason := opengl_unavailable_reason():
        raise RendererUnavailableError(f"synthetic photos are drawn by OpenGL: {reason}")
    photographer = Photographer(mesh, "phong")
    try:
        return photographer.photograph(pose, lighting, behind, QUALITY, shadows=True, seed=seed)
    finally:
        photographer.close()


def _behind(
    studio: Studio, kind: Kind, index: int, greys: tuple[float, float], random: np.random.Generator
) -> NDArray:
    """(3,) RGB in [0, 1], or (h, w, 3) uint8."""
    if kind.startswith("plain"):
        return np.zeros(3)
    if kind.startswith("grey"):
        return np.full(3, random.uniform(*greys))
    return _cut(studio.backgrounds[index % len(studio.backgrounds)], studio.size, random)


def _cut(
    picture: NDArray[np.uint8], size: tuple[int, int], random: np.random.Generator
) -> NDArray[np.uint8]:
    """A piece of a picture in the shape of a photo of that size, mirrored now and then."""
    height, width = picture.shape[:2]
    share = random.uniform(0.8, 1.0) * min(width / size[0], height / size[1])
    wide, high = max(1, int(share * size[0])), max(1, int(share * size[1]))
    left = int(random.integers(width - wide + 1))
    top = int(random.integers(height - high + 1))
    piece = picture[top : top + high, left : left + wide]
    return piece[:, ::-1] if random.random() < 0.5 else piece
