"""How often a start that is proposed is the right one, on real photos with known poses.

``python -m tests.measure.auto_start FOLDER`` takes the cases of a folder with
``cases.json`` (see ``study.real_cases``). For each it draws a rectangle as a careless
person would, each side up to a tenth of the object's size outside the true one, asks for proposals,
and prints whether one of them is right: within 15 degrees, and within 15 per cent of the object's
size in the photo. ``--fit`` also makes the short fits, and says whether the one that is taken is
right. Half of the cases, told by a hash of their names, were looked at while the search was tuned.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.cli.options import whole
from poseviewer.evaluation.real_cases import RealCase, load_cases
from poseviewer.files.photo import load_photo
from poseviewer.fit.registration import LoadedModel
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import PoseError, pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.renderers import make_renderer
from poseviewer.starts.automatic import Proposals, StartQuery, best_start, outermost_points, propose
from poseviewer.starts.registration import load_model
from poseviewer.starts.views import box_of
from tests.measure.trial_table import print_trials

WITHIN_DEG, WITHIN_PERCENT = 15.0, 15.0
CARELESS = 0.1
"""A side of the rectangle lies so far outside the object's box at most, as a share of its size."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One photo, and how its proposals fared."""

    set: str
    case: str
    tuned: bool
    """Whether it is of the half that was looked at."""
    proposals: int
    right: int
    """The first that is right, from 1; 0: none."""
    degrees: float
    """How far the proposal nearest to the truth in the photo is off ..."""
    percent: float
    """... and the mean distance there, as a share of the object's size."""
    fitted_degrees: float | None
    """The same of what the short fits take; None: they were not made."""
    fitted_percent: float | None
    seconds: float
    """Of the search, without the short fits."""
    processor_s: float
    """The same as time on all processors together: what a machine with much to do still tells."""


def run_trials(
    cases: Sequence[RealCase], anywhere: bool = False, fit: bool = False
) -> Iterator[Trial]:
    """Proposals for each case, ``anywhere`` in the photo or in its rectangle."""
    models: dict[Path, LoadedModel] = {}
    for case in cases:
        if case.mesh not in models:
            models[case.mesh] = load_model(case.mesh)
        yield _trial(case, models[case.mesh], anywhere, fit)


def _trial(case: RealCase, model: LoadedModel, anywhere: bool, fit: bool) -> Trial:
    mesh = model.mesh
    box = None if anywhere else careless_box(case.name, mesh, case.truth)
    photo = load_photo(case.photo)
    wanted = StartQuery(photo, mesh, model.keypoints, case.truth.camera, box)
    renderer = make_renderer(mesh)
    began, spent = time.perf_counter(), time.process_time()
    proposals = propose(wanted, renderer)
    seconds, processor_s = time.perf_counter() - began, time.process_time() - spent
    errors = [pose_error(mesh, one.pose, case.truth) for one in proposals.found]
    nearest = min(errors, key=lambda error: error.percent)
    right = next((i for i, error in enumerate(errors, 1) if is_right(error)), 0)
    after = _taken(wanted, proposals, case) if fit else None
    return Trial(
        case.set,
        case.name,
        was_tuned(case.name),
        len(errors),
        right,
        nearest.rotation_deg,
        nearest.percent,
        None if after is None else after.rotation_deg,
        None if after is None else after.percent,
        seconds,
        processor_s,
    )


def _taken(wanted: StartQuery, proposals: Proposals, case: RealCase) -> PoseError:
    renderer = make_renderer(wanted.mesh)
    start = best_start(wanted, proposals, renderer, lambda: None)
    return pose_error(wanted.mesh, start.pose, case.truth)


def is_right(error: PoseError) -> bool:
    """Whether a search from there can be hoped to end well."""
    return error.rotation_deg <= WITHIN_DEG and error.percent <= WITHIN_PERCENT


def was_tuned(name: str) -> bool:
    """Whether a case is of the half that was looked at."""
    return hashlib.sha256(name.encode()).digest()[0] % 2 == 0


def careless_box(name: str, mesh: Mesh, truth: Pose) -> Rectangle:
    """A rectangle about the object, the same for a case each time: px."""
    box = box_of(truth, outermost_points(mesh))
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
    left, top, right, bottom = np.random.default_rng(seed).uniform(0.0, CARELESS, 4)
    wide = (
        box.left - left * box.width,
        box.top - top * box.height,
        box.width * (1.0 + left + right),
        box.height * (1.0 + top + bottom),
    )
    return Rectangle(*map(round, wide))


def summary(found: Sequence[Trial]) -> str:
    """A line for each set and half: how often one is right, the first is, the one taken is."""
    lines = [f"{'set':14}{'half':8}{'photos':>7}{'of five':>9}{'first':>7}{'taken':>7}"]
    for name in (*dict.fromkeys(one.set for one in found), "all"):
        for half, tuned in (("tuned", True), ("other", False)):
            some = [t for t in found if name in (t.set, "all") and t.tuned is tuned]
            if some:
                lines.append(_line(name, half, some))
    return "\n".join(lines)


def _line(name: str, half: str, some: Sequence[Trial]) -> str:
    among, first = sum(t.right > 0 for t in some), sum(t.right == 1 for t in some)
    pairs = [(t.fitted_degrees, t.fitted_percent) for t in some]
    known = [(d, p) for d, p in pairs if d is not None and p is not None]
    taken = str(sum(d <= WITHIN_DEG and p <= WITHIN_PERCENT for d, p in known)) if known else "-"
    return f"{name:14}{half:8}{len(some):7}{among:9}{first:7}{taken:>7}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, a line of CSV each on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", default="", help="only those whose id matches")
    parser.add_argument("--half", choices=("tuned", "other"), help="only this half")
    parser.add_argument("--every", type=whole, default=1, metavar="N", help="only each N-th")
    parser.add_argument("--anywhere", action="store_true", help="without a rectangle")
    parser.add_argument("--fit", action="store_true", help="make the short fits, too")
    options = parser.parse_args(arguments)
    return print_trials(_trials(options), summary)


def _trials(options: argparse.Namespace) -> Iterator[Trial]:
    cases = load_cases(options.folder, options.cases)
    if options.half:
        cases = [case for case in cases if was_tuned(case.name) is (options.half == "tuned")]
    yield from run_trials(cases[:: options.every], options.anywhere, options.fit)


if __name__ == "__main__":
    sys.exit(main())
