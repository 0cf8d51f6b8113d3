"""Whether fits still end where they did: ``python -m tests.measure.frozen_fits``.

``--write TABLE.json`` makes some 70 fits and keeps their ends, losses, evaluations and verdicts;
``--compare TABLE.json`` makes those of the table again and prints ``equal``, or which differ and by
how much (exit code 1). They are the demo's two photos by varied settings, 30 real cases of
$POSEVIEWER_DATA (or ../shared/data) from starts 5 and 15 degrees off, and photos in the folder
``TABLE.photos``, if it is there. Equal means bit-equal, so both runs want the same machine.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from assets.source.data_folder import DATA
from poseviewer.api import load
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError
from poseviewer.evaluation.cases import load_cases, load_starts
from poseviewer.files.demo import demo_case
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.transform import rotation_angle
from poseviewer.scene.settings import FitSettings

CASES = {"lmo": 8, "hope": 6, "bmw_traced": 6, "m3t_shampoo": 1, "visp_dragon": 1}
"""Cases of each set, spread evenly over it ..."""
CLUTTERED = 8
"""... and of the folder ``clutter``."""
PAPER, WHOLE = FitSettings("paper"), FitSettings("paper", pixels="whole")
VARIED = {
    "default": FitSettings(),
    "paper": PAPER,
    "whole": WHOLE,
    "clip": FitSettings(pixels="clip"),
    "grey": FitSettings(grey=True),
}
"""Settings by which the demo's two photos are fitted."""
Ending = dict[str, Any]
"""What is kept of a fit."""
DRAWN = {
    "plain-parallel": (FitSettings(), FitSettings(), PAPER, WHOLE),
    "background-parallel": (FitSettings(), PAPER, WHOLE),
    "plain-perspective": (FitSettings(), VARIED["clip"], FitSettings(free_focal=True)),
}
"""Settings of the photos in each folder of ``TABLE.photos``."""


@dataclass(frozen=True, slots=True, eq=False)
class FrozenFit:
    """A fit of the table."""

    name: str
    photo: Path
    model: Path
    start: Pose | Path
    settings: FitSettings

    def run(self) -> Ending:
        end = load(self.photo, self.model, self.start, self.settings).fit()
        progress = end.progress
        verdict = end.verdict
        camera = end.pose.camera
        assert progress is not None  # it was searched for
        return {
            "rotation": end.pose.camera_from_model.rotation.tolist(),
            "translation": end.pose.camera_from_model.translation.tolist(),
            "focal": camera.scale if isinstance(camera, Parallel) else camera.fx,
            "start_loss": progress.start_loss,
            "loss": progress.loss,
            "evaluations": progress.evaluations,
            "status": progress.status.name,
            "verdict": "" if verdict is None else verdict.label,
            "probability": math.nan if verdict is None else verdict.probability,
        }


def demo_fits() -> Iterator[FrozenFit]:
    """The demo's two photos by varied settings."""
    for name in ("perspective", "parallel"):
        case = demo_case(name)
        for how, settings in VARIED.items():
            title = f"demo-{name}" if how == "default" else f"demo-{name}-{how}"
            yield FrozenFit(title, case.photo, case.model, case.start, settings)


def real_fits(data: Path) -> Iterator[FrozenFit]:
    """Thirty cases from two starts each; none where there is no data."""
    for folder, counts in ((data, CASES), (data / "clutter", {"": CLUTTERED})):
        if not (folder / "cases.json").is_file():
            continue
        cases = load_cases(folder)
        starts = {(s.case, s.degrees): s for s in load_starts(folder, (5, 15), 1)}
        for name, count in counts.items():
            some = [case for case in cases if name in ("", case.set)]
            for at in np.linspace(0, len(some) - 1, count).round().astype(int):
                case = some[at]
                for degrees in (5, 15):
                    transform = starts[case.name, degrees].camera_from_model.rigid
                    start = Pose(case.truth.camera, transform)
                    settings = FitSettings(chart="free-body")
                    yield FrozenFit(
                        f"{case.name}-{degrees}", case.photo, case.mesh, start, settings
                    )


def drawn_fits(folder: Path) -> Iterator[FrozenFit]:
    """Photos drawn of the demo's car, with their starts beside them, as far as they are there."""
    drawn = ((name, *one) for name, settings in DRAWN.items() for one in enumerate(settings))
    for number, (name, index, settings) in enumerate(drawn):
        kind = name.partition("-")[0]
        photo = folder / name / f"{kind}-{index}.png"
        start = photo.with_name(f"{kind}-{index}-start.json")
        if photo.is_file():
            title = f"synthetic-{number}-{kind}-{settings.loss}"
            yield FrozenFit(title, photo, demo_case().model, start, settings)


def difference(before: Ending, now: Ending | None) -> str:
    """Which of the values differ, and by how much; empty where none does."""
    if now is None:
        return "was not made"
    degrees = math.degrees(rotation_angle(*(np.array(end["rotation"]) for end in (before, now))))
    moved = float(np.linalg.norm(np.subtract(now["translation"], before["translation"])))
    share = moved / float(np.linalg.norm(before["translation"]))
    amounts = {"rotation": f"{degrees:.3g} degrees", "translation": f"{share:.3g} of the distance"}
    words = []
    for name, value in now.items():
        old = before[name]
        if value == old or (value != value and old != old):  # nan is no change from nan
            continue
        usual = f"{value - old:+.3g}" if isinstance(value, float) else f"{old} -> {value}"
        words.append(f"{name} {amounts.get(name, usual)}")
    return ", ".join(words)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, metavar="TABLE.json")
    what.add_argument("--compare", type=Path, metavar="TABLE.json")
    parser.add_argument("--only", default="", metavar="TEXT", help="fits whose name holds it")
    options = parser.parse_args(arguments)
    table: Path = options.write or options.compare
    if options.compare and not table.is_file():
        parser.error(f"{table}: there is no such table; make it with --write")
    before: dict[str, Ending] = {}
    if options.compare:
        kept = json.loads(table.read_text())
        before = {name: end for name, end in kept.items() if options.only in name}
    endings: dict[str, Ending] = {}
    try:
        fits = [*demo_fits(), *real_fits(DATA), *drawn_fits(table.with_suffix(".photos"))]
        for fit in (fit for fit in fits if options.only in fit.name):
            if options.write or fit.name in before:
                endings[fit.name] = fit.run()
                print(f"{fit.name}: loss {endings[fit.name]['loss']:.6f}", flush=True)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    if options.write:
        table.write_text(json.dumps(endings, indent=1) + "\n")
        return 0
    changes = {name: difference(end, endings.get(name)) for name, end in before.items()}
    lines = [f"{name}: {change}" for name, change in changes.items() if change]
    print("\n".join([f"{len(lines)} of {len(before)} differ:", *lines]) if lines else "equal")
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
