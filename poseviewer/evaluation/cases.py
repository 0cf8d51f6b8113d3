"""Photos with known poses: folders of ``cases.json``, ``{"cases": [...]}``, and ``starts.json``."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from msgspec import Struct

from poseviewer.errors import SettingsError
from poseviewer.files.checks import InputFile, Positive
from poseviewer.files.formats.bop_models import BopModel
from poseviewer.files.photo import load_photo
from poseviewer.files.structs import CameraNumbers, Transform
from poseviewer.geometry.camera import Pose

CASES = "cases.json"
"""Name of the list of cases in a folder."""
STARTS = "starts.json"
"""Name of the list of starts."""
SHARES = {0.9: "seen 90 % and more", 0.5: "seen 50-90 %", 0.0: "seen to less than 50 %"}
"""Labels of visible fractions, by the smallest fraction that each is for."""
_PIXELS = re.compile(r"^exact|(\d+(?:\.\d+)?) px")


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A model in a photo, and its true pose."""

    name: str
    set: str
    photo: Path
    mesh: Path
    truth: Pose
    accuracy_percent: float = 0.0
    """Error of the truth itself, per cent of the model's size in the photo."""
    visible: float = math.nan
    """Fraction of the model's pixels that nothing occludes; nan: unknown."""
    is_drawn: bool = False
    """Whether OpenGL drew the photo, so that a pose is found within 1 px."""
    bop: BopModel | None = None
    """Diameter and symmetries of the model in a BOP data set."""


def visibility_label(visible: float) -> str:
    """Give the label of a visible share, see ``SHARES``; empty: unknown."""
    return next((label for least, label in SHARES.items() if visible >= least), "")


class CaseEntry(Struct, frozen=True):
    """A case of ``cases.json``; pixel centres are at integers."""

    id: str
    set: str
    photo: str
    mesh: str
    camera: CameraNumbers
    camera_from_model: Transform
    accuracy: str
    """Largest error of the truth, "2-4 px" or "exact"."""
    image_diagonal_px: Positive
    visible: float = math.nan

    def __post_init__(self) -> None:
        self.camera.camera("perspective", (1, 1))

    def accuracy_percent(self, reading: InputFile) -> float:
        """Return the largest error of the truth, per cent of the model's size in the photo."""
        match = _PIXELS.search(self.accuracy)
        if match is None:
            accuracy = f"accuracy of {self.id} is {self.accuracy!r}"
            raise reading.error(accuracy, "wanted 'exact', or px as in '1-2 px'")
        return 100.0 * float(match[1] or 0.0) / self.image_diagonal_px


class CaseStart(Struct, frozen=True):
    """A pose to start from; ``draw`` numbers those of one case and deviation."""

    case: str
    degrees: int
    draw: int
    camera_from_model: Transform


def load_cases(folder: Path, pattern: str = "") -> list[Case]:
    """Load the cases whose id contains the pattern, or matches one with ``*`` or ``?`` in it."""
    reading, cases = InputFile(folder / CASES, kind="list of cases"), []
    for entry in reading.decode(reading.load_object().get("cases"), list[CaseEntry], "cases"):
        if fnmatchcase(entry.id, pattern if set("*?") & set(pattern) else f"*{pattern}*"):
            path = folder / entry.photo
            photo = load_photo(path)
            camera = entry.camera.camera("perspective", (photo.width, photo.height))
            truth = Pose(camera, entry.camera_from_model.rigid)
            accuracy, mesh = entry.accuracy_percent(reading), folder / entry.mesh
            cases.append(Case(entry.id, entry.set, path, mesh, truth, accuracy, entry.visible))
    if not cases:
        raise SettingsError(f"cases {pattern}: no id in {folder / CASES} matches; see there")
    return cases


def load_starts(folder: Path, degrees: Sequence[int], draws: int) -> list[CaseStart]:
    """Load the first ``draws`` starts of every case at each of the deviations."""
    reading = InputFile(folder / STARTS, kind="list of starts")
    starts = reading.decode(reading.load_json(), list[CaseStart])
    known = sorted({start.degrees for start in starts})
    for wanted in degrees:
        if wanted not in known:
            raise SettingsError(
                f"degrees {wanted}: {folder / STARTS} has starts that are "
                f"{', '.join(map(str, known))} degrees off"
            )
    return [start for start in starts if start.degrees in degrees and start.draw < draws]
