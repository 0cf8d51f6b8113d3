"""The photos of the study, each with its true pose: drawn once, or taken as they are."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import (
    PhotoFileError,
    RendererUnavailableError,
    SettingsError,
    SingularChartError,
)
from poseviewer.evaluation.real_cases import RealCase, load_cases
from poseviewer.evaluation.synthetic import Photographer, PhotoQuality, random_lighting
from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.fit.registration import LoadedModel
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.opengl.context import opengl_unavailable_reason
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_model
from poseviewer.vehicle.chart import VehicleChart, visible_side
from poseviewer.vehicle.keypoints import VehicleKeypoints

Kind = Literal["plain", "background", "photo-parallel", "photo-perspective"]
KINDS: dict[Kind, str] = {
    "plain": "synthetic, plain black ground",
    "background": "synthetic, real background",
    "photo-parallel": "photo, parallel",
    "photo-perspective": "photo, perspective, 7 numbers",
}
"""Labels in tables. The first two are drawn by OpenGL, the others are taken as they are.

``plain`` is black, as the paper's unclipped loss has it: there the ground looks like a black part
of the model."""
DRAWN = ("plain", "background")
QUALITY = PhotoQuality(blur_px=0.7, noise=2.0)
ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
MARGIN_PX, INPAINT_PX = (81, 141), 5
"""Width and height of the ellipse by which the demo's car is dilated, to include its shadow, before
the photo is inpainted there; radius of the inpainting."""
LARGEST_SHARE = 0.8
"""Of the photo's width and height that a random view of the vehicle fills at most."""
TURN_DEG, LEAST_RISE_DEG, MOST_RISE_DEG, ROLL_DEG = 50.0, 4.0, 25.0, 3.0
"""Off the view straight at a side; up from the ground; about the line of sight."""
DEPTH_PER_DIAMETER = 4.0
"""Where parallel projection puts the vehicle, which no photo can tell."""


@dataclass(frozen=True, slots=True, eq=False)
class StudyPhoto:
    """A photo that starts are drawn on."""

    kind: Kind
    index: int
    photo: Path
    model: Path
    truth: Pose
    """The pose that fits are compared with."""
    centre: Pose
    """What starts are drawn about: the truth, or the nearest pose that the fit's camera can have.
    """
    accuracy_percent: float
    """How far the truth itself may be off, as a share of the model's size in the photo."""

    @property
    def free_focal(self) -> bool:
        """Whether the focal length is one of the parameters."""
        return self.kind == "photo-perspective"

    def is_found(self, error_px: float, error_percent: float) -> bool:
        """Within 1 px where OpenGL drew the photo, else within the truth's accuracy + 1 %."""
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


def make_seed(*words: object) -> int:
    """A seed: the same for the same words, on every machine."""
    return zlib.crc32("/".join(str(word) for word in words).encode())


def make_photos(studio: Studio, kind: Kind, count: int, folder: Path) -> Iterator[StudyPhoto]:
    """``count`` photos in ``folder``; those that are there already are taken from it.

    Views, lights and backgrounds are random, the same for the same seed.
    """
    for index in range(count):
        photo, truth = folder / f"{kind}-{index}.png", folder / f"{kind}-{index}.json"
        # The pose is written last: where it is, the photo is whole.
        if not truth.exists():
            pose, pixels = _draw(studio, kind, index)
            save_image(photo, pixels)
            save_pose(truth, PoseRecord(pose))
        pose = load_pose(truth, *studio.size).pose
        yield StudyPhoto(kind, index, photo, studio.model, pose, pose, 0.0)


def _draw(studio: Studio, kind: Kind, index: int) -> tuple[Pose, NDArray[np.uint8]]:
    seed = make_seed(studio.seed, kind, index)
    random = np.random.default_rng(seed)
    pose = random_view(studio.mesh, studio.keypoints, studio.size, studio.parallel, random)
    lighting = random_lighting(random)
    behind = _behind(studio, kind, index, random)
    if reason := opengl_unavailable_reason():
        raise RendererUnavailableError(f"synthetic photos are drawn by OpenGL: {reason}")
    photographer = Photographer(studio.mesh, "phong")
    try:
        pixels = photographer.photograph(pose, lighting, behind, QUALITY, shadows=True, seed=seed)
    finally:
        photographer.close()
    return pose, pixels


def _behind(studio: Studio, kind: Kind, index: int, random: np.random.Generator) -> NDArray:
    """(3,) RGB in [0, 1], or (h, w, 3) uint8: a piece of a background in the photo's shape,
    mirrored now and then.
    """
    if kind == "plain":
        return np.zeros(3)
    picture = studio.backgrounds[index % len(studio.backgrounds)]
    height, width = picture.shape[:2]
    scale = random.uniform(0.8, 1.0) * min(width / studio.size[0], height / studio.size[1])
    wide, high = (max(1, int(scale * side)) for side in studio.size)
    left = int(random.integers(width - wide + 1))
    top = int(random.integers(height - high + 1))
    piece = picture[top : top + high, left : left + wide]
    return piece[:, ::-1] if random.random() < 0.5 else piece


def random_view(
    mesh: Mesh,
    keypoints: VehicleKeypoints,
    size: tuple[int, int],
    parallel: bool,
    random: np.random.Generator,
) -> Pose:
    """A pose that shows the whole vehicle in a photo of ``size`` (width, height) px as people take
    cars: from a side, somewhat above, filling the photo.
    """
    rotation = _random_rotation(keypoints, random)
    seen = (mesh.vertices - mesh.centre) @ rotation.T
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    scale = float(np.min(np.array(size) * LARGEST_SHARE / (high - low))) * random.uniform(0.75, 1.0)
    free = np.array(size) / scale - (high - low)
    middle = 0.25 * free * random.uniform(-1.0, 1.0, 2)
    width, height = size
    camera: Camera
    if parallel:
        camera = Parallel(scale, width / 2.0, height / 2.0, width, height)
        depth = DEPTH_PER_DIAMETER * mesh.diameter
    else:
        camera = Perspective.from_field_of_view(random.uniform(20.0, 40.0), width, height)
        depth = camera.fx / scale
    centre = np.array([*(middle - (low + high) / 2.0), depth])
    return Pose(camera, RigidTransform(rotation, centre - rotation @ mesh.centre))


def _random_rotation(keypoints: VehicleKeypoints, random: np.random.Generator) -> FloatArray:
    """(3, 3): camera from model."""
    left = keypoints.left
    up = np.cross(left.front_wheel - left.rear_wheel, left.axle)
    up = up / np.linalg.norm(up)
    side = (keypoints.left, keypoints.right)[int(random.integers(2))]
    along = (side.front_wheel - side.rear_wheel) / side.wheelbase
    turn = math.radians(random.uniform(-TURN_DEG, TURN_DEG))
    rise = math.radians(random.uniform(LEAST_RISE_DEG, MOST_RISE_DEG))
    level = math.cos(turn) * side.axle + math.sin(turn) * along
    forward = -(math.cos(rise) * level + math.sin(rise) * up)
    down = -(up - (up @ forward) * forward)
    down = down / np.linalg.norm(down)
    roll = math.radians(random.uniform(-ROLL_DEG, ROLL_DEG))
    right = np.cross(down, forward)
    cosine, sine = math.cos(roll), math.sin(roll)
    return np.stack([cosine * right + sine * down, cosine * down - sine * right, forward])


def load_backgrounds(folder: Path | None) -> Sequence[NDArray[np.uint8]]:
    """(h, w, 3) RGB each: the photos of a folder by name, or the bundled one without its car."""
    if folder is None:
        return [_demo_without_its_car()]
    return [_load_rgb8(path) for path in background_files(folder)]


def background_files(folder: Path) -> list[Path]:
    """The photos in a folder, by name.

    Raises:
        PhotoFileError: there is none.
    """
    if not folder.is_dir():
        raise PhotoFileError(f"{folder}: is no folder; name one of photos for --backgrounds")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not found:
        raise PhotoFileError(f"{folder}: holds no photo; name a folder that does")
    return found


def _load_rgb8(path: Path) -> NDArray[np.uint8]:
    photo = load_photo(path)
    return photo.as_rgb8(photo.width, photo.height)


def _demo_without_its_car() -> NDArray[np.uint8]:
    """Half as large; where the car was, its surroundings go on smoothly."""
    case = demo_case()
    picture = _load_rgb8(case.photo)
    height, width = picture.shape[:2]
    truth = load_pose(case.truth, width, height).pose
    covered = SoftwareRenderer(load_mesh(case.model)).covers(truth).astype(np.uint8)
    covered = cv2.dilate(covered, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, MARGIN_PX))
    half = width // 2, height // 2
    small = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
    hole = cv2.resize(covered, half, interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.inpaint(small, hole, INPAINT_PX, cv2.INPAINT_TELEA), np.uint8)


def load_cars(kind: Kind, folder: Path | None) -> list[StudyPhoto]:
    """Photos that are not drawn here: the bundled one of the kind, or those in a folder with
    ``cases.json`` whose model is a vehicle.

    For ``photo-parallel``, those that a parallel camera can show as exactly as a fit is asked for.

    Raises:
        PoseViewerError: a file cannot be read.
        SettingsError: there is no such photo.
    """
    cases = [_demo_photo(kind)] if folder is None else load_cases(folder)
    load = lru_cache(maxsize=None)(load_model)
    found = []
    for index, case in enumerate(cases):
        model: LoadedModel = load(case.mesh)
        centre = model.keypoints and _centre(kind, model.keypoints, case.truth)
        if centre is None:
            continue
        photo = StudyPhoto(
            kind, index, case.photo, case.mesh, case.truth, centre, case.accuracy_percent
        )
        error = pose_error(model.mesh, centre, case.truth)
        if photo.is_found(error.reprojection_px, error.percent):
            found.append(photo)
    if not found:
        raise SettingsError(
            f"{folder} holds no photo of a car for {kind}; leave that out of --kinds, or --cars"
        )
    return found


def _centre(kind: Kind, keypoints: VehicleKeypoints, truth: Pose) -> Pose | None:
    """The true pose as the kind's camera shows it; None where the car is seen head-on, or the kind
    wants perspective, and there is none.
    """
    camera = truth.camera
    side = visible_side(keypoints, truth)
    try:
        if kind == "photo-perspective" or isinstance(camera, Parallel):
            VehicleChart.near(keypoints, truth)
            is_right = isinstance(camera, Perspective) == (kind == "photo-perspective")
            return truth if is_right else None
        depth = float(truth.camera_from_model.apply(side.rear_wheel)[2])
        flat = Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        chart = VehicleChart(side, flat, depth=depth)
        return chart.to_pose(chart.from_pose(truth))
    except (SingularChartError, OutsideChartError):
        return None


def _demo_photo(kind: Kind) -> RealCase:
    name = kind.removeprefix("photo-")
    case = demo_case(name)
    photo = load_photo(case.photo)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    return RealCase(name, "demo", case.photo, case.model, truth, 0.0)
