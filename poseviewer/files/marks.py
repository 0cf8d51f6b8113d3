"""Marks on a photo from files and the command line: point pairs, and the ellipses of two wheels.

As in all files, pixel centres are at integers; inside at i + 0.5 (``geometry.frames``).
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import QuickStartError
from poseviewer.files.pose.checks import kind_of
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.frames import points_from_integer_centres
from poseviewer.vehicle.ellipses import Ellipse
from poseviewer.vehicle.wheel_pose import Wheels

COLUMNS = ("x", "y", "z", "u", "v")
LARGEST_FILE = 1_000_000
"""Bytes; a thousand pairs have fewer."""
_ELLIPSE = ("cx", "cy", "a", "b", "angle")


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
    path = Path(path)
    text = _read(path)
    rows = _json_rows(path.name, text) if text.lstrip()[:1] in ("[", "{") else _csv_rows(text)
    numbers = [_numbers(f"{path.name}: {where}", row, COLUMNS) for where, row in rows]
    table = np.array(numbers, dtype=float).reshape(-1, len(COLUMNS))
    return PointPairs(table[:, :3], points_from_integer_centres(table[:, 3:]))


def load_wheels(text: str) -> Wheels:
    """Wheels from ``cx,cy,a,b,angle;cx,cy,a,b,angle`` (rear, then front; half axes in px, degrees
    clockwise from the u axis), or from the JSON file of that name, ``{"rear": {"cx": ...},
    "front": ...}``.

    Raises:
        QuickStartError: it is neither.
    """
    if ";" in text:
        parts = [part.split(",") for part in text.split(";") if part.strip()]
        if len(parts) != 2:
            raise QuickStartError(
                f"--wheels: {len(parts)} ellipses; wanted two, rear;front, each cx,cy,a,b,angle."
            )
        rows = [
            _numbers(f"--wheels: the {name} wheel", part, _ELLIPSE)
            for name, part in zip(("rear", "front"), parts, strict=True)
        ]
        return Wheels(*map(_ellipse, rows))
    path = Path(text)
    data = _parsed(path.name, _read(path))
    rows = []
    for name in ("rear", "front"):
        wheel = data.get(name) if isinstance(data, dict) else None
        if isinstance(wheel, dict):
            wheel = [wheel.get(key) for key in _ELLIPSE]
        if not isinstance(wheel, list):
            raise QuickStartError(
                f"{path.name}: no ellipse {name!r}; wanted rear and front, each with "
                f"{', '.join(_ELLIPSE)}."
            )
        rows.append(_numbers(f"{path.name}: the {name} wheel", wheel, _ELLIPSE))
    return Wheels(*map(_ellipse, rows))


def _read(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise QuickStartError(f"{path.name}: larger than any list of marks; is it the file?")
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise QuickStartError(
            f"{path.name}: no such file in {path.parent}; check the path."
        ) from None
    except OSError as error:
        raise QuickStartError(f"{path.name}: cannot be read ({error.strerror}).") from error
    except UnicodeDecodeError:
        raise QuickStartError(f"{path.name}: is no text; wanted CSV or JSON.") from None


def _parsed(name: str, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise QuickStartError(f"{name}: not JSON ({str(error)[:80]}); mend it.") from error


def _json_rows(name: str, text: str) -> list[tuple[str, Sequence[Any]]]:
    data = _parsed(name, text)
    rows = data.get("pairs") if isinstance(data, dict) else data
    if not isinstance(rows, list):
        raise QuickStartError(f'{name}: no list "pairs"; wanted rows of x, y, z, u, v.')
    found: list[tuple[str, Sequence[Any]]] = []
    for number, row in enumerate(rows, 1):
        if isinstance(row, dict):
            model, photo = row.get("model"), row.get("photo")
            lists = isinstance(model, list) and isinstance(photo, list)
            row = [*(model or []), *(photo or [])] if lists else [row.get(key) for key in COLUMNS]
        found.append((f"pair {number}", row if isinstance(row, list) else [row]))
    return found


def _csv_rows(text: str) -> list[tuple[str, Sequence[Any]]]:
    """All rows but empty ones, comments, and a header that names the columns."""
    separator = ";" if ";" in text and "," not in text else ","
    rows: list[tuple[str, Sequence[Any]]] = [
        (f"line {number}", [cell.strip() for cell in row])
        for number, row in enumerate(csv.reader(StringIO(text), delimiter=separator), 1)
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
    ]
    named = bool(rows) and not any(_is_number(cell) for cell in rows[0][1])
    return rows[1:] if named else rows


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(where: str, row: Sequence[Any], names: Sequence[str]) -> list[float]:
    wanted = f"wanted {len(names)} numbers, {', '.join(names)}."
    if len(row) != len(names):
        raise QuickStartError(f"{where} has {len(row)} values; {wanted}")
    numbers = []
    for value, name in zip(row, names, strict=True):
        try:
            number = math.nan if isinstance(value, bool) or value is None else float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise QuickStartError(f"{where}: {name} is {kind_of(value)}; {wanted}")
        numbers.append(number)
    return numbers


def _ellipse(row: Sequence[float]) -> Ellipse:
    cx, cy, a, b, degrees = row
    centre = points_from_integer_centres([cx, cy])
    return Ellipse(float(centre[0]), float(centre[1]), a, b, math.radians(degrees))
