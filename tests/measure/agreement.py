"""Whether fits of the same photo end in the same place, and how far that is from the truth.

``python -m tests.measure.agreement FOLDER OUT`` reads the trials that ``study --real
FOLDER --out OUT`` has left. The middle of a case is the end of least summed distance to all its
other ends. Where the ends lie closer about it than it lies to the truth, the search does what it
can: either the least loss is beside the truth, or the truth is. For that, the model's outline at
both is held against the photo's edges.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.errors import SettingsError
from poseviewer.evaluation.real_cases import RealCase, RealStart, load_cases, load_starts
from poseviewer.evaluation.run import TRIALS
from poseviewer.evaluation.trials import RealTask, RealTrial
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.table import RowTable
from poseviewer.fit.outline import outline_support
from poseviewer.fit.problem import make_problem
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from tests.measure.trial_table import print_trials


@dataclass(frozen=True, slots=True)
class Agreement:
    """The ends of one case."""

    set: str
    case: str
    fits: int
    apart_percent: float
    """How far the ends are from their middle, the median, as a share of the model's size."""
    middle_percent: float
    """How far the middle is from the truth, in the same unit."""
    accuracy_percent: float
    """How far the truth itself may be off, as its source says."""
    middle_outline: float
    """Share of the outline at the middle that has an edge of the photo on it, in [0, 1] ..."""
    truth_outline: float
    """... and at the truth."""


@dataclass(frozen=True, slots=True, eq=False)
class CaseEnds:
    """Where the fits of one case have ended."""

    case: RealCase
    trials: tuple[RealTrial, ...]
    starts: tuple[RealStart, ...]
    mesh: Mesh
    ends: tuple[Pose, ...]


def ends_of_cases(folder: Path, out: Path, degrees: Sequence[int] = ()) -> Iterator[CaseEnds]:
    """Of each case of which there are fits, of those from starts ``degrees`` off (default: all).

    Raises:
        PoseViewerError: there are no such fits, or the folder does not hold their cases and starts.
    """
    table = out / TRIALS
    trials = RowTable(table, RealTrial).rows if table.is_file() else []
    fitted = [t for t in trials if t.end and (not degrees or t.degrees in degrees)]
    if not fitted:
        raise SettingsError(f"{table}: no such fits; run poseviewer study --real FOLDER first")
    angles = sorted({trial.degrees for trial in fitted})
    draws = 1 + max(trial.draw for trial in fitted)
    starts = {(s.case, s.degrees, s.draw): s for s in load_starts(folder, angles, draws)}
    for case in load_cases(folder):
        own = tuple(trial for trial in fitted if trial.case == case.name)
        if not own:
            continue
        own_starts = tuple(starts[trial.case, trial.degrees, trial.draw] for trial in own)
        mesh = load_mesh(case.mesh)
        ends = tuple(
            FreeBodyChart.near(mesh, Pose(case.truth.camera, start.camera_from_model)).to_pose(
                np.array(trial.end.split(), float)
            )
            for trial, start in zip(own, own_starts, strict=True)
        )
        yield CaseEnds(case, own, own_starts, mesh, ends)


def agreements(folder: Path, out: Path, degrees: Sequence[int] = ()) -> Iterator[Agreement]:
    """One for each case of two fits or more; raises as ``ends_of_cases``."""
    for one in ends_of_cases(folder, out, degrees):
        if len(one.ends) > 1:
            task = RealTask(one.case, one.starts[0], FitSettings())
            yield _agreement(task, one.mesh, one.ends)


def _agreement(task: RealTask, mesh: Mesh, ends: Sequence[Pose]) -> Agreement:
    case = task.case
    apart = distances(mesh, ends, case.truth)
    middle = int(np.argmin(apart.sum(axis=1)))
    others = np.delete(apart[middle], middle)
    off = pose_error(mesh, ends[middle], case.truth).percent
    outlines = _outline_shares(task, [ends[middle], case.truth])
    fits, between = len(ends), float(np.median(others))
    return Agreement(case.set, case.name, fits, between, off, case.accuracy_percent, *outlines)


def _outline_shares(task: RealTask, poses: Sequence[Pose]) -> list[float]:
    """Of the outline at each pose: the share that has an edge of the photo on it."""
    registration, renderer = task.open()
    photo = make_problem(registration, task.settings)[0].photo
    pictures = [renderer.covers(level_pose(pose, photo.factor)) for pose in poses]
    return [outline_support(photo.channels, photo.weights, seen) for seen in pictures]


def distances(mesh: Mesh, poses: Sequence[Pose], truth: Pose) -> FloatArray:
    """(N, N): mean distance in the photo between the model's vertices at two poses, as a share of
    the diagonal of its box at the true one, %. Behind a camera they are infinitely far.
    """
    vertices = np.unique(mesh.vertices, axis=0)
    size = float(np.linalg.norm(np.ptp(truth.project(vertices), axis=0)))
    seen = [pose.project(vertices) for pose in poses]
    apart = [[np.linalg.norm(one - other, axis=1).mean() for other in seen] for one in seen]
    return np.nan_to_num(100.0 * np.array(apart) / size, nan=np.inf)


def summary(found: Sequence[Agreement]) -> str:
    """A line for each set: medians over its cases."""
    lines = [
        f"{'set':14}{'cases':>7}{'fits':>7}{'apart %':>9}{'truth, %':>10}{'beyond':>8}"
        f"{'outline on edges':>18}{'at truth':>10}{'better':>8}"
    ]
    for name in dict.fromkeys(one.set for one in found):
        some = [one for one in found if one.set == name]
        apart, off, middle, truth = (
            np.median([getattr(one, name) for one in some])
            for name in ("apart_percent", "middle_percent", "middle_outline", "truth_outline")
        )
        beyond = sum(one.middle_percent > one.accuracy_percent for one in some)
        better = sum(one.middle_outline > one.truth_outline for one in some)
        fits = sum(one.fits for one in some)
        lines.append(
            f"{name:14}{len(some):7}{fits:7}{apart:9.2f}{off:10.2f}{beyond:8}"
            f"{middle:18.0%}{truth:10.0%}{better:8}"
        )
    return "\n".join(lines)


def options_of(about: str | None, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Of a command that reads the trials of a study."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--degrees", type=int, nargs="*", default=[], help="only fits from there")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each case on standard output; the summary on standard error."""
    options = options_of(__doc__, arguments)
    return print_trials(agreements(options.folder, options.out, options.degrees), summary)


if __name__ == "__main__":
    sys.exit(main())
