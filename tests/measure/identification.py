"""Which model is it, on real photos with known models: how often the right one comes first.

``python -m tests.measure.identification FOLDER`` takes the cases of a folder with
``cases.json`` and ``starts.json`` (see ``study.real_cases``), fits to each photo the
models of all cases of its set from the same start, and prints how often the photo's own model has
the least loss. Each model is laid with its centre where the start puts the own model's, and is
turned alike.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.cli.options import whole
from poseviewer.confidence.identify import identify
from poseviewer.errors import SettingsError
from poseviewer.evaluation.real_cases import (
    RealCase,
    RealStart,
    load_cases,
    load_starts,
    matches,
)
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from tests.measure.trial_table import print_trials

SETS = ("lmo", "hope")
"""The sets of several models whose photos show one another's surroundings."""


@dataclass(frozen=True, slots=True)
class Identification:
    """One photo, and how its own model fared among those of its set."""

    set: str
    case: str
    models: int
    rank: int
    """Of the own model, from 1."""
    loss: float
    """Of the own model."""
    best_other: str
    best_other_loss: float
    margin: float
    """By how much the best other's loss is greater; below 0: it won."""
    seconds: float


def run_identifications(
    folder: Path,
    settings: FitSettings,
    degrees: int = 10,
    pattern: str = "",
    sets: Sequence[str] = SETS,
    every: int = 1,
) -> Iterator[Identification]:
    """Identify the model of each ``every``-th case of the ``sets`` whose id matches ``pattern``.

    Raises:
        PoseViewerError: the folder holds no such cases, or no starts so far off.
    """
    cases = load_cases(folder)
    starts = {start.case: start for start in load_starts(folder, [degrees], 1)}
    chosen = {name: _chosen(cases, name, pattern, starts)[::every] for name in sets}
    if not any(chosen.values()):
        known = ", ".join(sorted({case.set for case in cases}))
        raise SettingsError(
            f"--sets {' '.join(sets)} --cases {pattern}: {folder} has no such case with a start "
            f"{degrees} degrees off; name one of its sets: {known}"
        )
    for name, some in chosen.items():
        meshes = _models(cases, name)
        for case in some:
            yield _identify_case(case, starts[case.name], meshes, settings)


def _models(cases: Sequence[RealCase], name: str) -> dict[Path, Mesh]:
    return {path: load_mesh(path) for path in {c.mesh: None for c in cases if c.set == name}}


def _chosen(
    cases: Sequence[RealCase], name: str, pattern: str, starts: Mapping[str, RealStart]
) -> list[RealCase]:
    return [c for c in cases if c.set == name and c.name in starts and matches(c.name, pattern)]


def _identify_case(
    case: RealCase, start: RealStart, meshes: dict[Path, Mesh], settings: FitSettings
) -> Identification:
    photo = load_photo(case.photo)
    pose = Pose(case.truth.camera, start.camera_from_model)
    own = meshes[case.mesh]
    ranked = identify(
        [
            Registration(photo, mesh, path.name, "", None, placed(own, mesh, pose), ())
            for path, mesh in meshes.items()
        ],
        replace(settings, chart="free-body"),
    )
    mine = next(one for one in ranked if one.candidate.name == case.mesh.name)
    other = next(one for one in ranked if one.candidate.name != case.mesh.name).candidate
    return Identification(
        case.set,
        case.name,
        len(ranked),
        mine.rank,
        mine.candidate.fit.loss,
        other.name,
        other.fit.loss,
        other.fit.loss - mine.candidate.fit.loss,
        sum(one.candidate.fit.seconds for one in ranked),
    )


def placed(own: Mesh, mesh: Mesh, pose: Pose) -> Pose:
    """Where ``mesh`` has its centre where ``pose`` puts that of ``own``."""
    transform = pose.camera_from_model
    centre = transform.apply(own.centre[None])[0]
    shift = centre - transform.rotation @ mesh.centre
    return replace(pose, camera_from_model=RigidTransform(transform.rotation, shift))


def summary(found: Sequence[Identification]) -> str:
    """A line for each set: how often the own model was first, and the median margin."""
    lines = [f"{'set':10}{'photos':>8}{'models':>8}{'first':>8}{'chance':>8}{'margin':>9}"]
    for name in dict.fromkeys(one.set for one in found):
        some = [one for one in found if one.set == name]
        first = sum(one.rank == 1 for one in some)
        margin = np.median([one.margin for one in some])
        chance = np.mean([1.0 / one.models for one in some])
        lines.append(f"{name:10}{len(some):8}{some[0].models:8}{first:8}{chance:8.0%}{margin:9.3f}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, a line of CSV each on standard output; the summary on standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--degrees", type=int, default=10)
    parser.add_argument("--cases", default="", help="only those whose id matches")
    parser.add_argument(
        "--every", type=whole, default=1, metavar="N", help="only each N-th of a set"
    )
    parser.add_argument("--sets", nargs="+", default=SETS)
    parser.add_argument("--evaluations", type=whole, default=Limits().evaluations)
    parser.add_argument("--grey", action="store_true")
    parser.add_argument("--colour-reflectance", action="store_true")
    options = parser.parse_args(arguments)
    settings = FitSettings(
        colour_reflectance=options.colour_reflectance,
        grey=options.grey,
        limits=Limits(options.evaluations),
    )
    trials = run_identifications(
        options.folder, settings, options.degrees, options.cases, options.sets, options.every
    )
    return print_trials(trials, summary)


if __name__ == "__main__":
    sys.exit(main())
