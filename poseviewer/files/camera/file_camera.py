"""What every reader of camera files gives, and the reading that they share."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import CalibrationFileError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel

LARGEST_FILE = 50_000_000
"""Bytes: the cameras of a thousand photos have some hundred thousand."""
LARGEST_SKEW = 1e-6
"""As a share of the focal length."""


@dataclass(frozen=True, slots=True)
class FileCamera:
    """A camera as a file has it."""

    name: str
    """What it is called among the file's cameras; "" where there is one alone."""
    camera: Perspective
    """Pixel centres at i + 0.5; 0x0 px where the file does not say the size of its pictures."""
    lens: Lens | None = None
    """None for a pinhole."""
    photos: frozenset[str] = frozenset()
    """File names of the photos it took, as far as the file says."""


def problem(name: str, found: str, wanted: str) -> CalibrationFileError:
    """What is wrong with a file, to be raised."""
    return CalibrationFileError(f"{name}: {found}; {wanted}.")


def read_text(path: Path) -> str:
    """A camera file's text.

    Raises:
        CalibrationFileError: there is no such file, or it is no text.
    """
    if path.is_dir():
        raise problem(path.name or str(path), "is a folder", "wanted a file of cameras")
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise problem(path.name, "larger than any file of cameras", "wanted a file of cameras")
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise problem(path.name, f"no such file in {path.parent}", "check the path") from None
    except OSError as error:
        raise problem(path.name, f"cannot be read ({error.strerror})", "check the path") from error
    except UnicodeDecodeError:
        raise problem(
            path.name, "not a text", "wanted a file of cameras (YAML, JSON, XML or COLMAP's)"
        ) from None
    if not text.strip():
        raise problem(path.name, "an empty file", "wanted a file of cameras")
    return text


def parse_json(name: str, text: str) -> dict[str, Any]:
    """The object that a JSON text holds.

    Raises:
        CalibrationFileError: it is not JSON, or no object.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise problem(
            name, f"not JSON ({str(error)[:80]})", "is it a file of cameras, and whole"
        ) from error
    if not isinstance(data, dict):
        raise problem(name, "holds no object {...}", "wanted a file of cameras")
    return data


def number(name: str, value: Any, what: str, positive: bool = False) -> float:
    """A finite number, or one written as a text.

    Raises:
        CalibrationFileError: it is none.
    """
    try:
        found = math.nan if isinstance(value, bool | None) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise problem(name, f"{what} is {_short(value)}", "wanted a finite number")
    if positive and not found > 0.0:
        raise problem(name, f"{what} is {found:g}", "wanted a number above 0")
    return found


def numbers(name: str, value: Any, what: str) -> list[float]:
    """The numbers of a list, of lists in a list, or of OpenCV's ``{rows, cols, data}``.

    Raises:
        CalibrationFileError: it is none of these.
    """
    if isinstance(value, dict):
        value = value.get("data")
    if not isinstance(value, list):
        raise problem(name, f"{what} is {_short(value)}", "wanted a list of numbers")
    rows = [item if isinstance(item, list) else [item] for item in value]
    return [number(name, item, what) for row in rows for item in row]


def size(name: str, value: Any, what: str) -> int:
    """A picture's width or height: whole and above 0.

    Raises:
        CalibrationFileError: it is not.
    """
    found = number(name, value, what, positive=True)
    if found != int(found):
        raise problem(name, f"{what} is {found:g}", "wanted a whole number of px")
    return int(found)


def camera_of_matrix(
    name: str, values: list[float], what: str, size: tuple[int, int]
) -> Perspective:
    """The camera of a camera matrix (9 numbers, row by row), not shifted; size in px or (0, 0).

    Raises:
        CalibrationFileError: it is not the matrix of a pinhole without skew.
    """
    if len(values) != 9:
        raise problem(name, f"{what} has {len(values)} numbers", "wanted a 3x3 camera matrix")
    matrix = np.array(values).reshape(3, 3)
    fx, fy = (number(name, matrix[i, i], f"{what}: f{axis}", True) for i, axis in enumerate("xy"))
    if not np.allclose(matrix[2], [0.0, 0.0, 1.0]) or abs(matrix[1, 0]) > LARGEST_SKEW * fx:
        raise problem(name, f"{what} is {_short(values)}", "wanted rows fx 0 cx, 0 fy cy, 0 0 1")
    if abs(matrix[0, 1]) > LARGEST_SKEW * fx:
        raise problem(name, f"{what} has a skew of {matrix[0, 1]:g}", "calibrate without skew")
    return Perspective(fx, fy, float(matrix[0, 2]), float(matrix[1, 2]), *size)


def lens_of(name: str, model: LensModel, coefficients: list[float] | FloatArray) -> Lens | None:
    """The lens with these coefficients; None where they are all 0, and nothing is distorted.

    Raises:
        CalibrationFileError: the model has not so many.
    """
    values = tuple(float(value) for value in coefficients)
    if not any(values):
        return None
    if len(values) not in COEFFICIENTS[model]:
        wanted = ", ".join(str(count) for count in COEFFICIENTS[model])
        raise problem(
            name,
            f"{len(values)} distortion coefficients",
            f"OpenCV's {'fisheye' if model == 'fisheye' else 'standard'} model has {wanted}",
        )
    return Lens(model, values)


def _short(value: Any) -> str:
    return "missing" if value is None else repr(value)[:60]
