"""Photos of the paper's experiment, each with its true pose: drawn by OpenGL, or the demo's."""

import math
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.evaluation.cases import Case
from poseviewer.evaluation.plan import DRAWN, Kind, Plan, ReadingName
from poseviewer.evaluation.synthetic import photograph, random_lighting
from poseviewer.evaluation.trials import fetch_model
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.writing import make_folder
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.views import ground_view
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints

PHOTOS = "photos"
"""Folder of drawn photos in that of the study."""
QUALITY = {"highlights": 0.4, "blur_px": 0.7, "noise": 2.0}
"""Options of ``photograph``: those of a good camera."""
MARGIN_PX = (81, 141)
"""Width and height by which the demo's car and shadow are dilated."""
INPAINT_PX = 5
"""Radius of the inpainting."""
EXPOSURE = 3.0
"""Factor of the light: with it the bundled car is as bright as its street, and hardly clipped."""
MAX_FILL = 0.8
"""Largest share of the photo's width and height that a random view of the vehicle fills."""
MAX_AZIMUTH_DEG = 50.0
"""Largest angle of a random view from the one straight at a side."""
MIN_ELEVATION_DEG = 4.0
"""Smallest elevation of a random view."""
MAX_ELEVATION_DEG = 25.0
"""Largest elevation of a random view."""
MAX_ROLL_DEG = 3.0
"""Largest roll of a random view."""
DEPTH_PER_DIAMETER = 4.0
"""Depth of the vehicle under parallel projection, which no photo can tell."""
MAX_DRAWS = 1000
"""Draws of a start after which none is expected to be a pose of the chart."""


def make_seed(*words: object) -> int:
    """Hash words to a seed, equally on every machine."""
    return zlib.crc32("/".join(str(word) for word in words).encode())


def make_photos(plan: Plan, kind: Kind, tell: Callable[[str], None]) -> list[Case]:
    """Load the demo's photo of a kind, or draw the plan's that are not there yet by its seed."""
    if kind not in DRAWN:
        return [demo_photo(kind)]
    folder, model = plan.out / PHOTOS, plan.model or demo_case().model
    tell(f"{kind}: drawing photos, or taking those in {folder}")
    vehicle, _ = fetch_model(model)
    if vehicle.keypoints is None:
        raise SettingsError(
            f"{model}: the study needs a vehicle, with MODEL.keypoints.json beside it or parts "
            "named like wheels"
        )
    make_folder(folder, SettingsError)
    cases = []
    for index in range(min(plan.photos, plan.starts)):
        photo, truth = folder / f"{kind}-{index}.png", folder / f"{kind}-{index}.json"
        if not truth.exists():
            seed = make_seed(plan.seed, kind, index)
            random = np.random.default_rng(seed)
            pose = random_view(vehicle.mesh, vehicle.keypoints, plan.size, random)
            light, ground = random_lighting(random), np.zeros(3)
            ambient, intensity = EXPOSURE * light.ambient, EXPOSURE * light.intensity
            light = replace(light, ambient=ambient, intensity=intensity)
            if kind != "plain":
                ground = _random_piece(_demo_without_its_car(), plan.size, random)
            save_image(photo, photograph(vehicle.mesh, pose, light, ground, seed=seed, **QUALITY))
            save_pose(truth, PoseRecord.of(pose))  # last: where it is, the photo is whole
        pose = load_pose(truth, *plan.size).pose
        cases.append(Case(f"{kind}-{index}", kind, photo, model, pose, is_drawn=True))
    return cases


def demo_photo(kind: Kind) -> Case:
    """Load the demo's photo of this projection."""
    files = demo_case(kind.removeprefix("photo-"))
    photo = load_photo(files.photo)
    truth = load_pose(files.truth, photo.width, photo.height).pose
    return Case(f"{kind}-0", kind, files.photo, files.model, truth)


def draw_start(
    keypoints: VehicleKeypoints,
    truth: Pose,
    free_focal: bool,
    reading: ReadingName,
    share: float,
    seed: int,
) -> Pose:
    """Draw a pose of the same side, each vehicle parameter off by up to a share.

    Args:
        keypoints: key points of the vehicle.
        truth: the true pose.
        free_focal: whether the focal length is a parameter.
        reading: what the share is of.
        share: largest deviation.
        seed: seed of the random numbers.
    """
    chart = VehicleChart.near(keypoints, truth, free_focal)
    true = chart.from_pose(truth)
    size = np.abs(true) if reading == "relative" else chart.scales(true)
    random = np.random.default_rng(seed)
    for _ in range(MAX_DRAWS):
        parameters = true + share * size * random.uniform(-1.0, 1.0, len(true))
        try:
            pose = chart.to_pose(parameters)
            if VehicleChart.near(keypoints, pose, free_focal).side is chart.side:
                return pose
        except (OutsideChartError, SingularChartError):
            continue
    raise SingularChartError(
        f"none of {MAX_DRAWS} starts up to {share:.0%} off is a pose of the vehicle chart; "
        "choose smaller deviations"
    )


def random_view(
    mesh: Mesh, keypoints: VehicleKeypoints, size: tuple[int, int], random: np.random.Generator
) -> Pose:
    """Draw a pose as people take cars: from a side, somewhat above, filling the photo.

    Args:
        mesh: the vehicle.
        keypoints: key points of the vehicle.
        size: (width, height) of the photo, px.
        random: generator of random numbers.
    """
    side = math.pi * int(random.integers(2))
    azimuth = side + math.radians(random.uniform(-MAX_AZIMUTH_DEG, MAX_AZIMUTH_DEG))
    elevation = math.radians(random.uniform(MIN_ELEVATION_DEG, MAX_ELEVATION_DEG))
    roll = math.radians(random.uniform(-MAX_ROLL_DEG, MAX_ROLL_DEG))
    upright = ground_view(keypoints, azimuth, elevation)
    rotation = Rotation.from_rotvec([0.0, 0.0, roll]).as_matrix() @ upright
    vertices = (mesh.vertices - mesh.centre) @ rotation.T
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    scale = float(np.min(np.array(size) * MAX_FILL / (high - low))) * random.uniform(0.75, 1.0)
    free = np.array(size) / scale - (high - low)
    middle = 0.25 * free * random.uniform(-1.0, 1.0, 2)
    camera = Parallel(scale, size[0] / 2.0, size[1] / 2.0, *size)
    centre = np.array([*(middle - (low + high) / 2.0), DEPTH_PER_DIAMETER * mesh.diameter])
    return Pose(camera, RigidTransform(rotation, centre - rotation @ mesh.centre))


def _random_piece(
    picture: NDArray[np.uint8], size: tuple[int, int], random: np.random.Generator
) -> NDArray[np.float32]:
    """Draw a piece (h, w, 3) of the picture in [0, 1], sometimes mirrored, of the photo's size."""
    height, width = picture.shape[:2]
    scale = random.uniform(0.8, 1.0) * min(width / size[0], height / size[1])
    w, h = (max(1, int(scale * side)) for side in size)
    left = int(random.integers(width - w + 1))
    top = int(random.integers(height - h + 1))
    piece = picture[top : top + h, left : left + w]
    piece = piece[:, ::-1] if random.random() < 0.5 else piece
    mode = cv2.INTER_AREA if w > size[0] or h > size[1] else cv2.INTER_LINEAR
    light = piece.astype(np.float32) / np.float32(255.0)
    return np.asarray(cv2.resize(light, size, interpolation=mode), np.float32)


@cache
def _demo_without_its_car() -> NDArray[np.uint8]:
    """Return the demo's photo (h, w, 3) half as large, inpainted where the car was."""
    case = demo_photo("photo-perspective")
    width, height = case.truth.camera.width, case.truth.camera.height
    picture = load_photo(case.photo).as_rgb8(width, height)
    covered = (
        SoftwareRenderer(fetch_model(case.mesh)[0].mesh).render_mask(case.truth).astype(np.uint8)
    )
    covered = cv2.dilate(covered, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, MARGIN_PX))
    half = width // 2, height // 2
    small = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
    hole = cv2.resize(covered, half, interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.inpaint(small, hole, INPAINT_PX, cv2.INPAINT_TELEA), np.uint8)
