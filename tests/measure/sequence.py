"""Sequences with known poses: ``python -m tests.measure.sequence [NAME ...] [--frames N]``, a row
per sequence: how many poses are right, and frames a second.

A model turns by 90 degrees and moves before a real photo, under moving light and with noise. A
board with another photo on it passes in front. In ``half`` it covers a part of the model, and the
only key is in the first frame; in ``whole`` it covers the model wholly, and a second key is in the
last frame. Frames are drawn by OpenGL into the folder ``--out``, once.
"""

import argparse
import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from assets.source.data_folder import DATA
from poseviewer.evaluation.synthetic import Lighting, cut_out
from poseviewer.figures.text_table import Table
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.scene_assets import load_model
from poseviewer.fit.propagation import propagate
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.opengl import OpenGLRenderer
from poseviewer.render.pool import processors
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import store_poses, with_frames
from poseviewer.scene.types import Frame, FramePose, Scene, SceneObject, View

CAMERA = Perspective.from_field_of_view(50.0, 640, 480)
FRAMES = 60
TURN_DEG = 90.0
RIGHT_PERCENT, WRONG_PERCENT = 1.0, 3.0
"""Error up to which a pose is right, and from which a ``found`` one is wrong."""
MIN_SEEN = 0.6
"""Visible fraction of the model from which a pose counts."""
COVERED = 0.05
"""Visible fraction below which the model counts as covered."""
FRAME_S = 1.0 / 30.0
NOISE = 3.0
"""Standard deviation of the sensor's noise, grey levels of 255."""


@dataclass(frozen=True, slots=True)
class Take:
    """A model before a photo."""

    model: str
    background: str
    first: tuple[float, float, float]
    """Rotation vector in the middle of the turn, rad."""
    axis: tuple[float, float, float]
    """Axis of the turn, in the camera's frame."""
    fill: float
    """Diameter of the model over the photo's height."""


LEUVEN, HIGHWAY = "bg_leuven/leuven{}.jpg", "bg_highway/{}.jpg"
TAKES = {
    "car": Take(
        "mesh_bmw_e34/car.glb", LEUVEN.format("A"), (2.9, 0.0, 0.4), (0.1, 1.0, 0.2), 0.9
    ),
    "mustard": Take(
        "hope/mustard.ply", "clutter/clutter-3.png", (1.9, 0.3, 0.2), (0.0, 1.0, 0.1), 0.6
    ),
    "soup": Take(
        "hope/AlphabetSoup.ply", "clutter/tight-2.png", (1.4, -0.2, 0.1), (0.3, 1.0, 0.0), 0.5
    ),
    "sauce": Take(
        "hope/bbq_sauce.ply", HIGHWAY.format("solidWhiteRight"), (1.5, 1.0, 0.0), (0.0, 1.0, 1.0),
        0.6,
    ),
    "can": Take("lmo/obj_000005.ply", LEUVEN.format("B"), (1.5, 0.4, 0.3), (0.0, 1.0, 0.3), 0.6),
    "cat": Take(
        "lmo/obj_000006.ply", "clutter/clutter-7.png", (1.6, 0.2, 0.0), (0.2, 1.0, 0.0), 0.5
    ),
    "driller": Take(
        "lmo/obj_000008.ply", HIGHWAY.format("whiteCarLaneSwitch"), (1.3, 0.5, 0.0),
        (0.0, 1.0, 0.0), 0.6,
    ),
}  # fmt: skip
WAYS = ("half", "whole")


def true_pose(take: Take, mesh: Mesh, share: float) -> Pose:
    """The pose after a ``share`` of the sequence: a turn, on a bent path, slower at its ends."""
    eased = share + 0.1 * np.sin(2.0 * np.pi * share)
    axis = np.array(take.axis) / np.linalg.norm(take.axis)
    turn = Rotation.from_rotvec(np.radians(TURN_DEG) * (eased - 0.5) * axis)
    rotation = (turn * Rotation.from_rotvec(take.first)).as_matrix()
    depth = mesh.diameter * CAMERA.fy / (take.fill * CAMERA.height)
    path = 0.25 * (eased - 0.5), 0.05 * np.sin(5.0 * share), 1.0 + 0.1 * np.sin(3.0 * share)
    centre = depth * np.array(path)
    return Pose(CAMERA, RigidTransform(rotation, centre - rotation @ mesh.centre))


def light_at(share: float) -> Lighting:
    """Light from one side that moves to the other, and grows weaker."""
    angle = np.radians(-50.0 + 100.0 * share)
    towards = np.array([[np.sin(angle), -0.6, -np.cos(angle)]])
    towards /= np.linalg.norm(towards)
    strength = 0.75 - 0.25 * share
    return Lighting(np.full(3, 0.3), towards, strength * np.array([[1.05, 1.0, 0.9]]))


def board_at(share: float, way: str, box: NDArray[np.float64]) -> tuple[int, int, int, int]:
    """The board in front: left, top, right, bottom, px; it comes from the left and passes."""
    low, high = box
    width, height = 1.15 * (high - low)
    middle = 0.5 * (low + high)
    at = middle[0] + (share - 0.5) * 5.0 * width  # beside the model at 0.3 and at 0.7
    top = middle[1] - 0.5 * height if way == "whole" else middle[1] + 0.1 * height
    return round(at - 0.5 * width), round(top), round(at + 0.5 * width), round(top + height)


def draw(name: str, way: str, frames: int, folder: Path) -> list[float]:
    """Draw the frames that are not there, and return the visible fraction in each."""
    take = TAKES[name]
    seen_file = folder / f"seen-{frames}.txt"
    if seen_file.exists():
        return np.loadtxt(seen_file).tolist()
    folder.mkdir(parents=True, exist_ok=True)
    mesh = load_model(DATA / take.model).mesh
    size = CAMERA.width, CAMERA.height
    behind = cv2.resize(load_photo(DATA / take.background).pixels, size) / 255.0
    board = (
        cv2.resize(load_photo(DATA / "bg_leuven/leuvenB.jpg").pixels[100:400, 100:400], size)
        / 255.0
    )
    renderer, random, seen = OpenGLRenderer(mesh), np.random.default_rng(7), []
    for index in range(frames):
        share = index / (frames - 1)
        pose = true_pose(take, mesh, share)
        colour, coverage = cut_out(renderer, pose, light_at(share), 0.2)
        photo = colour + (1.0 - coverage[..., None]) * behind
        rows, columns = np.nonzero(coverage > 0.5)
        box = np.array([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]], float)
        left, top, right, bottom = board_at(share, way, box)
        left, right = np.clip([left, right], 0, CAMERA.width)
        top, bottom = np.clip([top, bottom], 0, CAMERA.height)
        cover = np.zeros(coverage.shape, bool)
        cover[top:bottom, left:right] = True
        photo[cover] = board[cover]
        seen.append(float(np.mean(~cover[rows, columns])))
        photo = np.asarray(cv2.GaussianBlur(np.asarray(255.0 * photo, float), (0, 0), 0.6))
        photo += random.normal(0.0, NOISE, photo.shape)
        photo = np.clip(np.rint(photo), 0, 255).astype(np.uint8)
        save_image(folder / f"{index:04d}.png", photo)
    renderer.close()
    np.savetxt(seen_file, seen)
    return seen


def make_sequence(name: str, way: str, frames: int, folder: Path) -> Scene:
    """Make the scene of a drawn sequence, with its keys."""
    take = TAKES[name]
    model = load_model(DATA / take.model)
    view = View(_file(folder / "0000.png"), CAMERA)
    poses = [true_pose(take, model.mesh, i / (frames - 1)) for i in range(frames)]
    item = SceneObject(id=name, model=model, world_from_model=view.world_from_model(poses[0]))
    scene = Scene(views=(view,), objects=(item,))
    files = [_file(folder / f"{index:04d}.png") for index in range(frames)]
    keyed = [0] if way == "half" else [0, frames - 1]
    return with_frames(
        scene,
        [
            Frame(
                file=file,
                time_s=index * FRAME_S,
                poses={name: FramePose(world_from_model=view.world_from_model(poses[index]))}
                if index in keyed
                else {},
            )
            for index, file in enumerate(files)
        ],
    )


def _file(path: Path) -> PhotoFile:
    size = CAMERA.width, CAMERA.height
    return PhotoFile(path, path.name, *size, read=lambda: load_photo(path))


def measure(name: str, way: str, frames: int, out: Path, verbose: bool) -> tuple[str, ...]:
    """Propagate from the keys, compare with the truth, and return a row of the table."""
    folder = out / f"{name}-{way}"
    seen = draw(name, way, frames, folder)
    scene = make_sequence(name, way, frames, folder)
    item, steps = scene.objects[0], 0
    renderer = make_renderer(item.mesh, item.settings.renderer)
    for _ in propagate(scene, {0: renderer}, 0, 1, threads=processors()):
        pass  # kernels are compiled
    began = time.perf_counter()
    for step in propagate(scene, {0: renderer}, 0, frames - 1, threads=processors()):
        scene = store_poses(scene, {step.frame_index: step.poses})
        steps += 1
        if verbose or step.note:
            print(name, way, step.frame_index, step.note, flush=True)
    rate = steps / (time.perf_counter() - began)
    right = wanted = wrong = found = 0
    for index, frame in enumerate(scene.frames):
        known = frame.poses.get(name)
        if known is not None and known.source == "key":
            continue
        wanted += seen[index] >= MIN_SEEN
        if known is None or known.result is None or known.result.verdict is None:
            continue
        truth = true_pose(TAKES[name], item.mesh, index / (frames - 1))
        pose = scene.views[0].pose(known.world_from_model)
        percent = pose_error(item.mesh, pose, truth, item.symmetry).percent
        is_found = known.result.verdict.label == "found"
        right += percent <= RIGHT_PERCENT and seen[index] >= MIN_SEEN
        found += is_found
        wrong += is_found and percent > WRONG_PERCENT
        if verbose:
            said = known.result.verdict
            print(index, f"{seen[index]:.2f} {percent:.2f} % {said.label} {said.probability:.2f}")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    covered = sum(share < COVERED for share in seen)
    shares = f"{100 * right / wanted:.0f} %", f"{found}", f"{wrong}", f"{covered}"
    counts = f"{len(item.mesh.faces):,}", f"{wanted}"
    return name, way, *counts, *shares, f"{rate:.1f}", f"{memory:.0f}"


HEAD = [
    "model",
    "board",
    "triangles",
    "60 % seen",
    "within 1 %",
    "found",
    "found, > 3 % off",
    "covered",
    "frames/s",
    "MB",
]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(TAKES))
    parser.add_argument("--ways", nargs="+", default=list(WAYS))
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--out", type=Path, default=Path("sequences"))
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args(arguments)
    rows = [
        measure(name, way, options.frames, options.out, options.verbose)
        for name in options.names
        for way in options.ways
    ]
    print(Table("60 frames of 640x480", tuple(HEAD), tuple(rows)).as_markdown())


if __name__ == "__main__":
    main()
