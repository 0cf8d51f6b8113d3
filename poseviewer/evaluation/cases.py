"""Photos with known poses in a folder of ``cases.json`` and ``starts.json``.

``cases.json``: per case ``id``, ``set``, ``photo``, ``mesh``, ``camera`` (fx fy cx cy, pixel
centres at integers), ``camera_from_model``, ``accuracy`` of the truth in words,
``image_diagonal_px``; perhaps ``visible``, the share of the model that nothing hides.
``starts.json``: ``case``, ``degrees``, ``draw``, ``camera_from_model`` for each start.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.files.checks import read_json
from poseviewer.files.formats.bop_models import BopModel
from poseviewer.files.photo import load_photo
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.geometry.transform import RigidTransform, nearest_rotation

CASES, STARTS = "cases.json", "starts.json"
SEEN = {0.9: "seen 90 % and more", 0.5: "seen 50-90 %", 0.0: "seen to less than 50 %"}
"""Label of a visible share, by the least share that it is for."""
_PIXELS = re.compile(r"(\d+(?:\.\d+)?)(?:-(\d+(?:\.\d+)?))? px")


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A model in a photo, and its true pose."""

    name: str
    set: str
    photo: Path
    mesh: Path
    truth: Pose
    accuracy_percent: float = 0.0
    """Error of the truth itself, as a share of the model's size in the photo."""
    visible: float | None = None
    """Share of the model's pixels that nothing hides; None: unknown."""
    is_drawn: bool = False
    """Whether OpenGL drew the photo: the pose counts as found within 1 px."""
    bop: BopModel | None = None
    """Diameter and symmetries of the model in a BOP data set."""

    @property
    def group(self) -> str:
        """The set and the class of visibility: the case's line of the report."""
        if self.visible is None:
            return self.set
        return f"{self.set}, {next(text for least, text in SEEN.items() if self.visible >= least)}"


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A pose to start from; ``draw`` numbers those of one case and deviation."""

    case: str
    degrees: int
    draw: int
    camera_from_model: RigidTransform


def load_cases(folder: Path, pattern: str = "") -> list[Case]:
    """Load the cases whose id contains the pattern, or with ``*`` or ``?`` in it matches whole."""
    listed = _listed(folder / CASES, "cases")
    cases = [_case(folder, data) for data in listed if _matches(str(data.get("id", "")), pattern)]
    if not cases:
        raise SettingsError(f"--cases {pattern}: no id in {folder / CASES} matches; see there")
    return cases


def load_starts(folder: Path, degrees: Sequence[int], draws: int) -> list[Start]:
    """Load the first ``draws`` starts of every case at each of the deviations."""
    starts = [_start(folder, data) for data in _listed(folder / STARTS)]
    known = sorted({start.degrees for start in starts})
    for wanted in degrees:
        if wanted not in known:
            raise SettingsError(
                f"--degrees {wanted}: {folder / STARTS} has starts that are "
                f"{', '.join(map(str, known))} degrees off"
            )
    return [start for start in starts if start.degrees in degrees and start.draw < draws]


def _listed(path: Path, key: str = "") -> list[dict[str, Any]]:
    data = read_json(path)
    items = data.get(key) if key and isinstance(data, dict) else data
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise PoseFileError(f"{path}: holds no list of {path.stem}; name a folder that has them")
    return items


def _matches(name: str, pattern: str) -> bool:
    return fnmatchcase(name, pattern) if set("*?") & set(pattern) else pattern in name


def _case(folder: Path, data: dict[str, Any]) -> Case:
    try:
        path = folder / data["photo"]
        photo = load_photo(path)
        camera = Perspective(**data["camera"], width=photo.width, height=photo.height)
        truth = Pose(camera_from_integer_centres(camera), _transform(data))
        accuracy = 100.0 * _accuracy_px(data["accuracy"]) / data["image_diagonal_px"]
        mesh, visible = folder / data["mesh"], data.get("visible")
        return Case(data["id"], data["set"], path, mesh, truth, accuracy, visible)
    except (KeyError, TypeError, ValueError) as error:
        raise _unreadable(folder / CASES, data.get("id"), error) from None


def _start(folder: Path, data: dict[str, Any]) -> Start:
    try:
        return Start(data["case"], data["degrees"], data["draw"], _transform(data))
    except (KeyError, TypeError, ValueError) as error:
        raise _unreadable(folder / STARTS, data.get("case"), error) from None


def _unreadable(path: Path, name: object, error: Exception) -> PoseFileError:
    return PoseFileError(
        f"{path}: {name or 'an entry without a name'} cannot be read "
        f"({type(error).__name__}: {error}); mend that entry"
    )


def _accuracy_px(words: str) -> float:
    """Largest error that is said of a truth ("2-4 px ..."); 0 for one that is exact."""
    if words.startswith("exact"):
        return 0.0
    match = _PIXELS.search(words)
    if not match:
        raise ValueError(f"accuracy is {words!r}, wanted 'exact', or px as in '1-2 px'")
    return float(match[2] or match[1])


def _transform(data: dict[str, Any]) -> RigidTransform:
    matrix = data["camera_from_model"]
    return RigidTransform(nearest_rotation(np.array(matrix["rotation"])), matrix["translation"])
