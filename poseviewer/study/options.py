"""From what was typed to a plan."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from poseviewer.errors import SettingsError
from poseviewer.fit.settings import Limits
from poseviewer.study.deviations import READINGS
from poseviewer.study.photos import DRAWN, KINDS, TRACED
from poseviewer.study.plan import RealPlan, StudyPlan

OF_DEVIATIONS = {
    "starts": "starts",
    "deviations": "percents",
    "readings": "readings",
    "kinds": "kinds",
    "photos": "photos",
    "size": "size",
    "model": "model",
    "backgrounds": "backgrounds",
    "cars": "cars",
    "seed": "seed",
}
OF_REAL = {"degrees": "degrees", "cases": "pattern", "draws": "draws"}
"""Options to the fields of the plan that they set."""
OF_CYCLES = ("grey", "background")
"""Kinds of photo that Blender draws where none are named."""
SMALLEST_SIDE_PX, LARGEST_PERCENT = 32, 100.0


def read_plan(options: Namespace) -> StudyPlan | RealPlan:
    """The study that is wanted; what was not given is as the plan has it.

    Raises:
        SettingsError: the options do not go together, or one is out of range.
    """
    shared: dict[str, Any] = {
        "out": options.out,
        "method": options.method,
        "pixels": options.pixels,
        "limits": Limits(evaluations=options.evaluations),
    }
    if options.method == "paper" and options.pixels == "near":
        raise SettingsError("--method paper with --pixels near; it has clip and whole alone")
    if options.real:
        _refuse(
            options,
            [*OF_DEVIATIONS, "projection", "photographer"],
            "goes with synthetic photos: leave out",
        )
        return RealPlan(folder=options.real, **shared, **_given(options, OF_REAL))
    _refuse(options, list(OF_REAL), "goes with --real FOLDER: name one, or leave out")
    given = _given(options, OF_DEVIATIONS)
    _check(given)
    if options.photographer == "cycles":
        given["kinds"] = tuple(_traced(kind) for kind in given.get("kinds", OF_CYCLES))
    if options.projection:
        given["parallel"] = options.projection == "parallel"
    return StudyPlan(**shared, **given)


def _typed_kinds() -> tuple[str, ...]:
    return tuple(kind for kind in KINDS if kind not in TRACED)


def _traced(kind: str) -> str:
    if kind not in DRAWN:
        raise SettingsError(
            f"--photographer cycles with --kinds {kind}, which is not drawn; of those that are, "
            f"there are {', '.join(DRAWN)}"
        )
    return f"{kind}-traced"


def _given(options: Namespace, names: dict[str, str]) -> dict[str, Any]:
    found = {field: getattr(options, name) for name, field in names.items()}
    return {field: value for field, value in found.items() if value is not None}


def _refuse(options: Namespace, names: Sequence[str], why: str) -> None:
    for name in names:
        if getattr(options, name) is not None:
            raise SettingsError(f"--{name} {why} --{name}")


def _check(given: dict[str, Any]) -> None:
    for name, known in (("readings", READINGS), ("kinds", _typed_kinds())):
        for item in given.get(name, ()):
            if item not in known:
                raise SettingsError(f"--{name} {item}: there are {', '.join(known)}")
    if max(given.get("percents", (0.0,))) > LARGEST_PERCENT:
        raise SettingsError(f"--deviations {max(given['percents']):g}: 100 % is the most")
    if min(given.get("size", (SMALLEST_SIDE_PX,))) < SMALLEST_SIDE_PX:
        raise SettingsError(f"--size: each side needs {SMALLEST_SIDE_PX} px at least")
