"""Whether fits still end where they did: ``python -m tests.measure.frozen_fits``.

``--write TABLE.json`` makes 71 fits and keeps their ends, losses, evaluations and verdicts, and
beside the table the synthetic photos; ``--compare TABLE.json`` makes them again and prints
``equal``, or which differ and by how much (exit code 1). They are the demo's two photos, one of
them twice, 30 real cases of $POSEVIEWER_DATA (or ../shared/data) from starts 5 and 15 degrees off,
and eight synthetic photos with varied settings. Equal means bit-equal, so both runs want the same
machine.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from poseviewer.api import load
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError
from poseviewer.evaluation.cases import load_cases, load_starts
from poseviewer.evaluation.photos import Kind, draw_start, make_photos
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.starts.registration import load_model
from tests.measure.real import DATA

CASES = {"lmo": 8, "hope": 6, "bmw_traced": 6, "m3t_shampoo": 1, "visp_dragon": 1}
"""Cases of each set, spread evenly over it ..."""
CLUTTERED = 8
"""... and of the folder ``clutter``."""
PAPER, WHOLE = FitSettings("paper"), FitSettings("paper", pixels="whole")
SYNTHETIC: dict[Kind, tuple[FitSettings, ...]] = {
    "plain": (FitSettings(), FitSettings(), PAPER, WHOLE, FitSettings(pixels="clip")),
    "background": (FitSettings(), PAPER, WHOLE),
}
"""Settings of the fits on synthetic photos, by their kind."""
SIZE, OFF = (640, 480), 0.08
"""Of synthetic photos, px; how far off their starts are, relative to each parameter."""


@dataclass(frozen=True, slots=True)
class Ending:
    """What is kept of a fit."""

    rotation: list[list[float]]
    translation: list[float]
    focal: float
    """Focal length in px, or px per unit of a parallel camera."""
    start_loss: float
    loss: float
    evaluations: int
    status: str
    verdict: str
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class FrozenFit:
    """A fit of the table."""

    name: str
    photo: Path
    model: Path
    start: Pose | Path
    settings: FitSettings

    def run(self) -> Ending:
        """Make it."""
        found = load(self.photo, self.model, self.start, self.settings).fit()
        progress, verdict, camera = found.progress, found.verdict, found.pose.camera
        assert progress is not None  # it was searched for
        return Ending(
            found.pose.camera_from_model.rotation.tolist(),
            found.pose.camera_from_model.translation.tolist(),
            camera.scale if isinstance(camera, Parallel) else camera.fx,
            progress.start_loss,
            progress.loss,
            progress.evaluations,
            progress.status.name,
            "" if verdict is None else verdict.word,
            math.nan if verdict is None else verdict.probability,
        )


def demo_fits() -> Iterator[FrozenFit]:
    """The demo's two photos, and one with its focal length free."""
    for name, free in (("perspective", False), ("parallel", False), ("perspective", True)):
        case, settings = demo_case(name), FitSettings(free_focal=free)
        title = f"demo-{name}{'-focal' * free}"
        yield FrozenFit(title, case.photo, case.model, case.start, settings)


def real_fits(data: Path) -> Iterator[FrozenFit]:
    """Thirty cases from two starts each; none where there is no data.

    Raises:
        PoseFileError: a folder does not hold cases and starts.
    """
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
                    transform = starts[case.name, degrees].camera_from_model
                    start = Pose(case.truth.camera, transform)
                    settings = FitSettings(chart="free-body")
                    yield FrozenFit(
                        f"{case.name}-{degrees}", case.photo, case.mesh, start, settings
                    )


def synthetic_fits(photos: Path) -> Iterator[FrozenFit]:
    """Of the demo's car in random views; photos that are in the folder are taken from it.

    Raises:
        RendererUnavailableError: there is no OpenGL to draw them.
    """
    path, seed = demo_case().model, 0
    keypoints = load_model(path).keypoints
    assert keypoints is not None  # it is a car
    for kind, all_settings in SYNTHETIC.items():
        made = make_photos(kind, len(all_settings), photos, path, SIZE, 0)
        for case, settings in zip(made, all_settings, strict=True):
            start = draw_start(keypoints, case.truth, False, "relative", OFF, seed)
            file = photos / f"{case.name}-start.json"
            save_pose(file, PoseRecord(start))
            name = f"synthetic-{seed}-{kind}-{settings.method}"
            yield FrozenFit(name, case.photo, path, file, settings)
            seed += 1


def difference(before: Ending | None, now: Ending) -> str:
    """Which of the values differ, and by how much; empty where none does."""
    if before is None:
        return "is not in the table"
    turn = np.array(now.rotation) @ np.array(before.rotation).T
    sine = np.linalg.norm((turn - turn.T)[[2, 0, 1], [1, 2, 0]]) / 2.0
    degrees = math.degrees(math.atan2(float(sine), (float(np.trace(turn)) - 1.0) / 2.0))
    moved = float(np.linalg.norm(np.subtract(now.translation, before.translation)))
    share = moved / float(np.linalg.norm(before.translation))
    amounts = {"rotation": f"{degrees:.3g} degrees", "translation": f"{share:.3g} of the distance"}
    words = []
    for name, value in asdict(now).items():
        old = getattr(before, name)
        if value == old or (value != value and old != old):  # nan is no change from nan
            continue
        usual = f"{value - old:+.3g}" if isinstance(value, float) else f"{old} -> {value}"
        words.append(f"{name} {amounts.get(name, usual)}")
    return ", ".join(words)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the fits, and keep or compare their table."""
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, metavar="TABLE.json")
    what.add_argument("--compare", type=Path, metavar="TABLE.json")
    parser.add_argument("--only", default="", metavar="TEXT", help="fits whose name holds it")
    options = parser.parse_args(arguments)
    table: Path = options.write or options.compare
    if options.compare and not table.is_file():
        parser.error(f"{table}: there is no such table; make it with --write")
    endings: dict[str, Ending] = {}
    try:
        if not (DATA / "cases.json").is_file():
            print(f"no real data in {DATA}: these fits are left out")
        fits = [*demo_fits(), *real_fits(DATA)]
        if not options.only or options.only in "synthetic-":
            fits += synthetic_fits(table.with_suffix(".photos"))
        for fit in (fit for fit in fits if options.only in fit.name):
            ending = endings[fit.name] = fit.run()
            print(f"{fit.name}: loss {ending.loss:.6f}, {ending.verdict}", flush=True)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    if options.write:
        content = {name: asdict(ending) for name, ending in endings.items()}
        table.write_text(json.dumps(content, indent=1) + "\n")
        return 0
    before = {name: Ending(**ending) for name, ending in json.loads(table.read_text()).items()}
    changes = {name: difference(before.get(name), ending) for name, ending in endings.items()}
    lines = [f"{name}: {change}" for name, change in changes.items() if change]
    print("\n".join([f"{len(lines)} of {len(endings)} differ:", *lines]) if lines else "equal")
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
