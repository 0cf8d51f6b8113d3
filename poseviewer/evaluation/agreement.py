"""Whether fits of the same photo end in the same place, and how far that is from the truth.

``python -m poseviewer.evaluation.agreement FOLDER OUT`` reads the trials that ``study --real
FOLDER --out OUT`` has left. The middle of a case is the end of least summed distance to all its
other ends. Where the ends lie closer about it than it lies to the truth, the search does what it
can: either the least loss is beside the truth, or the truth is.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.errors import SettingsError
from poseviewer.evaluation.pose_error import pose_error
from poseviewer.evaluation.study.real import RealTrial
from poseviewer.evaluation.study.real_cases import RealCase, load_cases, load_starts
from poseviewer.evaluation.study.run import TRIALS
from poseviewer.evaluation.trial_table import print_trials
from poseviewer.files.mesh_file import load_mesh
from poseviewer.files.table_file import RowTable
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh


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


def agreements(folder: Path, out: Path, degrees: Sequence[int] = ()) -> Iterator[Agreement]:
    """One for each case that has two fits or more, of those from so many ``degrees`` (all).

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
        own = [trial for trial in fitted if trial.case == case.name]
        if len(own) < 2:
            continue
        mesh, ends = load_mesh(case.mesh), list[Pose]()
        for trial in own:
            start = starts[trial.case, trial.degrees, trial.draw]
            chart = FreeBodyChart.near(mesh, Pose(case.truth.camera, start.camera_from_model))
            ends.append(chart.to_pose(np.array(trial.end.split(), float)))
        yield _agreement(case, mesh, ends)


def _agreement(case: RealCase, mesh: Mesh, ends: Sequence[Pose]) -> Agreement:
    apart = distances(mesh, ends, case.truth)
    middle = int(np.argmin(apart.sum(axis=1)))
    others = np.delete(apart[middle], middle)
    off = pose_error(mesh, ends[middle], case.truth).percent
    return Agreement(
        case.set, case.name, len(ends), float(np.median(others)), off, case.accuracy_percent
    )


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
    lines = [f"{'set':14}{'cases':>7}{'fits':>7}{'apart %':>9}{'truth, %':>10}{'beyond':>8}"]
    for name in dict.fromkeys(one.set for one in found):
        some = [one for one in found if one.set == name]
        apart = np.median([one.apart_percent for one in some])
        off = np.median([one.middle_percent for one in some])
        beyond = sum(one.middle_percent > one.accuracy_percent for one in some)
        fits = sum(one.fits for one in some)
        lines.append(f"{name:14}{len(some):7}{fits:7}{apart:9.2f}{off:10.2f}{beyond:8}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each case on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--degrees", type=int, nargs="*", default=[], help="only fits from there")
    options = parser.parse_args(arguments)
    return print_trials(agreements(options.folder, options.out, options.degrees), summary)


if __name__ == "__main__":
    sys.exit(main())
