"""Films with known poses: ``python -m tests.measure.films [NAME ...] [--every N] [--frames N]``.

A row per film: how many frames have a pose and are ``found``, how far these are off, and frames a
second. The only key is in the first frame, unless ``--keys`` names others. Errors are mean
distances of the model's vertices in the photo, in % of the diagonal of its box there. ``--by
points`` adds the points' motions without any search, ``--by loss`` searches without points.
"""

import argparse
import csv
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from assets.source.data_folder import DATA
from poseviewer.api import Registration, load_frames
from poseviewer.figures.text_table import Table
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.fit import propagation
from poseviewer.fit.point_motion import follow_points, grey_of
from poseviewer.fit.propagation import OF_KEY
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.pool import processors
from poseviewer.scene.sequence import show_frame, store_poses
from poseviewer.scene.types import FramePose, PlacedModel

FILMS = DATA / "films"
SIZE = 640, 480
"""Of all films, px."""
WRONG_PERCENT = 5.0
"""Error from which a ``found`` pose is wrong."""
HEAD = (
    "film", "every", "frames", "with a pose", "found", "median %", "within 1 %", "largest %",
    "found, > 5 % off", "first tenth %", "last tenth %", "frames/s",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Film:
    """A film, and where its truth is."""

    frames: str
    model: str
    camera: str
    truth: str
    """Table of matrices by frame."""
    key: str = ""
    """Pose in the first frame, to which the truth is relative; "": the truth is the pose."""


KNOWN = {
    "cube": Film(
        "rbt/frames", "rbt/cube.obj", "rbt/camera.yml", "rbt/motion.csv", "rbt/key_cube.json"
    ),
    "dragon": Film(
        "rbt/frames", "rbt/dragon.obj", "rbt/camera.yml", "rbt/motion.csv", "rbt/key_dragon.json"
    ),
    "castle": Film("castle", "castle/castle.obj", "castle/camera.yml", "castle/poses.csv"),
}


def _nothing(*_: object) -> None:
    """Tell no motion."""


def load_matrices(path: Path) -> list[FloatArray]:
    """(4, 4) each, in the order of the table."""
    names = [f"m{row}{column}" for row in range(3) for column in range(4)]
    with path.open() as file:
        rows = [[float(row[name]) for name in names] for row in csv.DictReader(file)]
    return [np.vstack([np.reshape(row, (3, 4)), [0.0, 0.0, 0.0, 1.0]]) for row in rows]


def _pose_at(path: Path, matrix: FloatArray) -> Pose:
    camera = load_calibration(Calibration(path), "", *SIZE)[0].camera
    return Pose(camera, RigidTransform(matrix[:3, :3], matrix[:3, 3]))


def add_motions(chain: Registration, last: int) -> Registration:
    """Add the motions that points tell from frame to frame."""
    scene, item = chain.scene, chain.scene.objects[0]
    pose = scene.views[0].pose(scene.frames[0].poses[item.id].world_from_model)
    before = grey_of(show_frame(scene, 0).views[0].photo)
    for index in range(1, last + 1):
        after = grey_of(show_frame(scene, index).views[0].photo)
        told = follow_points(before, after, PlacedModel(item.mesh, pose))
        if told is None:
            break
        before, pose = after, told.pose
        place = scene.views[0].world_from_model(pose)
        known = FramePose(world_from_model=place, source="propagated", result=OF_KEY)
        scene = store_poses(scene, {index: {item.id: known}})
    return replace(chain, scene=scene)


def measure(
    name: str, every: int, count: int | None, verbose: bool, by: str = "both",
    is_painted: bool = False, keys: Sequence[int] = (),
) -> tuple[str, ...]:  # fmt: skip
    """Track from the first frame, compare with the truth, and return a row of the table."""
    film = KNOWN[name]
    truths = load_matrices(FILMS / film.truth)[::every][:count]
    key = FILMS / film.key if film.key else _pose_at(FILMS / film.camera, truths[0])
    chain = load_frames(
        FILMS / film.frames, FILMS / film.model, {0: key}, every=every,
        calibration=FILMS / film.camera,
    )  # fmt: skip
    last = len(truths) - 1
    at_first = chain.pose if film.key else None
    for index in keys:
        matrix = truths[index]
        if at_first is not None:
            matrix = matrix @ np.linalg.inv(truths[0]) @ at_first.camera_from_model.as_matrix()
        chain = chain.with_key(index, _pose_at(FILMS / film.camera, matrix))
    if is_painted:
        chain = chain.paint()
    began, notes = time.perf_counter(), list[str]()
    if by == "points":
        end = add_motions(chain, last)
    else:
        with patch.object(
            propagation, "follow_points", follow_points if by == "both" else _nothing
        ):
            end = chain.track(last=last, threads=processors())
    rate = last / (time.perf_counter() - began)
    notes = [note for note in end.notes if note not in chain.notes]
    view, item = end.scene.views[0], end.scene.objects[0]
    poses = [frame.poses.get(item.id) for frame in end.scene.frames[: last + 1]]
    assert poses[0] is not None
    first = view.pose(poses[0].world_from_model)
    at_key = first.camera_from_model.as_matrix()
    errors, found = dict[int, float](), list[int]()
    for index, known in enumerate(poses[1:], start=1):
        if known is None or known.result is None or known.result.verdict is None:
            continue
        matrix = truths[index] @ (np.linalg.inv(truths[0]) @ at_key if film.key else np.eye(4))
        truth = Pose(first.camera, RigidTransform(matrix[:3, :3], matrix[:3, 3]))
        pose = view.pose(known.world_from_model)
        errors[index] = pose_error(item.mesh, pose, truth, item.symmetry).percent
        found += [index] if known.result.verdict.label == "found" else []
        if verbose:
            verdict = known.result.verdict
            print(name, index, f"{errors[index]:.2f} % {verdict.label} {verdict.probability:.2f}")
    values, tenth = np.array(list(errors.values())), max(1, last // 10)
    for note in notes:
        print(name, note)
    wrong = sum(errors[index] > WRONG_PERCENT for index in found)
    within = 100.0 * np.sum(values <= 1.0) / last
    shares = f"{np.median(values):.2f}", f"{within:.0f}", f"{values.max():.2f}", f"{wrong}"
    ends = f"{np.median(values[:tenth]):.2f}", f"{np.median(values[-tenth:]):.2f}"
    counts = f"{every}", f"{last}", f"{len(values)}", f"{len(found)}"
    return name, *counts, *shares, *ends, f"{rate:.1f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(KNOWN))
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--frames", type=int, help="only the first N frames")
    parser.add_argument("--by", choices=("both", "points", "loss"), default="both")
    parser.add_argument("--paint", action="store_true", help="paint the model from the key")
    parser.add_argument("--keys", type=int, nargs="*", default=(), help="more keys, true poses")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args(arguments)
    how = options.every, options.frames, options.verbose, options.by, options.paint, options.keys
    rows = [measure(name, *how) for name in options.names or KNOWN]
    print(Table(f"Films from one key, by {options.by}", HEAD, tuple(rows)).as_markdown())


if __name__ == "__main__":
    main()
