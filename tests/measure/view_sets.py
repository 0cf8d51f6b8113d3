"""How far off fits end by one photo and by several, on LINEMOD-Occlusion.

``python -m tests.measure.view_sets DATA/lmo_bop`` takes the camera's motion from the annotation of
one object and fits another by 1, 2, 4 and 8 photos that differ by 30 degrees or more. The objects
were moved between the photos: those belong to a set in which the annotations of both keep their
places to one another. It prints how far off each fit ends in the first photo, along the line of
sight and across it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.api import load, load_views
from poseviewer.cli.options import listed, whole
from poseviewer.files.formats.bop import MODEL_FILE, BopImage, load_bop_images
from poseviewer.files.view_set import SetChoice, load_view_set
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from poseviewer.render.pool import processors
from poseviewer.starts.registration import load_model
from tests.measure.trial_table import print_trials

SCENE = Path("test") / "000002"
APART_DEG = 30.0
"""Between any two photos of a set."""
KEPT_MM, KEPT_DEG = 3.0, 1.0
"""By how much the objects' places to one another may differ within a set."""
OFF = (0.1, 0.1, 0.1, 0.06, 0.06, 0.03)
"""Standard deviations of the starts in the free-body chart: 10 degrees in all, a tenth of the
radius, 3 % of the distance."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One fit."""

    image: int
    object_id: int
    rig: int
    """The object that tells how the camera moved."""
    photos: int
    start_depth: float
    """mm along the line of sight; so the next."""
    depth: float
    across: float
    """mm."""
    degrees: float
    verdict: str


@dataclass(frozen=True, slots=True)
class Case:
    """Photos that a set is made of, the first one first."""

    images: tuple[int, ...]
    object_id: int
    rig: int


def find_cases(images: Sequence[BopImage], most: int = 8) -> list[Case]:
    """For each photo and object the rig with the most photos, where these are four or more."""
    found = []
    placed = {image.number: {o.object_id: o.place for o in image.objects} for image in images}
    for first, own in placed.items():
        for target in own:
            cases = [_case(placed, first, target, rig, most) for rig in own if rig != target]
            best = max(cases, key=lambda case: len(case.images))
            if len(best.images) >= 4:
                found.append(best)
    return found


def _case(
    placed: dict[int, dict[int, RigidTransform]], first: int, target: int, rig: int, most: int
) -> Case:
    own, chosen = placed[first], [first]
    between = own[rig].inverse() @ own[target]
    for number, places in placed.items():
        if not {rig, target} <= set(places) or len(chosen) == most:
            continue
        here = places[rig].inverse() @ places[target]
        moved = float(np.linalg.norm(here.translation - between.translation))
        turned = np.degrees(rotation_angle(here.rotation, between.rotation))
        apart = [rotation_angle(places[rig].rotation, placed[n][rig].rotation) for n in chosen]
        if moved < KEPT_MM and turned < KEPT_DEG and np.degrees(min(apart)) >= APART_DEG:
            chosen.append(number)
    return Case(tuple(chosen), target, rig)


def run_trials(folder: Path, counts: Sequence[int], every: int) -> Iterator[Trial]:
    """Fits of every so many-th case, by so many photos, all from the same start."""
    scene = load_bop_images(folder / SCENE)
    for case in find_cases(scene.images)[::every]:
        model = load_model(folder / "models" / MODEL_FILE.format(case.object_id))
        names = tuple(map(str, case.images))
        whole_set = load_view_set(folder / SCENE, SetChoice(names, None, case.rig))
        first = next(v for v in whole_set.views if int(Path(v.name).stem) == case.images[0])
        image = next(image for image in scene.images if image.number == case.images[0])
        place = next(o.place for o in image.objects if o.object_id == case.object_id)
        truth = Pose(first.camera, place)
        off = np.random.default_rng(image.number).normal(size=6) * OFF
        start = FreeBodyChart.near(model.mesh, truth).to_pose(off)
        for count in counts:
            if count > len(names):
                continue
            if count == 1:
                path = folder / SCENE / "rgb" / first.name
                alone = load(path, model, start).fit(threads=processors())
                yield _trial(case, 1, start, alone.pose, truth, alone.verdict, model.mesh.centre)
                continue
            choice = SetChoice(names[:count], None, case.rig)
            of_set = load_views(folder / SCENE, model, start, view=first.name, choice=choice)
            found = of_set.fit(threads=processors())
            used = len(of_set.views)
            yield _trial(case, used, start, found.pose, truth, found.verdict, model.mesh.centre)


def _trial(
    case: Case,
    photos: int,
    start: Pose,
    end: Pose,
    truth: Pose,
    verdict: Verdict | None,
    centre: np.ndarray,
) -> Trial:
    at = truth.camera_from_model.apply(centre)
    sight = at / np.linalg.norm(at)
    began, ended = (pose.camera_from_model.apply(centre) - at for pose in (start, end))
    turned = rotation_angle(end.camera_from_model.rotation, truth.camera_from_model.rotation)
    return Trial(
        case.images[0],
        case.object_id,
        case.rig,
        photos,
        float(began @ sight),
        float(ended @ sight),
        float(np.linalg.norm(ended - sight * (ended @ sight))),
        float(np.degrees(turned)),
        "" if verdict is None else verdict.word,
    )


def summary(found: Sequence[Trial]) -> str:
    """Medians for each number of photos, of all fits and of those that are ``found``."""
    lines = [f"{'photos':>6}{'fits':>6}{'depth mm':>10}{'across mm':>11}{'degrees':>9}{'found':>7}"]
    for count in sorted({one.photos for one in found}):
        own = [one for one in found if one.photos == count]
        numbers = [(abs(one.depth), one.across, one.degrees) for one in own]
        depth, across, degrees = np.median(numbers, axis=0)
        share = sum(one.verdict == "found" for one in own) / len(own)
        lines.append(f"{count:6}{len(own):6}{depth:10.1f}{across:11.1f}{degrees:9.1f}{share:7.0%}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each fit on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photos", type=listed(whole), default=(1, 2, 4, 8))
    parser.add_argument("--every", type=whole, default=1, help="case")
    options = parser.parse_args(arguments)
    return print_trials(run_trials(options.folder, options.photos, options.every), summary)


if __name__ == "__main__":
    sys.exit(main())
