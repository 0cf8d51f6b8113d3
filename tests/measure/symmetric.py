"""Whether things that look the same from several sides, or nearly, are found as often as others.

``python -m tests.measure.symmetric FOLDER OUT`` reads the trials that ``study --real FOLDER --out
OUT`` has left. A model is *nearly* symmetric where its shape is, by ``find_symmetry``, whatever its
colours are. Its errors are said as they are, and modulo the symmetry of its shape: of the turned
ends the one nearest to the truth.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.surface_symmetry import find_symmetry
from poseviewer.geometry.symmetry import Symmetry
from tests.measure.agreement import ends_of_cases, options_of
from tests.measure.trial_table import print_trials

WITHIN = (1.0, 2.0, 5.0)
"""Per cent of the model's size in the photo."""


@dataclass(frozen=True, slots=True)
class Ended:
    """One fit."""

    set: str
    case: str
    model: str
    degrees: int
    turns: str
    """Of the model's shape; empty: it has none."""
    verdict: str
    percent: float
    """Error, of the model's size in the photo."""
    modulo_percent: float
    """The same, of the ends turned by the symmetry of the shape the least."""


@cache
def _of_shape(mesh: Path) -> Symmetry:
    return find_symmetry(load_mesh(mesh)).of_shape


def ended_fits(folder: Path, out: Path, degrees: Sequence[int] = ()) -> Iterator[Ended]:
    """One for each fit; raises as ``ends_of_cases``."""
    for one in ends_of_cases(folder, out, degrees):
        case, symmetry = one.case, _of_shape(one.case.mesh)
        for trial, end in zip(one.trials, one.ends, strict=True):
            plain = pose_error(one.mesh, end, case.truth).percent
            modulo = pose_error(one.mesh, end, case.truth, symmetry).percent
            named = case.set, case.name, case.mesh.stem, trial.degrees, symmetry.words
            yield Ended(*named, trial.verdict, plain, min(plain, modulo))


def summary(found: Sequence[Ended]) -> str:
    """A line for each model of a nearly symmetric shape, for all of these, and for all others."""
    head = "".join(f"{f'{limit:g} %':>7}" for limit in WITHIN)
    lines = [f"{'model':24}{'fits':>6}{'median':>9}{head}{'found':>8}   modulo:{'':2}median{head}"]
    turned = [one for one in found if one.turns]
    groups = {name: [x for x in turned if x.model == name] for name in {x.model for x in turned}}
    groups = dict(sorted(groups.items()))
    groups |= {"all nearly symmetric": turned, "others": [x for x in found if not x.turns]}
    for name, some in groups.items():
        if not some:
            continue
        line = f"{name:24}{len(some):6}"
        for index, measure in enumerate(("percent", "modulo_percent")):
            errors = np.array([getattr(one, measure) for one in some])
            shares = "".join(f"{np.mean(errors <= limit):7.0%}" for limit in WITHIN)
            said = f"{sum(one.verdict == 'found' for one in some):8}{'':12}"
            line += f"{np.median(errors):8.2f}%{shares}{said if index == 0 else ''}"
        lines.append(line)
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """A line of CSV for each fit on standard output; the summary on standard error."""
    options = options_of(__doc__, arguments)
    return print_trials(ended_fits(options.folder, options.out, options.degrees), summary)


if __name__ == "__main__":
    sys.exit(main())
