"""How sure fits are, against how far off they are:
``python -m tests.measure.calibrate_uncertainty FOLDER [FOLDER ...]``.

Each folder has ``cases.json`` and ``starts.json`` (see ``study.real_cases``) with exact truths; of
other cases (``--cases``) the truth's own error would be taken for the fit's. It prints a line for
each fit, then how often the region of a fit that is ``found`` holds the truth, on the half of the
cases that ``SPREAD`` in ``confidence.uncertainty`` is tuned on and on the other, and what
``SPREAD`` would make it 90 % on the first half.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.api import make_case
from poseviewer.confidence.uncertainty import SPREAD
from poseviewer.evaluation.trials import RealTask, real_tasks
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.pose_covariance import REGION, region_reach
from poseviewer.geometry.pose_error import pose_error
from tests.measure.trial_table import print_trials


@dataclass(frozen=True, slots=True)
class SureTrial:
    """A fit, how sure it is and how far off; lengths as shares of the model's radius."""

    case: str
    set: str
    degrees: int
    draw: int
    word: str
    distance: float
    """Of the truth from the end, in standard deviations: the region reaches ``region_reach``."""
    depth: float
    depth_off: float
    sideways: float
    sideways_off: float
    turn_deg: float
    turn_deg_off: float
    px: float
    px_off: float
    seconds: float

    @property
    def tunes(self) -> bool:
        """Whether it is of the half that the factor is made from; by a hash of the case's name."""
        return hashlib.sha256(self.case.encode()).digest()[0] % 2 == 0

    @property
    def is_inside(self) -> bool:
        """Whether the region holds the truth."""
        return self.distance <= region_reach(6)


def run_trial(task: RealTask) -> SureTrial | None:
    """Fit, and compare the covariance with the truth; None where the pose is lost.

    Raises:
        PoseViewerError: photo or model cannot be read.
    """
    registration, renderer = task.open()
    found = make_case(registration, task.settings, renderer=renderer).fit()
    truth, mesh, sure = task.case.truth, registration.mesh, found.covariance
    if found.verdict is None or sure is None or sure.depth is None or found.progress is None:
        return None
    off = sure.deviation(truth)
    sight = sure.pose.camera_from_model.apply(mesh.centre)
    along = float(off[3:6] @ sight) / float(np.linalg.norm(sight))
    across = math.sqrt(max(float(off[3:6] @ off[3:6]) - along**2, 0.0))
    radius = mesh.diameter / 2.0
    return SureTrial(
        case=task.case.name,
        set=task.case.set,
        degrees=task.start.degrees,
        draw=task.start.draw,
        word=found.verdict.word,
        distance=math.sqrt(float(off @ np.linalg.solve(sure.matrix, off))),
        depth=sure.depth / radius,
        depth_off=abs(along) / radius,
        sideways=sure.sideways / radius,
        sideways_off=across / radius,
        turn_deg=sure.degrees,
        turn_deg_off=math.degrees(float(np.linalg.norm(off[:3]))),
        px=sure.px,
        px_off=pose_error(mesh, found.pose, truth).reprojection_px,
        seconds=found.progress.seconds,
    )


def run_trials(tasks: Sequence[RealTask]) -> Iterator[SureTrial]:
    """Those that are not lost."""
    for task in tasks:
        trial = run_trial(task)
        if trial is not None:
            yield trial


def wanted_spread(found: Sequence[SureTrial]) -> float:
    """The factor with which the region would hold its share of the truths of these fits."""
    distances = [trial.distance for trial in found]
    return SPREAD * float(np.quantile(distances, REGION)) / region_reach(6)


def summary(trials: Sequence[SureTrial]) -> str:
    """How often the region holds the truth, and how large it is."""
    found = [trial for trial in trials if trial.word == "found"]
    parts = {
        "tuning half": [trial for trial in found if trial.tunes],
        "other half": [trial for trial in found if not trial.tunes],
        "all": found,
    }
    parts |= {name: [t for t in found if t.set == name] for name in sorted({t.set for t in found})}
    parts["doubtful"] = [trial for trial in trials if trial.word == "doubtful"]
    head = f"{'found':<14}{'fits':>5}{'inside':>8}{'SPREAD':>8}"
    measures = ("depth", "sideways", "turn_deg", "px")
    lines = [head + "".join(f"{name:>10}{'off':>8}" for name in measures)]
    for name, some in parts.items():
        if not some:
            continue
        inside = float(np.mean([trial.is_inside for trial in some]))
        line = f"{name:<14}{len(some):>5}{inside:>8.1%}{wanted_spread(some):>8.4f}"
        for measure in measures:
            sure, off = (
                np.median([getattr(trial, part) for trial in some])
                for part in (measure, f"{measure}_off")
            )
            line += f"{sure:>10.4f}{off:>8.4f}"
        lines.append(line)
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each fit on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--cases", default="", metavar="PATTERN", help="of the first folder")
    parser.add_argument("--degrees", type=int, default=5)
    parser.add_argument("--draws", type=int, default=1)
    options = parser.parse_args(arguments)
    tasks = []
    for index, folder in enumerate(options.folders):
        pattern = "" if index else options.cases
        tasks += real_tasks(folder, [options.degrees], options.draws, pattern, FitSettings())
    return print_trials(run_trials(tasks), summary)


if __name__ == "__main__":
    sys.exit(main())
