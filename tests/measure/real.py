"""Photos with known poses: ``python -m tests.measure.real [FOLDER ...]``, a line of CSV per trial
on standard output and one table by set at the end.

Plain: fits from the starts of ``starts.json``. ``--start``: automatic starts, in a careless
rectangle and in the whole photo, and the fits from them. ``--views``: fits by one photo and, from
the same start, by sets of photos 30 degrees apart or more. Folders (by default $POSEVIEWER_DATA or
../shared/data, and its ``clutter``) hold ``cases.json`` and ``starts.json``; for ``--views`` also
LINEMOD-Occlusion, where the annotations of one object tell how the camera moved while another is
fitted, in photos between which the two moved together.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from poseviewer.api import load_views, make_case
from poseviewer.cli.options import listed, whole
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError
from poseviewer.evaluation.cases import CASES, Case, load_cases, load_starts
from poseviewer.evaluation.trials import open_model, open_photo
from poseviewer.files.formats.bop import MODEL_FILE, load_bop_images
from poseviewer.files.photo import load_photo
from poseviewer.files.view_set import SetChoice, load_view_set
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import PoseError, pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from poseviewer.geometry.view_set import View, ViewSet
from poseviewer.render.pool import processors
from poseviewer.starts.automatic import StartQuery, best_start, outermost_points, propose
from poseviewer.starts.views import box_of

DATA = Path(os.environ.get("POSEVIEWER_DATA") or Path(__file__).parents[3] / "shared" / "data")
START_DEG, START_PERCENT = 15.0, 15.0
"""Largest errors of a right start: a search from there can be hoped to end well."""
MARGIN = 0.1
"""Largest distance of a side of the careless rectangle from the object's box, by its size."""
WRONG_PERCENT = 2.0
"""Error beyond the truth's accuracy from which a pose called found is wrong."""
SCENE = Path("test") / "000002"
APART_DEG, MAX_VIEWS = 30.0, 8
"""Least angle between photos of a set, and its largest number of photos."""
MIN_SEEN = 0.5
"""Share of the model seen in each photo of a set with exact poses."""
MOVED_MM, MOVED_DEG = 3.0, 1.0
"""Largest motion between two objects of LINEMOD-Occlusion within a set."""
START_DEVIATIONS = 0.1, 0.1, 0.1, 0.06, 0.06, 0.03
"""Of starts on LINEMOD-Occlusion, in the free-body chart: 10 degrees in all, a tenth of the radius,
3 % of the distance."""
Row = TypeVar("Row")


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
    verdict: str
    is_wrong: bool
    """Whether the end is more than ``WRONG_PERCENT`` beyond the truth's accuracy off."""
    seconds: float
    """Of the search for starts; of the fit where there is none."""
    proposals: int = 0
    right_proposal: int = 0
    """Number of the first right one, from 1; 0: none."""
    is_taken_right: bool = False


def is_tuning(name: str) -> bool:
    """Whether a case is of the half that methods are tuned on, by a hash of its name."""
    return hashlib.sha256(name.encode()).digest()[0] % 2 == 0


def fit_trials(cases: Sequence[Case], folder: Path, degrees: Sequence[int]) -> Iterator[Trial]:
    """Fits from the first start of each case at each deviation."""
    starts = {(s.case, s.degrees): s.camera_from_model for s in load_starts(folder, degrees, 1)}
    for case in cases:
        for off in degrees:
            start = Pose(case.truth.camera, starts[case.name, off])
            yield _fit(case, start, f"{off} deg", FitSettings(chart="free-body"))


def start_trials(cases: Sequence[Case]) -> Iterator[Trial]:
    """Automatic starts with a rectangle and without, and the fits from them."""
    for case in cases:
        model, renderer = open_model(case.mesh)
        photo, camera = open_photo(case.photo), case.truth.camera
        box = careless_box(case.name, model.mesh, case.truth)
        for way, rectangle in (("rectangle", box), ("whole photo", None)):
            query = StartQuery(photo, model.mesh, model.keypoints, camera, rectangle)
            began = time.perf_counter()
            proposals = propose(query, renderer)
            seconds = time.perf_counter() - began
            errors = [pose_error(model.mesh, one.pose, case.truth) for one in proposals.found]
            taken = best_start(query, proposals, renderer, lambda: None).pose
            yield replace(
                _fit(case, taken, way, FitSettings()),
                seconds=seconds,
                proposals=len(errors),
                right_proposal=next((i for i, e in enumerate(errors, 1) if is_right(e)), 0),
                is_taken_right=is_right(pose_error(model.mesh, taken, case.truth)),
            )


def is_right(error: PoseError) -> bool:
    """Whether a search from there can be hoped to end well."""
    return error.rotation_deg <= START_DEG and error.percent <= START_PERCENT


def careless_box(name: str, mesh: Mesh, truth: Pose) -> Rectangle:
    """Rectangle about the object as a careless person draws it, the same for a case each time, px.

    Each side lies up to a tenth of the object's size outside its box.
    """
    box = box_of(truth, outermost_points(mesh))
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
    left, top, right, bottom = np.random.default_rng(seed).uniform(0.0, MARGIN, 4)
    wide = (
        box.left - left * box.width,
        box.top - top * box.height,
        box.width * (1.0 + left + right),
        box.height * (1.0 + top + bottom),
    )
    return Rectangle(*map(round, wide))


def _fit(case: Case, start: Pose, way: str, settings: FitSettings) -> Trial:
    model, renderer = open_model(case.mesh)
    registration = Registration(
        open_photo(case.photo), model.mesh, model.name, "", model.keypoints, start, (),
        whole_symmetry=model.whole_symmetry,
    )  # fmt: skip
    began = time.perf_counter()
    end = make_case(registration, settings, renderer=renderer).fit(threads=processors())
    return _trial(case, way, start, end.pose, end.verdict, time.perf_counter() - began)


def _trial(
    case: Case, way: str, start: Pose, end: Pose, verdict: Verdict | None, seconds: float
) -> Trial:
    model, _ = open_model(case.mesh)
    mesh, symmetry = model.mesh, model.whole_symmetry
    error = pose_error(mesh, end, case.truth, symmetry)
    centre = case.truth.camera_from_model.apply(mesh.centre)
    distance = float(np.linalg.norm(centre))
    nearest = symmetry.nearest_pose(end, case.truth).camera_from_model
    off = nearest.apply(mesh.centre) - centre
    depth = float(off @ centre) / distance
    across = float(np.linalg.norm(off - centre * (depth / distance)))
    return Trial(
        case.group,
        way,
        case.name,
        pose_error(mesh, start, case.truth, symmetry).percent,
        error.percent,
        float(error.rotation_deg),
        100.0 * abs(depth) / distance,
        100.0 * across / mesh.diameter,
        "" if verdict is None else verdict.word,
        error.percent > case.accuracy_percent + WRONG_PERCENT,
        seconds,
    )


@dataclass(frozen=True, slots=True, eq=False)
class SetCase:
    """A case with the photos that its pose is searched in, its own first."""

    case: Case
    start: Pose
    count: int
    views: Callable[[], ViewSet]


def exact_sets(cases: Sequence[Case], folder: Path) -> Iterator[SetCase]:
    """Sets of three photos and more of one model; starts 15 degrees off."""
    starts = {s.case: s.camera_from_model for s in load_starts(folder, (15,), 1)}
    exact = [case for case in cases if case.accuracy_percent == 0.0]
    exact = [case for case in exact if case.visible is None or case.visible >= MIN_SEEN]
    for first in exact:
        chosen = [first]
        for other in exact:
            rotations = [one.truth.camera_from_model.rotation for one in chosen]
            own = other.truth.camera_from_model.rotation
            if other.mesh == first.mesh and _is_apart(own, rotations):
                chosen.append(other)
        if len(chosen) >= 3:
            start = Pose(first.truth.camera, starts[first.name])
            count = min(len(chosen), MAX_VIEWS)
            yield SetCase(first, start, count, partial(_views, chosen[:count]))


def _views(cases: Sequence[Case]) -> ViewSet:
    views = []
    for case in cases:
        camera = case.truth.camera
        assert isinstance(camera, Perspective)  # of all cases with exact poses
        photo = replace(load_photo(case.photo), camera=camera)
        views.append(View(case.photo.name, photo, case.truth.camera_from_model))
    return ViewSet("exact", tuple(views), None, 1.0)


def _is_apart(rotation: np.ndarray, others: Iterable[np.ndarray]) -> bool:
    return min(rotation_angle(one, rotation) for one in others) >= np.radians(APART_DEG)


def bop_sets(folder: Path, min_views: int) -> Iterator[SetCase]:
    """For each photo and object the set with the most photos, where these are enough."""
    images = load_bop_images(folder / SCENE).images
    placed = {image.number: {o.object_id: o.place for o in image.objects} for image in images}
    for image in images:
        first, own = image.number, placed[image.number]
        path = folder / SCENE / image.photo
        photo = load_photo(path)
        camera = replace(image.camera, width=photo.width, height=photo.height)
        for target in own:
            sets = {
                rig: _moved_together(placed, first, target, rig) for rig in own if rig != target
            }
            rig = max(sets, key=lambda rig: len(sets[rig]))
            if len(sets[rig]) < min_views:
                continue
            model = folder / "models" / MODEL_FILE.format(target)
            truth = Pose(camera, own[target])
            off = np.random.default_rng(first).normal(size=6) * START_DEVIATIONS
            start = FreeBodyChart.near(open_model(model)[0].mesh, truth).to_pose(off)
            case = Case(f"{first}-{target}-by-{rig}", "lmo_bop", path, model, truth, 6.0)
            views = partial(_bop_views, folder, sets[rig], rig)
            yield SetCase(case, start, len(sets[rig]), views)


def _bop_views(folder: Path, numbers: Sequence[int], rig: int) -> ViewSet:
    known = load_view_set(folder / SCENE, SetChoice(tuple(map(str, numbers)), None, rig))
    by_number = {int(Path(view.name).stem): view for view in known.views}
    return replace(known, views=tuple(by_number[number] for number in numbers))


def _moved_together(
    placed: dict[int, dict[int, RigidTransform]], first: int, target: int, rig: int
) -> list[int]:
    own, chosen = placed[first], [first]
    between = own[rig].inverse() @ own[target]
    for number, places in placed.items():
        if not {rig, target} <= set(places) or len(chosen) == MAX_VIEWS:
            continue
        here = places[rig].inverse() @ places[target]
        moved = float(np.linalg.norm(here.translation - between.translation))
        turned = np.degrees(rotation_angle(here.rotation, between.rotation))
        rotations = (placed[one][rig].rotation for one in chosen)
        if moved < MOVED_MM and turned < MOVED_DEG and _is_apart(places[rig].rotation, rotations):
            chosen.append(number)
    return chosen


def view_trials(sets: Iterable[SetCase], counts: Sequence[int]) -> Iterator[Trial]:
    """Fits of every case by so many photos, all from the same start."""
    for one in sets:
        model, views = open_model(one.case.mesh)[0], one.views()
        for count in (count for count in counts if count <= one.count):
            some = replace(views, views=views.views[: max(count, 2)])
            placed = load_views(some, model, one.start, view=some.views[0].name)
            began = time.perf_counter()
            if count == 1:
                alone = make_case(placed.registration.registrations[0], placed.whole.settings)
                end = alone.fit(threads=processors())
            elif len(placed.views) == count:  # all see the model
                end = placed.fit(threads=processors())
            else:
                continue
            seconds = time.perf_counter() - began
            way = f"{count} photos" if count > 1 else "1 photo"
            yield _trial(one.case, way, one.start, end.pose, end.verdict, seconds)


def summary(trials: Sequence[Trial]) -> str:
    """Line for each set and way, and for all sets: medians, shares in per cent, and numbers."""
    head = ("trials", "start %", "end %", "deg", "depth %", "across %", "in 1 %", "in 2 %",
            "in 5 %", "found", "wrong", "among", "first", "taken", "seconds")  # fmt: skip
    lines = [f"{'':34}" + "".join(f"{name:>9}" for name in head)]
    groups = {(t.set, t.way) for t in trials} | {("all", t.way) for t in trials}
    for name, way in sorted(groups, key=lambda group: (group[0] == "all", group)):
        some = [t for t in trials if t.way == way and name in (t.set, "all")]
        found = [t for t in some if t.verdict == "found"]
        medians = [
            float(np.median([getattr(t, field) for t in some]))
            for field in ("start_percent", "percent", "degrees", "depth_percent", "across_percent")
        ]
        cells = [f"{len(some)}", *(f"{value:.2f}" for value in medians)]
        cells += [f"{np.mean([t.percent <= limit for t in some]):.0%}" for limit in (1, 2, 5)]
        cells += [f"{len(found)}", f"{sum(t.is_wrong for t in found)}"]
        starts = [t for t in some if t.proposals]
        right = [t.right_proposal for t in starts]
        counts = sum(n > 0 for n in right), right.count(1), sum(t.is_taken_right for t in starts)
        cells += [f"{n}" if starts else "-" for n in counts]
        cells += [f"{np.median([t.seconds for t in some]):.2f}"]
        lines.append(f"{name + ', ' + way:34}" + "".join(f"{cell:>9}" for cell in cells))
    return "\n".join(
        [*lines, "found: by the verdict; wrong: of these; among: a right start is there"]
    )


def print_trials(trials: Iterable[Row], summarise: Callable[[Sequence[Row]], str]) -> int:
    """Print dataclasses as CSV, each as soon as it is known, and their summary on standard error.

    Returns the exit code. A trial that cannot be run ends it with a sentence.
    """
    rows: list[Row] = []
    table = csv.writer(sys.stdout)
    try:
        for row in trials:
            if not rows:
                table.writerow([field.name for field in fields(row)])  # type: ignore[arg-type]
            table.writerow(asdict(row).values())  # type: ignore[call-overload]
            sys.stdout.flush()
            rows.append(row)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    sys.stderr.write(summarise(rows) + "\n")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="*", default=[DATA, DATA / "clutter"])
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--start", action="store_true", help="automatic starts, and fits from them")
    mode.add_argument("--views", action="store_true", help="fits by several photos")
    parser.add_argument("--degrees", type=listed(whole), default=(5, 15), help="of starts (5,15)")
    parser.add_argument("--photos", type=listed(whole), default=(1, 2, 3, 4), help="(1,2,3,4)")
    parser.add_argument("--cases", default="", help="only those whose id matches")
    parser.add_argument("--sets", type=lambda text: text.split(","), help="only these, by comma")
    parser.add_argument("--seen", type=float, default=0.0, metavar="SHARE", help="least (0)")
    parser.add_argument("--half", choices=("tuning", "other"), help="only this half of the cases")
    parser.add_argument("--every", type=whole, default=1, metavar="N", help="only each N-th case")
    return print_trials(_trials(parser.parse_args(arguments)), summary)


def _trials(options: argparse.Namespace) -> Iterator[Trial]:
    for folder in options.folders:
        if options.views and not (folder / CASES).is_file():
            sets = [*bop_sets(folder, max(4, *options.photos))][:: options.every]
            yield from view_trials(sets, options.photos)
            continue
        cases = [
            case
            for case in load_cases(folder, options.cases)
            if (options.sets is None or case.set in options.sets)
            and (case.visible is None or case.visible >= options.seen)
            and (options.half is None or is_tuning(case.name) is (options.half == "tuning"))
        ]
        if options.views:
            sets = [*exact_sets(cases, folder)][:: options.every]
            yield from view_trials(sets, options.photos)
        elif options.start:
            yield from start_trials(cases[:: options.every])
        else:
            yield from fit_trials(cases[:: options.every], folder, options.degrees)


if __name__ == "__main__":
    sys.exit(main())
