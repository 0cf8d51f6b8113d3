"""Marks on a photo from files and the command line: point pairs, and the ellipses of two wheels.

As in all files, pixel centres are at integers; inside at i + 0.5 (``geometry.frames``).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import QuickStartError
from poseviewer.files.checks import LARGEST_NUMBER, LARGEST_PX, Reading
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.frames import points_from_integer_centres
from poseviewer.vehicle.wheel_pose import Ellipse, Wheels

PAIR = ("x", "y", "z", "u", "v")
ELLIPSE = ("cx", "cy", "a", "b", "angle")
PHOTO = (*PAIR[3:], *ELLIPSE[:4])
"""Of these, what is in px of the photo."""
WHEELS = ("rear", "front")
LARGEST_FILE = 1_000_000
"""Bytes; a thousand pairs have fewer."""


@dataclass(frozen=True, slots=True, eq=False)
class PointPairs:
    """Points of the model and where the photo shows them."""

    points: FloatArray
    """(n, 3), in the model's frame and unit."""
    pixels: FloatArray
    """(n, 2), px, pixel centres at i + 0.5."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_array(self.points, (-1, 3)))
        object.__setattr__(self, "pixels", frozen_array(self.pixels, (-1, 2)))


def load_pairs(path: str | Path) -> PointPairs:
    """Point pairs from CSV (columns x, y, z, u, v, with or without a header) or JSON (a list of
    such rows, or of ``{"model": [x, y, z], "photo": [u, v]}``, alone or under ``"pairs"``).

    Raises:
        QuickStartError: there is no such file, or it holds something else.
    """
    reading = _reading(path)
    with reading.naming_errors():
        text = reading.load_text()
        rows = _json_rows(reading) if text.lstrip()[:1] in ("[", "{") else _csv_rows(text)
        numbers = [_numbers(reading, where, row, PAIR) for where, row in rows]
    table = np.array(numbers, dtype=float).reshape(-1, len(PAIR))
    return PointPairs(table[:, :3], points_from_integer_centres(table[:, 3:]))


def load_wheels(text: str) -> Wheels:
    """Wheels from ``cx,cy,a,b,angle;cx,cy,a,b,angle`` (rear, then front; half axes in px, degrees
    clockwise from the u axis), or from the JSON file of that name, ``{"rear": {"cx": ...},
    "front": ...}``.

    Raises:
        QuickStartError: it is neither.
    """
    reading = _reading("--wheels" if ";" in text else text)
    with reading.naming_errors():
        return _wheels_in(reading, text)


def _wheels_in(reading: Reading, text: str) -> Wheels:
    wheels = [wheel.split(",") for wheel in text.split(";") if wheel.strip()]
    if ";" not in text:
        data = reading.load_json()
        wheels = [data.get(wheel) if isinstance(data, dict) else None for wheel in WHEELS]
    elif len(wheels) != len(WHEELS):
        wanted = "wanted two, rear;front, each cx,cy,a,b,angle"
        raise reading.error(f"{len(wheels)} ellipses", wanted)
    found = []
    for which, wheel in zip(WHEELS, wheels, strict=True):
        row = [wheel.get(key) for key in ELLIPSE] if isinstance(wheel, dict) else wheel
        if not isinstance(row, list):
            wanted = f"wanted rear and front, each with {', '.join(ELLIPSE)}"
            raise reading.error(f"no ellipse {which!r}", wanted)
        cx, cy, a, b, degrees = _numbers(reading, f"the {which} wheel", row, ELLIPSE)
        u, v = points_from_integer_centres([cx, cy])
        found.append(Ellipse(float(u), float(v), a, b, math.radians(degrees)))
    return Wheels(*found)


def _reading(path: str | Path) -> Reading:
    return Reading(Path(path), [], QuickStartError, "list of marks", LARGEST_FILE, True)


def _json_rows(reading: Reading) -> Iterable[tuple[str, Sequence[Any]]]:
    data = reading.load_json()
    rows = data.get("pairs") if isinstance(data, dict) else data
    if not isinstance(rows, list):
        raise reading.error('no list "pairs"', "wanted rows of x, y, z, u, v")
    for number, row in enumerate(rows, 1):
        if isinstance(row, dict):
            model, photo = row.get("model"), row.get("photo")
            both = isinstance(model, list) and isinstance(photo, list)
            row = [*(model or []), *(photo or [])] if both else [row.get(key) for key in PAIR]
        yield f"pair {number}", row if isinstance(row, list) else [row]


def _csv_rows(text: str) -> list[tuple[str, Sequence[Any]]]:
    """All rows but empty ones, comments, and a header that names the columns."""
    separator = ";" if ";" in text and "," not in text else ","
    rows: list[tuple[str, Sequence[Any]]] = [
        (f"line {number}", [cell.strip() for cell in row])
        for number, row in enumerate(csv.reader(StringIO(text), delimiter=separator), 1)
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
    ]
    named = bool(rows) and not any(_number(cell) is not None for cell in rows[0][1])
    return rows[1:] if named else rows


def _number(value: Any) -> float | None:
    try:
        return None if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None


def _numbers(reading: Reading, where: str, row: Sequence[Any], names: Sequence[str]) -> list[float]:
    if len(row) != len(names):
        wanted = f"wanted {len(names)} numbers, {', '.join(names)}"
        raise reading.error(f"{where} has {len(row)} values", wanted)
    return [
        reading.number(value, f"{where}: {name}", LARGEST_PX if name in PHOTO else LARGEST_NUMBER)
        for value, name in zip(row, names, strict=True)
    ]
