"""How well an unknown focal length is found, on the bundled demo.

``python -m tests.measure.free_focal`` starts from the demo's start, seen with focal lengths
that are too short, right and too long (the car as large in the photo), and fits with the focal
length held there and with it free. It prints how far it ends from the true one, and how far the
pose is off in the photo.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

from poseviewer.api import load
from poseviewer.app.state.cameras import with_camera
from poseviewer.cli.options import positive
from poseviewer.files.demo import DemoCase, demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.pool import processors
from poseviewer.starts.registration import load_model
from tests.measure.trial_table import print_trials

FACTORS = (0.75, 1.0, 4.0 / 3.0)


@dataclass(frozen=True, slots=True)
class Trial:
    """One fit."""

    start: float
    """The focal length that it starts with, in true ones."""
    free: bool
    end: float
    """The focal length that it ends with, in true ones."""
    error_px: float
    """Mean distance of the pose in the photo."""
    evaluations: int


def run_trials(case: DemoCase, starts: Iterable[tuple[float, bool]]) -> Iterator[Trial]:
    """A fit for each start: its focal length, in true ones, and whether that is free."""
    photo, model = load_photo(case.photo), load_model(case.model)
    start, truth = (
        load_pose(path, photo.width, photo.height).pose for path in (case.start, case.truth)
    )
    true_focal = _perspective(truth).fx
    for factor, free in starts:
        camera = _perspective(start)
        seen = replace(camera, fx=factor * true_focal, fy=factor * true_focal)
        begin = with_camera(start, seen, model.mesh.centre)
        found = load(case.photo, model, begin, free_focal=free).fit(threads=processors())
        error = pose_error(model.mesh, found.pose, truth).reprojection_px
        assert found.progress is not None  # it was searched for
        end = _perspective(found.pose).fx / true_focal
        yield Trial(factor, free, end, error, found.progress.evaluations)


def _perspective(pose: Pose) -> Perspective:
    assert isinstance(pose.camera, Perspective)
    return pose.camera


def summary(found: Sequence[Trial]) -> str:
    """A line for each fit."""
    lines = [f"{'start':>7}{'focal length':>14}{'ends at':>9}{'px off':>8}"]
    for one in found:
        way = "free" if one.free else "held"
        lines.append(f"{one.start:7.0%}{way:>14}{one.end:9.1%}{one.error_px:8.2f}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each fit on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--factors", type=positive, nargs="+", default=FACTORS)
    factors = parser.parse_args(arguments).factors
    return print_trials(run_trials(demo_case(), product(factors, (True, False))), summary)


if __name__ == "__main__":
    sys.exit(main())
