"""The verdict's weights, made from studies: ``python -m tests.measure.calibrate_verdict``.

::

    poseviewer study --real FOLDER --degrees 5,15,30 --draws 1 --out STUDY
    python -m tests.measure.calibrate_verdict STUDY/trials.csv

prints how well the verdict tells right from wrong, on the half of the cases that it is made from
and on the other half; with ``--write`` the weights go to ``fit/verdict_weights.py``. Where only the
evidence has changed, ``--anew FOLDER`` gathers it again at the ends that the table holds, in a
fourth of the time of the fits, into a table beside it. Truths that are farther off than their
source says make right fits wrong: ``--accuracy SET=PERCENT`` says how far (``evaluation.agreement``
shows such sets).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from poseviewer.confidence import weights as verdict_weights
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError, SettingsError
from poseviewer.files.writing import write_whole
from tests.measure.verdicts.anew import gather_anew
from tests.measure.verdicts.calibration import (
    NAMES,
    Calibration,
    calibrate,
    calibration_table,
)
from tests.measure.verdicts.rows import JudgedTrial, load_judged

WEIGHTS = Path(str(verdict_weights.__file__))


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate on the tables that are named; say how well that does."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("trials", type=Path, nargs="+", metavar="TRIALS.CSV", help="of studies")
    parser.add_argument("--anew", type=Path, metavar="FOLDER", help="gather the evidence again")
    parser.add_argument(
        *("--accuracy", "-a"),
        type=_accuracy,
        action="append",
        default=[],
        metavar="SET=PERCENT",
        help="how far off the truths of a set are, instead of what the table says",
    )
    parser.add_argument("--write", action="store_true", help="keep the weights in the program")
    options = parser.parse_args(arguments)
    try:
        tables = options.trials
        if options.anew:
            tables = [gather_anew(path, options.anew, sys.stderr.write) for path in tables]
        return _calibrate(load_judged(tables, dict(options.accuracy)), options.write)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE


def _accuracy(text: str) -> tuple[str, float]:
    name, _, percent = text.rpartition("=")
    try:
        value = float(percent)
    except ValueError:
        value = -1.0
    if not name or not 0.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"{text!r}; wanted SET=PERCENT, such as lmo=6")
    return name, value


def _calibrate(trials: list[JudgedTrial], write: bool) -> int:
    found = calibrate([trial for trial in trials if trial.tunes])
    text = weights_as_python(found, trials)
    sys.stdout.write(f"{calibration_table(found, trials).as_text()}\n\n{text}")
    if write:
        write_whole(WEIGHTS, text.encode(), SettingsError)
        sys.stdout.write(f"\nweights: {WEIGHTS}\n")
    return 0


def weights_as_python(calibration: Calibration, trials: Sequence[JudgedTrial]) -> str:
    """The module ``fit.verdict_weights``."""
    tuning = [trial for trial in trials if trial.tunes]
    model = calibration.model
    lines = [
        f'    "{name}": ({mean:.4g}, {deviation:.4g}, {weight:.4g}),'
        for name, mean, deviation, weight in zip(
            NAMES, model.mean, model.deviation, model.weights, strict=True
        )
    ]
    features = "\n".join(lines)
    return f'''"""How much each number of the evidence weighs; written by
``python -m tests.measure.calibrate_verdict --write`` from {len(tuning)} trials, {
        sum(trial.right for trial in tuning)
    } of them right.
"""

FEATURES: dict[str, tuple[float, float, float]] = {{
{features}
}}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = {model.offset:.4g}
FOUND_FROM, LOST_BELOW = {calibration.found_from:.4g}, {calibration.lost_below:.4g}
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
'''


if __name__ == "__main__":
    sys.exit(main())
