"""How often a car's wheels are found in a rectangle, on photos with known poses.

``python -m tests.measure.found_wheels FOLDER`` takes those cases of a folder with
``cases.json`` (see ``study.real_cases``) whose model has wheels, and the bundled demo's
two photos. Each rectangle is a careless person's (``auto_start.careless_box``); the
focal length is known (``--guess``: it is not). It prints how far the wheels' centres and the pose
that they give are off.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.errors import QuickStartError
from poseviewer.evaluation.real_cases import load_cases, matches
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.starts.registration import StartInputs, load_model
from poseviewer.starts.wheels import find_wheels
from poseviewer.vehicle.chart import visible_side
from poseviewer.vehicle.keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_pose import Ellipse
from tests.measure.auto_start import careless_box
from tests.measure.trial_table import print_trials

WITHIN_PERCENT = 15.0
"""A start is right where the mean distance in the photo is a smaller share of the car's size."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One photo."""

    set: str
    case: str
    found: bool
    rear_px: float | None = None
    """How far the rear wheel's centre is off ..."""
    front_px: float | None = None
    """... and the front wheel's."""
    axle_deg: float | None = None
    """Between the axle that is found and the true one."""
    percent: float | None = None
    """Mean distance in the photo, as a share of the car's size."""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class _Car:
    set: str
    name: str
    photo: Path
    model: Path
    truth: Pose


def run_trials(folder: Path, pattern: str = "", guess: bool = False) -> Iterator[Trial]:
    """The demo's photos, then those of the folder; with a ``guess``, the camera is not known.

    Raises:
        PoseViewerError: the folder holds no such cases, or a file cannot be used.
    """
    demo = (car for car in _demo() if matches(car.name, pattern))
    for car in (*demo, *_cars(folder, pattern)):
        model = load_model(car.model)
        if model.keypoints is not None:
            yield _trial(car, model.mesh, model.keypoints, guess)


def _trial(car: _Car, mesh: Mesh, keypoints: VehicleKeypoints, guess: bool) -> Trial:
    photo, truth = load_photo(car.photo), car.truth
    camera = photo.default_camera() if guess else truth.camera
    box = careless_box(car.name, mesh, truth)
    began = time.perf_counter()
    try:
        found = find_wheels(StartInputs(photo, mesh, keypoints), box, camera, guess)
    except QuickStartError as error:
        sys.stderr.write(f"{car.name}: {error}\n")
        return Trial(car.set, car.name, False, seconds=time.perf_counter() - began)
    seconds = time.perf_counter() - began
    side, wheels, pose = visible_side(keypoints, truth), found.wheels, found.fit.pose
    axles = [p.camera_from_model.rotation @ side.axle for p in (pose, truth)]
    return Trial(
        car.set,
        car.name,
        True,
        _away(wheels.rear, truth.project(side.rear_wheel)),
        _away(wheels.front, truth.project(side.front_wheel)),
        float(np.degrees(np.arccos(np.clip(axles[0] @ axles[1], -1.0, 1.0)))),
        pose_error(mesh, pose, truth).percent,
        seconds,
    )


def _away(ellipse: Ellipse, centre: FloatArray) -> float:
    return float(np.hypot(ellipse.cx - centre[0], ellipse.cy - centre[1]))


def _demo() -> Iterator[_Car]:
    for projection in ("perspective", "parallel"):
        case = demo_case(projection)
        photo = load_photo(case.photo)
        truth = load_pose(case.truth, photo.width, photo.height).pose
        yield _Car("demo", f"demo-{projection}", case.photo, case.model, truth)


def _cars(folder: Path, pattern: str) -> Iterator[_Car]:
    for case in load_cases(folder, pattern):
        yield _Car(case.set, case.name, case.photo, case.mesh, case.truth)


def summary(found: Sequence[Trial]) -> str:
    """A line for each set: how often wheels were found, and were right."""
    lines = [f"{'set':14}{'photos':>7}{'found':>7}{'right':>7}{'px off':>8}"]
    for name in dict.fromkeys(one.set for one in found):
        some = [one for one in found if one.set == name]
        right = [t for t in some if t.percent is not None and t.percent <= WITHIN_PERCENT]
        off = [px for t in right for px in (t.rear_px, t.front_px) if px is not None]
        median = f"{np.median(off):8.1f}" if off else f"{'-':>8}"
        lines.append(f"{name:14}{len(some):7}{sum(t.found for t in some):7}{len(right):7}{median}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, a line of CSV each on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", default="", help="only those whose id matches")
    parser.add_argument("--guess", action="store_true", help="the focal length is not known")
    options = parser.parse_args(arguments)
    trials = run_trials(options.folder, options.cases, options.guess)
    return print_trials(trials, summary)


if __name__ == "__main__":
    sys.exit(main())
