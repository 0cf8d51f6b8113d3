"""How far off fits end by one photo and by several, on photos with known poses.

``python -m tests.measure.view_sets FOLDER`` fits by one photo, and from the same start by sets of
photos that differ by 30 degrees or more. In a folder of ``cases.json`` (as of ``poseviewer study``)
with exact poses, they are photos of one model, whose frame is the set's, and the starts are its
own, 15 degrees off. In a folder of ``views.json`` (as of ``assets/source/photograph.py round``)
they are that set's, whose frame is the demo car's, and starts are drawn as those are; of
``MODEL.views.json`` (as of ``photograph.py table``), those of each model, which is found below
``--models``. In the folder
of LINEMOD-Occlusion one object's annotations tell how the camera
moved, and another is fitted; the objects were moved between the photos, so that those belong to a
set in which the annotations of both keep their places to one another. It prints how far off each
fit ends in the first photo, along the line of sight and across it, of equal poses the nearest.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.api import load_views, make_case
from poseviewer.cli.options import listed, whole
from poseviewer.errors import PoseViewerError
from poseviewer.evaluation.real_cases import CASES, RealCase, load_cases, load_starts
from poseviewer.files.demo import demo_case
from poseviewer.files.formats.bop import MODEL_FILE, load_bop_images
from poseviewer.files.photo import load_photo
from poseviewer.files.view_set import SetChoice, load_view_set
from poseviewer.fit.registration import LoadedModel
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.pose_covariance import PoseCovariance
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from poseviewer.geometry.view_set import View, ViewSet
from poseviewer.render.pool import processors
from poseviewer.starts.registration import load_model
from tests.measure.trial_table import print_trials

SCENE = Path("test") / "000002"
APART_DEG = 30.0
"""Between any two photos of a set."""
KEPT_MM, KEPT_DEG = 3.0, 1.0
"""By how much the objects' places to one another may differ within a set."""
OFF = (0.1, 0.1, 0.1, 0.06, 0.06, 0.03)
"""Standard deviations of the starts on LINEMOD-Occlusion, in the free-body chart: 10 degrees in
all, a tenth of the radius, 3 % of the distance."""
LEAST_SEEN = 0.5
"""Share of the model that nothing hides in a photo with exact poses."""
MOST_PHOTOS = 8
VIEWS = "views.json"
START_DEG = 15.0
"""Of starts that are drawn; they are shifted as those of ``cases.json`` are: by a normal deviate of
7.5 % of the diameter across the line of sight, and twice that along it."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One fit."""

    name: str
    """Of the first photo and the model."""
    photos: int
    distance: float
    """In the model's unit; so all lengths."""
    diameter: float
    start_depth: float
    """Along the line of sight; so the next."""
    depth: float
    across: float
    degrees: float
    verdict: str
    probabilities: str
    """By each photo alone."""
    right_px: float
    """Of the model's centre in the first photo; so the next."""
    down_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Photos that a set is made of, the first one first, and the pose in that."""

    name: str
    views: Callable[[], ViewSet]
    count: int
    model: Path
    truth: Pose
    start: Pose


def exact_cases(folder: Path, draw: int = 0) -> Iterator[Case]:
    """Sets of photos of one model that need not show the same things about it."""
    cases = [c for c in load_cases(folder) if c.accuracy_percent == 0.0]
    cases = [c for c in cases if c.visible is None or c.visible >= LEAST_SEEN]
    drawn = load_starts(folder, (15,), draw + 1)
    starts = {one.case: one.camera_from_model for one in drawn if one.draw == draw}
    for first in cases:
        chosen = [first]
        for other in cases:
            if other.mesh == first.mesh and len(chosen) < MOST_PHOTOS and _is_apart(other, chosen):
                chosen.append(other)
        if len(chosen) >= 3:
            start = replace(first.truth, camera_from_model=starts[first.name])
            count = len(chosen)

            def views(chosen: Sequence[RealCase] = chosen) -> ViewSet:
                return ViewSet("exact", tuple(map(_view, chosen)), None, 1.0)

            yield Case(first.name, views, count, first.mesh, first.truth, start)


def _is_apart(other: RealCase, chosen: Sequence[RealCase]) -> bool:
    places = [one.truth.camera_from_model for one in chosen]
    return _differs(other.truth.camera_from_model, places)


def _differs(own: RigidTransform, others: Sequence[RigidTransform]) -> bool:
    angles = [rotation_angle(one.rotation, own.rotation) for one in others]
    return bool(np.degrees(min(angles)) >= APART_DEG)


def set_cases(folder: Path, draw: int = 0, models: Path = Path()) -> Iterator[Case]:
    """Every photo of each set in the folder, with those of the set that are apart from it."""
    for path in sorted(folder.glob(f"*{VIEWS}")):
        name = path.name.removesuffix(VIEWS).removesuffix(".")
        model = demo_case("perspective").model if not name else _model_below(models, name)
        yield from _cases_of_set(path, name, model, draw)


def _model_below(folder: Path, name: str) -> Path:
    for path in sorted(folder.rglob(f"{name}.ply")):
        return path
    raise PoseViewerError(f"--models {folder}: no {name}.ply below it; name the models' folder.")


def _cases_of_set(path: Path, name: str, model: Path, draw: int) -> Iterator[Case]:
    known, mesh = load_view_set(path), load_model(model).mesh
    for number, first in enumerate(known.views):
        chosen = [first]
        for other in known.views:
            if _differs(other.camera_from_set, [one.camera_from_set for one in chosen]):
                chosen.append(other)
        truth = Pose(first.camera, first.camera_from_set)
        random = np.random.default_rng((draw, number))
        axis, shift = random.normal(size=3), random.normal(size=3)
        off = np.radians(START_DEG) * axis / np.linalg.norm(axis)
        sigma = mesh.diameter * START_DEG / 200.0 * np.array([1.0, 1.0, 2.0])
        sure = PoseCovariance(truth, mesh.centre, np.eye(6))
        start = sure.moved(np.concatenate([off, sigma * shift]))

        def views(chosen: Sequence[View] = chosen) -> ViewSet:
            return replace(known, views=tuple(chosen), unit=None, scale=1.0)

        title = f"{name}-{first.name}".removeprefix("-")
        yield Case(title, views, len(chosen), model, truth, start)


def _view(case: RealCase) -> View:
    camera = case.truth.camera
    assert isinstance(camera, Perspective)  # of all cases with exact poses
    photo = replace(load_photo(case.photo), camera=camera)
    return View(case.photo.name, photo, case.truth.camera_from_model)


def bop_cases(folder: Path, least: int = 4, apart_deg: float = APART_DEG) -> Iterator[Case]:
    """For each photo and object the rig with the most photos, where these are ``least`` or more."""
    images = load_bop_images(folder / SCENE).images
    placed = {image.number: {o.object_id: o.place for o in image.objects} for image in images}
    for image in images:
        first, own = image.number, placed[image.number]
        photo = load_photo(folder / SCENE / image.photo)
        camera = replace(image.camera, width=photo.width, height=photo.height)
        for target in own:
            sets = {
                rig: _chosen(placed, first, target, rig, apart_deg) for rig in own if rig != target
            }
            rig = max(sets, key=lambda rig: len(sets[rig]))
            names = tuple(map(str, sets[rig]))
            if len(names) < least:
                continue

            def views(names: tuple[str, ...] = names, rig: int = rig) -> ViewSet:
                found = load_view_set(folder / SCENE, SetChoice(names, None, rig))
                by_name = {str(int(Path(one.name).stem)): one for one in found.views}
                return replace(found, views=tuple(by_name[name] for name in names))

            model = folder / "models" / MODEL_FILE.format(target)
            truth = Pose(camera, own[target])
            off = np.random.default_rng(first).normal(size=6) * OFF
            start = FreeBodyChart.near(load_model(model).mesh, truth).to_pose(off)
            yield Case(f"{first}-{target}-by-{rig}", views, len(names), model, truth, start)


def _chosen(
    placed: dict[int, dict[int, RigidTransform]],
    first: int,
    target: int,
    rig: int,
    apart_deg: float,
) -> list[int]:
    own, chosen = placed[first], [first]
    between = own[rig].inverse() @ own[target]
    for number, places in placed.items():
        if not {rig, target} <= set(places) or len(chosen) == MOST_PHOTOS:
            continue
        here = places[rig].inverse() @ places[target]
        moved = float(np.linalg.norm(here.translation - between.translation))
        turned = np.degrees(rotation_angle(here.rotation, between.rotation))
        apart = [rotation_angle(places[rig].rotation, placed[n][rig].rotation) for n in chosen]
        if moved < KEPT_MM and turned < KEPT_DEG and np.degrees(min(apart)) >= apart_deg:
            chosen.append(number)
    return chosen


def run_trials(cases: Sequence[Case], counts: Sequence[int]) -> Iterator[Trial]:
    """Fits of every case by so many photos, all from the same start."""
    for case in cases:
        model, views = load_model(case.model), case.views()
        for count in counts:
            if count > case.count:
                continue
            some = replace(views, views=views.views[: max(count, 2)])
            of_set = load_views(some, model, case.start, view=some.views[0].name)
            if count == 1:
                alone = make_case(of_set.registration.registrations[0], of_set.whole.settings)
                found = alone.fit(threads=processors())
                yield _trial(case, model, 1, found.pose, found.verdict)
            elif len(of_set.views) == count:  # all see the model
                ended = of_set.fit(threads=processors())
                yield _trial(case, model, count, ended.pose, ended.verdict)


def _trial(
    case: Case, model: LoadedModel, photos: int, end: Pose, verdict: Verdict | None
) -> Trial:
    centre = model.mesh.centre
    end = model.whole_symmetry.nearest_pose(end, case.truth)
    at = case.truth.camera_from_model.apply(centre)
    distance = float(np.linalg.norm(at))
    began, ended = (pose.camera_from_model.apply(centre) - at for pose in (case.start, end))
    depth = float(ended @ at) / distance
    rotations = (pose.camera_from_model.rotation for pose in (end, case.truth))
    each = () if verdict is None else verdict.views or (verdict,)
    return Trial(
        case.name,
        photos,
        distance,
        model.mesh.diameter,
        float(began @ at) / distance,
        depth,
        float(np.linalg.norm(ended - at * (depth / distance))),
        float(np.degrees(rotation_angle(*rotations))),
        "" if verdict is None else verdict.word,
        " ".join(f"{one.probability:.3f}" for one in each),
        *map(float, (end.project(centre[None]) - case.truth.project(centre[None]))[0]),
    )


def summary(found: Sequence[Trial]) -> str:
    """Medians for each number of photos, and how many are within what is asked for."""
    head = ("photos", "fits", "depth %", "across %", "degrees", "found", "within")
    lines = ["".join(f"{name:>10}" for name in head)]
    for count in sorted({one.photos for one in found}):
        own = [one for one in found if one.photos == count]
        depth = np.array([100.0 * abs(one.depth) / one.distance for one in own])
        across = np.array([100.0 * one.across / one.diameter for one in own])
        within = float(np.mean((depth <= 0.3) & (across <= 0.2)))
        degrees = float(np.median([one.degrees for one in own]))
        share = sum(one.verdict == "found" for one in own) / len(own)
        lines.append(
            f"{count:10}{len(own):10}{np.median(depth):10.3f}{np.median(across):10.3f}"
            f"{degrees:10.2f}{share:10.0%}{within:10.0%}"
        )
    return "\n".join([*lines, "within: 0.3 % of the distance, across 0.2 % of the size"])


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each fit on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photos", type=listed(whole), default=(1, 2, 3, 4))
    parser.add_argument("--every", type=whole, default=1, help="case")
    parser.add_argument("--first", type=whole, default=1, help="the case to begin with")
    parser.add_argument("--cases", type=whole, help="largest number of cases (all)")
    parser.add_argument("--draw", type=whole, default=1, help="of the starts, where they are drawn")
    parser.add_argument(
        "--apart", type=float, default=APART_DEG, help="least degrees between photos (LINEMOD)"
    )
    parser.add_argument("--models", type=Path, default=Path(), help="folder of a table's models")
    options = parser.parse_args(arguments)
    folder, draw = options.folder, options.draw - 1
    if any(folder.glob(f"*{VIEWS}")):
        known = set_cases(folder, draw, options.models)
    else:
        is_exact = (folder / CASES).is_file()
        of_bop = max(4, *options.photos), options.apart
        known = exact_cases(folder, draw) if is_exact else bop_cases(folder, *of_bop)
    cases = list(known)[options.first - 1 :: options.every][: options.cases]
    return print_trials(run_trials(cases, options.photos), summary)


if __name__ == "__main__":
    sys.exit(main())
