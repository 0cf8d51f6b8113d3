"""What a study is to run: from the command line, and into the folder that says how it was made."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.files.checks import read_json
from poseviewer.files.demo import demo_case
from poseviewer.files.writing import sha256_of, write_whole
from poseviewer.fit.settings import FitSettings, Limits, Method, PixelsName
from poseviewer.study.photos import DRAWN, KINDS, TRACED, Kind, background_files
from poseviewer.study.real_cases import CASES, STARTS
from poseviewer.study.trials import READINGS, Reading

ABOUT = "study.json"
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


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan:
    """The study of reliability against deviation."""

    out: Path
    method: Method = "default"
    pixels: PixelsName | None = None
    """None: all that the method has for a kind of photo."""
    starts: int = 10
    """For each kind of photo, pixels, reading and deviation."""
    photos: int = 5
    """Of each kind; starts take turns on them."""
    percents: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
    readings: tuple[Reading, ...] = READINGS
    kinds: tuple[Kind, ...] = ("plain", "background", "photo-parallel", "photo-perspective")
    size: tuple[int, int] = (640, 480)
    """Of synthetic photos, px."""
    parallel: bool = True
    """How synthetic photos are projected; in perspective, the focal length is known."""
    model: Path | None = None
    """Of a vehicle; None: the bundled one."""
    backgrounds: Path | None = None
    """Folder of photos; None: the bundled one."""
    cars: Path | None = None
    """Folder with ``cases.json``; None: the bundled photos."""
    seed: int = 0
    limits: Limits = field(default_factory=Limits)

    @property
    def model_path(self) -> Path:
        """The one that is used."""
        return self.model or demo_case().model

    def settings(self, kind: Kind) -> list[FitSettings]:
        """How fits of a kind are made. The paper's method takes the whole photo on black ground, as
        the paper did; both sets of pixels, to compare them, on other ground that is drawn; and on
        photos as they are the clipped one.
        """
        names: tuple[PixelsName, ...]
        if self.pixels:
            names = (self.pixels,)
        elif self.method == "default":
            names = ("near",)
        elif kind in ("plain", "plain-traced"):
            names = ("whole",)
        else:
            names = ("whole", "clip") if kind in (*DRAWN, *TRACED) else ("clip",)
        return [FitSettings(self.method, pixels=name, limits=self.limits) for name in names]

    def about(self) -> dict[str, Any]:
        """What all rows of a folder have in common.

        Raises:
            PoseViewerError: one of the files is not there.
        """
        backgrounds = background_files(self.backgrounds) if self.backgrounds else []
        return {
            "study": "deviations",
            "model": _fingerprint(self.model_path),
            "size": list(self.size),
            "photos": self.photos,
            "projection": "parallel" if self.parallel else "perspective",
            "backgrounds": {path.name: sha256_of(path) for path in backgrounds},
            "cars": _fingerprint(self.cars / CASES) if self.cars else "bundled",
            "seed": self.seed,
            "evaluations": self.limits.evaluations,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class RealPlan:
    """The study of a folder of real photos with fixed starts."""

    out: Path
    folder: Path
    degrees: tuple[int, ...] = (5, 15)
    pattern: str = ""
    draws: int = 5
    method: Method = "default"
    pixels: PixelsName | None = None
    limits: Limits = field(default_factory=Limits)

    @property
    def settings(self) -> FitSettings:
        """How all fits are made."""
        return FitSettings(
            self.method, "free-body", pixels=self.pixels or "near", limits=self.limits
        )

    def about(self) -> dict[str, Any]:
        """What all rows of a folder have in common.

        Raises:
            PoseFileError: the folder does not hold cases and starts.
        """
        return {
            "study": "real",
            "cases": _fingerprint(self.folder / CASES),
            "starts": _fingerprint(self.folder / STARTS),
            "evaluations": self.limits.evaluations,
        }


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
    for name, known in (("readings", READINGS), ("kinds", [k for k in KINDS if k not in TRACED])):
        for item in given.get(name, ()):
            if item not in known:
                raise SettingsError(f"--{name} {item}: there are {', '.join(known)}")
    if max(given.get("percents", (0.0,))) > LARGEST_PERCENT:
        raise SettingsError(f"--deviations {max(given['percents']):g}: 100 % is the most")
    if min(given.get("size", (SMALLEST_SIDE_PX,))) < SMALLEST_SIDE_PX:
        raise SettingsError(f"--size: each side needs {SMALLEST_SIDE_PX} px at least")


def open_folder(out: Path, about: Mapping[str, Any]) -> None:
    """Make the folder, or see that what is in it was made in the same way.

    Raises:
        SettingsError: it holds another study, or cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(
            f"{out}: cannot be made ({error.strerror}); name a folder of yours"
        ) from None
    path = out / ABOUT
    if not path.exists():
        write_whole(path, (json.dumps(about, indent=1) + "\n").encode(), SettingsError)
        return
    there = read_json(path)
    there = there if isinstance(there, dict) else {}
    other = [key for key, value in about.items() if there.get(key) != value]
    if other:
        raise SettingsError(
            f"{out}: holds trials of another study ({other[0]} was {there.get(other[0])}, and is "
            f"{about[other[0]]} now); name another folder"
        )


def _fingerprint(path: Path) -> str:
    if not path.is_file():
        raise PoseFileError(f"{path}: there is no such file; name one that is there")
    return sha256_of(path)
