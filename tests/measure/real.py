"""Photos with known poses: ``python -m tests.measure.real [FOLDER ...]``, a line of CSV per trial
on standard output and one table by set at the end.

Trials are automatic starts in the whole photo and in a careless rectangle, and the fits from them.
``--start``: of what is seen to 90 % or more, and of ``lmo``, alone. ``--views``: fits by
one photo and, from the same start, by sets of photos 30 degrees apart or more, where poses are
exact. Folders hold ``cases.json`` and ``starts.json``; by default $POSEVIEWER_DATA or
../shared/data, and its ``clutter``. Fits from given starts are ``poseviewer study --real``'s.
"""

import argparse
import csv
import hashlib
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from assets.source.data_folder import DATA
from poseviewer.api import FitResult, load
from poseviewer.cli.options import list_of, whole
from poseviewer.confidence.pose_covariance import region_reach
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError, QuickStartError
from poseviewer.evaluation.cases import Case, load_cases, load_starts, visibility_label
from poseviewer.evaluation.trials import fetch_model, fetch_photo
from poseviewer.files.photo import load_photo
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import PoseError, pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import rotation_angle
from poseviewer.opening.photo_sets import LoadedViews, SetChoice
from poseviewer.render.pool import processors
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.types import View
from poseviewer.starts.automatic import (
    PoseHypothesis,
    StartQuery,
    best_start,
    outermost_points,
    outline_box,
    propose,
)
from poseviewer.starts.start import Start, StartInputs

START_DEG, START_PERCENT = 15.0, 15.0
"""Largest errors of a right start: a search from there can be hoped to end well."""
MARGIN = 0.1
"""Largest distance of a side of the careless rectangle from the object's box, by its size."""
WRONG_PERCENT = 2.0
"""Error beyond the truth's accuracy from which a pose called found is wrong."""
APART_DEG = 30.0
"""Least angle between photos of a set."""
MIN_SEEN, NEARLY_WHOLE = 0.5, 0.9
"""Share of the model seen in each photo of a set with exact poses; in those of ``--start``."""
NO_FIT = (np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, "", False)
"""Errors, verdict and ``is_wrong`` where no start was found."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A fit, and perhaps the automatic start before it."""

    set: str
    way: str
    case: str
    start_percent: float
    """Mean distance of the vertices in the photo, by the object's size there."""
    percent: float
    degrees: float
    depth_percent: float
    """Distance along the line of sight, by that from the camera."""
    across_percent: float
    """Distance across the line of sight, by the model's diameter."""
    deviations: float
    """Distance by the covariance, in standard deviations; nan where the fit has none."""
    verdict: str
    is_wrong: bool
    """Whether the end is more than ``WRONG_PERCENT`` beyond the truth's accuracy off."""
    seconds: float
    """Of the search for starts; of the fit where there is none."""
    proposals: int = 0
    right_proposal: int = 0
    """Number of the first right one, from 1; 0: none."""
    is_taken_right: bool = False
    probability: float = np.nan
    """Stated probability of the first proposal."""


def is_tuning(name: str) -> bool:
    """Whether a case is of the half that methods are tuned on, by a hash of its name."""
    return hashlib.sha256(name.encode()).digest()[0] % 2 == 0


def start_trials(cases: Sequence[Case], features: Path | None = None) -> Iterator[Trial]:
    """Automatic starts in the whole photo and in a rectangle, and the fits from them.

    With a network of ``features`` in the whole photo alone.
    """
    for case in cases:
        model, renderer = fetch_model(case.mesh)
        photo, camera = fetch_photo(case.photo), case.truth.camera
        inputs = StartInputs(photo, model.mesh, model.keypoints)
        for box in (None, careless_box(case.name, model.mesh, case.truth))[: 1 if features else 2]:
            query = StartQuery(inputs, camera, box, features=features)
            began, proposals = time.perf_counter(), list[PoseHypothesis]()
            with suppress(QuickStartError):  # nothing was found
                proposals = propose(query, renderer)
            seconds = time.perf_counter() - began
            way = "whole photo" if box is None else "rectangle"
            if not proposals:
                yield Trial(_set_of(case), way, case.name, *NO_FIT, seconds)
                continue
            errors = [pose_error(model.mesh, proposal.pose, case.truth) for proposal in proposals]
            taken = best_start(query, proposals, renderer)
            yield replace(
                _fit(case, taken, way),
                seconds=seconds,
                proposals=len(errors),
                right_proposal=next((i for i, e in enumerate(errors, 1) if is_right(e)), 0),
                is_taken_right=is_right(pose_error(model.mesh, taken.pose, case.truth)),
                probability=proposals[0].probability,
            )


def _set_of(case: Case) -> str:
    return case.set + f", {visibility_label(case.visible)}" * (case.visible >= 0.0)


def is_right(error: PoseError) -> bool:
    """Whether a search from there can be hoped to end well."""
    return error.rotation_deg <= START_DEG and error.percent <= START_PERCENT


def careless_box(name: str, mesh: Mesh, truth: Pose) -> Rectangle:
    """Rectangle about the object as a careless person draws it, the same for a name, px."""
    box = outline_box(truth, outermost_points(mesh))
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
    left, top, right, bottom = np.random.default_rng(seed).uniform(0.0, MARGIN, 4)
    wide = (
        box.left - left * box.width,
        box.top - top * box.height,
        box.width * (1.0 + left + right),
        box.height * (1.0 + top + bottom),
    )
    return Rectangle(*map(round, wide))


def _fit(case: Case, start: Start, way: str) -> Trial:
    model, renderer = fetch_model(case.mesh)
    registration = load(case.photo, model, lambda _: start, renderer=renderer)
    began = time.perf_counter()
    end = registration.fit(threads=processors())
    return _trial(case, way, start.pose, end, time.perf_counter() - began)


def _trial(case: Case, way: str, start: Pose, end: FitResult, seconds: float) -> Trial:
    model, _ = fetch_model(case.mesh)
    mesh, symmetry = model.mesh, model.symmetry
    error = pose_error(mesh, end.pose, case.truth, symmetry)
    centre = case.truth.camera_from_model.apply(mesh.centre)
    distance = float(np.linalg.norm(centre))
    nearest = symmetry.nearest_pose(end.pose, case.truth).camera_from_model
    off = nearest.apply(mesh.centre) - centre
    depth = float(off @ centre) / distance
    across = float(np.linalg.norm(off - centre * (depth / distance)))
    sure, deviations = end.covariance, np.nan
    if sure is not None and "depth" in sure.deviations:
        away = sure.deviation(case.truth)
        deviations = float(np.sqrt(away @ np.linalg.solve(sure.matrix, away)))
    return Trial(
        _set_of(case),
        way,
        case.name,
        pose_error(mesh, start, case.truth, symmetry).percent,
        error.percent,
        float(error.rotation_deg),
        100.0 * abs(depth) / distance,
        100.0 * across / mesh.diameter,
        deviations,
        "" if end.verdict is None else end.verdict.label,
        error.percent > case.accuracy_percent + WRONG_PERCENT,
        seconds,
    )


def view_trials(
    cases: Sequence[Case], folder: Path, counts: Sequence[int], every: int
) -> Iterator[Trial]:
    """Fits by so many photos of one model as there are, all from the start 15 degrees off."""
    starts = {s.case: s.camera_from_model.rigid for s in load_starts(folder, (15,), 1)}
    exact = [case for case in cases if case.accuracy_percent == 0.0]
    exact = [case for case in exact if not case.visible < MIN_SEEN]  # nan: unknown
    for first in exact[::every]:
        chosen = [first]
        for other in exact:
            angles = [rotation_angle(_rotation(one), _rotation(other)) for one in chosen]
            if other.mesh == first.mesh and np.degrees(min(angles)) >= APART_DEG:
                chosen.append(other)
        if len(chosen) < 3:
            continue
        model, start = fetch_model(first.mesh)[0], Pose(first.truth.camera, starts[first.name])
        for count in (count for count in counts if count <= len(chosen)):
            if count == 1:
                yield _fit(first, Start(start, ()), "1 photo")
                continue
            views = LoadedViews("exact", tuple(map(_view, chosen[:count])), None, 1.0)
            choice = SetChoice(view=views.views[0].name)
            placed = load(views, model, start, choice=choice)
            if len(placed.views) < count:  # one does not see the model
                continue
            began = time.perf_counter()
            end = placed.fit(threads=processors())
            seconds = time.perf_counter() - began
            yield _trial(first, f"{count} photos", start, end, seconds)


def _rotation(case: Case) -> FloatArray:
    return case.truth.camera_from_model.rotation


def _view(case: Case) -> View:
    camera = case.truth.camera
    assert isinstance(camera, Perspective)  # of all cases with exact poses
    photo = replace(load_photo(case.photo), camera=camera)
    return View(PhotoFile.of(photo, case.photo), camera, case.truth.camera_from_model)


def summary(trials: Sequence[Trial]) -> str:
    """Line for each set and way, and for all sets: medians, shares in per cent, and numbers."""
    head = ("trials", "start %", "end %", "deg", "depth %", "across %", "in 1 %", "in 2 %",
            "in 5 %", "found", "wrong", "inside", "among", "first", "taken", "seconds")  # fmt: skip
    lines = [f"{'':34}" + "".join(f"{name:>9}" for name in head)]
    groups = {(t.set, t.way) for t in trials} | {("all", t.way) for t in trials}
    for name, way in sorted(groups, key=lambda group: (group[0] == "all", group)):
        some = [t for t in trials if t.way == way and name in (t.set, "all")]
        found = [t for t in some if t.verdict == "found"]
        medians = [
            _median([getattr(t, field) for t in some])
            for field in ("start_percent", "percent", "degrees", "depth_percent", "across_percent")
        ]
        cells = [f"{len(some)}", *(f"{value:.2f}" for value in medians)]
        cells += [f"{np.mean([t.percent <= limit for t in some]):.0%}" for limit in (1, 2, 5)]
        cells += [f"{len(found)}", f"{sum(t.is_wrong for t in found)}"]
        sure = np.array([t.deviations for t in found if not np.isnan(t.deviations)])
        cells.append(f"{np.mean(sure <= region_reach(6)):.0%}" if len(sure) else "-")
        starts = [t for t in some if t.proposals]
        right = [t.right_proposal for t in starts]
        counts = sum(n > 0 for n in right), right.count(1), sum(t.is_taken_right for t in starts)
        cells += [f"{n}" if starts else "-" for n in counts]
        cells += [f"{np.median([t.seconds for t in some]):.2f}"]
        lines.append(f"{name + ', ' + way:34}" + "".join(f"{cell:>9}" for cell in cells))
    return "\n".join(
        [*lines, "found: by the verdict; wrong: of these; among: a right start is there"]
    )


def _median(values: Sequence[float]) -> float:
    """The median of those that are known; nan where none is."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.median(known)) if known else np.nan


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="*", default=[DATA, DATA / "clutter"])
    parser.add_argument("--start", action="store_true", help="of what is seen nearly whole")
    parser.add_argument("--features", type=Path, metavar="FILE", help="weights, for whole photos")
    parser.add_argument("--views", action="store_true", help="fits by several photos")
    parser.add_argument("--photos", type=list_of(whole), default=(1, 2, 3, 4), help="(1,2,3,4)")
    parser.add_argument("--cases", default="", help="only those whose id matches")
    parser.add_argument("--half", choices=("tuning", "other"), help="only this half of the cases")
    parser.add_argument("--every", type=whole, default=1, metavar="N", help="only each N-th case")
    table = csv.DictWriter(sys.stdout, [field.name for field in fields(Trial)])
    table.writeheader()
    trials = []
    try:
        for trial in _trials(parser.parse_args(arguments)):
            table.writerow(asdict(trial))
            sys.stdout.flush()
            trials.append(trial)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    sys.stderr.write(summary(trials) + "\n")
    return 0


def _trials(options: argparse.Namespace) -> Iterator[Trial]:
    for folder in options.folders:
        cases = [
            case
            for case in load_cases(folder, options.cases)
            if (options.half is None or is_tuning(case.name) is (options.half == "tuning"))
            and not (options.start and case.set != "lmo" and case.visible < NEARLY_WHOLE)
        ]
        if options.views:
            yield from view_trials(cases, folder, options.photos, options.every)
        else:
            yield from start_trials(cases[:: options.every], options.features)


if __name__ == "__main__":
    sys.exit(main())
