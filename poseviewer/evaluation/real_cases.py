"""Fits on real photos with known poses: how far off before, how far after.

``python -m poseviewer.evaluation.real_cases FOLDER`` runs the fixed starts of a folder with
``cases.json`` and ``starts.json`` and prints the median error of each set of photos.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.evaluation.pose_error import pose_error
from poseviewer.files.mesh_file import load_mesh
from poseviewer.files.photo_file import load_photo
from poseviewer.fit.loss import registration_loss
from poseviewer.fit.pose_fit import FitProblem, fit_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.chart_choice import choose_chart
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.geometry.transform import RigidTransform, nearest_rotation
from poseviewer.registration import FitSettings, make_photo_attributes, make_renderer


@dataclass(frozen=True, slots=True)
class Trial:
    """One fit from one start."""

    set: str
    case: str
    degrees: int
    draw: int
    error_percent_start: float
    error_percent_end: float
    loss_start: float
    loss_end: float
    loss_truth: float
    evaluations: int
    seconds: float
    status: str


def run_trials(
    folder: Path, settings: FitSettings, degrees: int, draws: int, pattern: str = ""
) -> Iterator[Trial]:
    """Fit every case whose id holds ``pattern`` from its first ``draws`` starts at ``degrees``.

    The free-body chart is used throughout: the starts are off in rotation and place.
    """
    cases = json.loads((folder / "cases.json").read_text())["cases"]
    starts = json.loads((folder / "starts.json").read_text())
    for case in cases:
        if pattern not in case["id"]:
            continue
        wanted = [
            start
            for start in starts
            if start["case"] == case["id"] and start["degrees"] == degrees and start["draw"] < draws
        ]
        yield from _fit_case(folder, case, wanted, settings)


def _fit_case(
    folder: Path, case: dict[str, Any], starts: Sequence[dict[str, Any]], settings: FitSettings
) -> Iterator[Trial]:
    photo = load_photo(folder / case["photo"])
    mesh = load_mesh(folder / case["mesh"])
    renderer = make_renderer(mesh)
    camera = camera_from_integer_centres(
        Perspective(**case["camera"], width=photo.width, height=photo.height)
    )
    truth = Pose(camera, _transform(case["camera_from_model"]))
    for start in starts:
        pose = Pose(camera, _transform(start["camera_from_model"]))
        attributes = make_photo_attributes(photo, mesh, pose, settings)
        chart, _ = choose_chart("free-body", mesh, None, pose)
        problem = FitProblem(
            attributes, chart, chart.from_pose(pose), (), settings.rules, settings.limits
        )
        *_, end = fit_pose(problem, renderer)
        yield Trial(
            case["set"],
            case["id"],
            start["degrees"],
            start["draw"],
            pose_error(mesh, pose, truth).percent,
            pose_error(mesh, end.pose, truth).percent,
            end.start_loss,
            end.loss,
            registration_loss(renderer.moments(truth, attributes)),
            end.evaluations,
            end.seconds,
            end.status.name,
        )


def _transform(data: dict[str, Any]) -> RigidTransform:
    return RigidTransform(nearest_rotation(np.array(data["rotation"])), data["translation"])


def summary(trials: Sequence[Trial]) -> str:
    """A line for each set: medians of the errors in per cent, and how many fits improved."""
    lines = [f"{'set':14}{'fits':>5}{'start %':>9}{'end %':>8}{'improved':>10}{'below truth':>13}"]
    for name in dict.fromkeys(trial.set for trial in trials):
        some = [trial for trial in trials if trial.set == name]
        before = np.median([trial.error_percent_start for trial in some])
        after = np.median([trial.error_percent_end for trial in some])
        better = np.mean([t.error_percent_end < t.error_percent_start for t in some])
        below = np.mean([t.loss_end < t.loss_truth for t in some])
        lines.append(f"{name:14}{len(some):5}{before:9.2f}{after:8.2f}{better:10.0%}{below:13.0%}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the starts, a line of CSV each on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--degrees", type=int, default=5)
    parser.add_argument("--draws", type=int, default=1)
    parser.add_argument("--cases", default="", help="only those whose id holds this text")
    parser.add_argument("--grey", action="store_true")
    parser.add_argument("--colour-reflectance", action="store_true")
    parser.add_argument("--pixels", choices=("near", "whole", "clip"), default="near")
    options = parser.parse_args(arguments)
    for name in ("cases.json", "starts.json"):
        if not (options.folder / name).is_file():
            parser.error(f"{options.folder} holds no {name}; name a folder of real cases")
    settings = FitSettings(
        colour_reflectance=options.colour_reflectance, grey=options.grey, pixels=options.pixels
    )
    table = csv.DictWriter(sys.stdout, list(Trial.__slots__))
    table.writeheader()
    trials = []
    for trial in run_trials(
        options.folder, settings, options.degrees, options.draws, options.cases
    ):
        trials.append(trial)
        table.writerow(asdict(trial))
        sys.stdout.flush()
    sys.stderr.write(summary(trials) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
