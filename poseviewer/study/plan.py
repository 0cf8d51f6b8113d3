"""What a study is to run, and what its folder says of how it was made."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.files.demo import demo_case
from poseviewer.files.pose.checks import read_json
from poseviewer.files.writing import sha256_of, write_whole
from poseviewer.fit.settings import FitSettings, Limits, Method, PixelsName
from poseviewer.study.backgrounds import background_files
from poseviewer.study.deviations import READINGS, Reading
from poseviewer.study.photos import DRAWN, TRACED, Kind
from poseviewer.study.real_cases import CASES, STARTS

ABOUT = "study.json"


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
        names = (self.pixels,) if self.pixels else _usual_pixels(self.method, kind)
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


def _usual_pixels(method: Method, kind: Kind) -> tuple[PixelsName, ...]:
    if method == "default":
        return ("near",)
    if kind in ("plain", "plain-traced"):
        return ("whole",)
    return ("whole", "clip") if kind in (*DRAWN, *TRACED) else ("clip",)


def _fingerprint(path: Path) -> str:
    if not path.is_file():
        raise PoseFileError(f"{path}: there is no such file; name one that is there")
    return sha256_of(path)
