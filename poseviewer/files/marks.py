"""Marks on a photo from files and the command line: point pairs, and ellipses of two wheels."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from poseviewer.errors import QuickStartError
from poseviewer.files.checks import MAX_NUMBER, MAX_PX, InputFile
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.frames import points_from_integer_centres
from poseviewer.vehicle.wheel_pose import Ellipse, Wheels

PAIR = ("x", "y", "z", "u", "v")
ELLIPSE = ("cx", "cy", "a", "b", "angle")
MAX_VALUES: dict[str, float] = dict.fromkeys((*PAIR[3:], *ELLIPSE[:4]), MAX_PX)


@dataclass(frozen=True, slots=True, eq=False)
class PointPairs:
    """Points of the model and where the photo shows them."""

    points: FloatArray
    """(n, 3), in the model's frame and unit."""
    pixels: FloatArray
    """(n, 2), px, pixel centres at i + 0.5."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", freeze_array(self.points, (-1, 3)))
        object.__setattr__(self, "pixels", freeze_array(self.pixels, (-1, 2)))


def load_pairs(path: str | Path) -> PointPairs:
    """Load point pairs from a table of x, y, z, u, v, with a header or not, and any separator."""
    file = _marks_file(path)
    with file.naming_errors():
        text = file.load_text()
        first = next((line for line in text.splitlines() if line.strip() and "#" not in line), "")
        separator = next((mark for mark in "\t;," if mark in first), " ")
        table = csv.reader(StringIO(text), delimiter=separator, skipinitialspace=True)
        names, numbers = PAIR, []
        for number, row in enumerate(table, 1):
            cells = [cell.strip().lower().replace(",", ".") for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if not numbers and set(PAIR) <= set(cells):
                names = tuple(cells)
            else:
                numbers.append(_numbers(file, f"line {number}", cells, names, PAIR))
    values = np.array(numbers, dtype=float).reshape(-1, len(PAIR))
    return PointPairs(values[:, :3], points_from_integer_centres(values[:, 3:]))


def wheels_from_text(text: str) -> Wheels:
    """Parse ``cx,cy,a,b,angle;cx,cy,a,b,angle``: rear, then front; px, degrees clockwise."""
    file = _marks_file("wheels")
    with file.naming_errors():
        rows = [wheel.split(",") for wheel in text.split(";") if wheel.strip()]
        if len(rows) != 2:
            wanted = "wanted two, rear;front, each cx,cy,a,b,angle"
            raise file.error(f"{len(rows)} ellipses", wanted)
        ellipses = []
        for which, row in zip(("rear", "front"), rows, strict=True):
            cx, cy, a, b, degrees = _numbers(file, f"the {which} wheel", row, ELLIPSE, ELLIPSE)
            u, v = points_from_integer_centres([cx, cy])
            ellipses.append(Ellipse(float(u), float(v), a, b, math.radians(degrees)))
        return Wheels(*ellipses)


def _marks_file(path: str | Path) -> InputFile:
    return InputFile(Path(path), [], QuickStartError, "list of marks", numbers_as_text=True)


def _numbers(
    file: InputFile, where: str, row: Sequence[str], names: Sequence[str], chosen: Sequence[str]
) -> list[float]:
    if len(row) != len(names):
        wanted = f"wanted {len(names)}: {', '.join(names)[:80]}"
        raise file.error(f"{where} has {len(row)} values", wanted)
    return [
        file.number(row[names.index(n)].strip(), f"{where}: {n}", MAX_VALUES.get(n, MAX_NUMBER))
        for n in chosen
    ]
