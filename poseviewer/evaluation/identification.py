"""Which model is it, on real photos with known models: how often the right one comes first.

``python -m poseviewer.evaluation.identification FOLDER`` takes the cases of a folder with
``cases.json`` and ``starts.json`` (as ``evaluation.real_cases``), fits to each photo the models of
all cases of its set from the same start, and prints how often the photo's own model has the least
loss. Each model is laid with its centre where the start puts the own model's, and is turned alike.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.files.mesh_file import load_mesh
from poseviewer.files.photo_file import Photo, load_photo
from poseviewer.files.pose_file import PoseRecord
from poseviewer.fit.pose_fit import Limits
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform, nearest_rotation
from poseviewer.identify import identify
from poseviewer.registration import FitSettings, Registration

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
    """Identify the model of each ``every``-th case of the ``sets`` whose id holds ``pattern``."""
    cases = json.loads((folder / "cases.json").read_text())["cases"]
    starts = json.loads((folder / "starts.json").read_text())
    first = {s["case"]: s for s in reversed(starts) if s["degrees"] == degrees}
    for name in sets:
        own = [case for case in cases if case["set"] == name]
        meshes = {path: load_mesh(folder / path) for path in dict.fromkeys(c["mesh"] for c in own)}
        for case in [case for case in own if pattern in case["id"]][::every]:
            yield _identify_case(folder, case, first[case["id"]], meshes, settings)


def _identify_case(
    folder: Path,
    case: dict[str, Any],
    start: dict[str, Any],
    meshes: dict[str, Mesh],
    settings: FitSettings,
) -> Identification:
    photo = load_photo(folder / case["photo"])
    pose = _pose(photo, case["camera"], start["camera_from_model"])
    own = meshes[case["mesh"]]
    ranked = identify(
        [
            Registration(photo, mesh, path, "", None, PoseRecord(placed(own, mesh, pose)), ())
            for path, mesh in meshes.items()
        ],
        replace(settings, chart="free-body"),
    )
    mine = next(one for one in ranked if one.candidate.name == case["mesh"])
    other = next(one for one in ranked if one.candidate.name != case["mesh"]).candidate
    return Identification(
        case["set"],
        case["id"],
        len(ranked),
        mine.rank,
        mine.candidate.loss,
        Path(other.name).name,
        other.loss,
        other.loss - mine.candidate.loss,
        sum(one.candidate.seconds for one in ranked),
    )


def placed(own: Mesh, mesh: Mesh, pose: Pose) -> Pose:
    """Where ``mesh`` has its centre where ``pose`` puts that of ``own``."""
    transform = pose.camera_from_model
    centre = transform.apply(own.centre[None])[0]
    shift = centre - transform.rotation @ mesh.centre
    return replace(pose, camera_from_model=RigidTransform(transform.rotation, shift))


def _pose(photo: Photo, camera: dict[str, float], transform: dict[str, Any]) -> Pose:
    lens = camera_from_integer_centres(
        Perspective(**camera, width=photo.width, height=photo.height)
    )
    rotation = nearest_rotation(np.array(transform["rotation"]))
    return Pose(lens, RigidTransform(rotation, transform["translation"]))


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
    parser.add_argument("--cases", default="", help="only those whose id holds this text")
    parser.add_argument("--every", type=int, default=1, help="only each so-manieth of a set")
    parser.add_argument("--sets", nargs="+", default=SETS)
    parser.add_argument("--evaluations", type=int, default=Limits().evaluations)
    parser.add_argument("--grey", action="store_true")
    parser.add_argument("--colour-reflectance", action="store_true")
    options = parser.parse_args(arguments)
    for name in ("cases.json", "starts.json"):
        if not (options.folder / name).is_file():
            parser.error(f"{options.folder} holds no {name}; name a folder of real cases")
    settings = FitSettings(
        colour_reflectance=options.colour_reflectance,
        grey=options.grey,
        limits=Limits(options.evaluations),
    )
    table = csv.DictWriter(sys.stdout, list(Identification.__slots__))
    table.writeheader()
    found = []
    for one in run_identifications(
        options.folder, settings, options.degrees, options.cases, options.sets, options.every
    ):
        found.append(one)
        table.writerow(asdict(one))
        sys.stdout.flush()
    sys.stderr.write(summary(found) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
