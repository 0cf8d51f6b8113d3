"""What a study is to run, and the folder that says how it was made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.evaluation.photos import DRAWN, KINDS, Kind, background_files
from poseviewer.evaluation.real_cases import CASES, STARTS
from poseviewer.evaluation.trials import READINGS, Reading
from poseviewer.files.checks import read_json
from poseviewer.files.demo import demo_case
from poseviewer.files.writing import make_folder, sha256_of, write_json
from poseviewer.fit.settings import FitSettings, Limits, Method, PixelsName

ABOUT = "study.json"
Projection = Literal["perspective", "parallel"]
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
    deviations: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
    """Percent."""
    readings: tuple[Reading, ...] = READINGS
    kinds: tuple[Kind, ...] = tuple(KINDS)
    size: tuple[int, int] = (640, 480)
    """Of synthetic photos, px."""
    projection: Projection = "parallel"
    """How synthetic photos are projected; in perspective, the focal length is known."""
    model: Path | None = None
    """Of a vehicle; None: the bundled one."""
    backgrounds: Path | None = None
    """Folder of photos; None: the bundled one."""
    cars: Path | None = None
    """Folder with ``cases.json``; None: the bundled photos."""
    seed: int = 0
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        for name, known in (("readings", READINGS), ("kinds", KINDS)):
            for item in getattr(self, name):
                if item not in known:
                    raise SettingsError(f"--{name} {item}: there are {', '.join(known)}")
        if max(self.deviations) > LARGEST_PERCENT:
            raise SettingsError(f"--deviations {max(self.deviations):g}: 100 % is the most")
        if min(self.size) < SMALLEST_SIDE_PX:
            raise SettingsError(f"--size: each side needs {SMALLEST_SIDE_PX} px at least")

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
        elif kind == "plain":
            names = ("whole",)
        else:
            names = ("whole", "clip") if kind in DRAWN else ("clip",)
        return [FitSettings(self.method, pixels=name, limits=self.limits) for name in names]

    def about(self) -> dict[str, Any]:
        """What all rows of a folder have in common."""
        backgrounds = background_files(self.backgrounds) if self.backgrounds else []
        return {
            "study": "deviations",
            "model": _fingerprint(self.model_path),
            "size": list(self.size),
            "photos": self.photos,
            "projection": self.projection,
            "backgrounds": {path.name: sha256_of(path) for path in backgrounds},
            "cars": _fingerprint(self.cars / CASES) if self.cars else "bundled",
            "seed": self.seed,
            "evaluations": self.limits.evaluations,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeBodyPlan:
    """What studies of fits from poses near the truth have in common."""

    out: Path
    method: Method = "default"
    pixels: PixelsName | None = None
    limits: Limits = field(default_factory=Limits)

    @property
    def settings(self) -> FitSettings:
        """How all fits are made."""
        return FitSettings(
            self.method, "free-body", pixels=self.pixels or "near", limits=self.limits
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RealPlan(FreeBodyPlan):
    """The study of a folder of real photos with fixed starts."""

    folder: Path
    degrees: tuple[int, ...] = (5, 15)
    cases: str = ""
    """A pattern of their ids, see ``load_cases``; empty: all."""
    draws: int = 5
    among_others: bool = False
    """Whether the true poses of the other cases of each photo are given."""

    def about(self) -> dict[str, Any]:
        """What all rows of a folder have in common."""
        return {
            "study": "real, among others" if self.among_others else "real",
            "cases": _fingerprint(self.folder / CASES),
            "starts": _fingerprint(self.folder / STARTS),
            "evaluations": self.limits.evaluations,
        }


def open_folder(out: Path, about: Mapping[str, Any]) -> None:
    """Make the folder, or see that what is in it was made in the same way.

    Raises:
        SettingsError: it holds another study, or cannot be made.
    """
    make_folder(out, SettingsError)
    path = out / ABOUT
    if not path.exists():
        write_json(path, about, SettingsError)
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
