"""JSON into numbers, each checked: errors name the file and the field."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.transform import nearest_rotation

SILENT_ROTATION_ERROR = 1e-6
"""A rotation this near to orthonormal is taken as rounded, and made exact without a word."""
LARGEST_REPAIR_DEG = 1.0
LARGEST_FILE = 10_000_000
"""Bytes: a pose file has some thousand."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A file being read: its name stands in every error, and it gathers warnings."""

    name: str
    warnings: list[str]

    def error(self, found: str, wanted: str) -> PoseFileError:
        """An error that names the file."""
        return PoseFileError(f"{self.name}: {found}; {wanted}.")

    def object(self, value: Any, what: str) -> dict[str, Any]:
        """The value, a JSON object."""
        if not isinstance(value, dict):
            raise self.error(f"{what} is {kind_of(value)}", "wanted an object {...}")
        return value

    def number(self, value: Any, what: str, positive: bool = False) -> float:
        """A finite number; bool is none, though Python thinks so."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a number")
        if not _is_finite(value):
            raise self.error(f"{what} is {str(value)[:40]}", "wanted a finite number")
        if positive and not value > 0:
            raise self.error(f"{what} is {value}", "wanted a number above 0")
        return float(value)

    def numbers(self, value: Any, what: str, length: int) -> list[float]:
        """The value, a list of ``length`` finite numbers."""
        if not isinstance(value, list) or len(value) != length:
            raise self.error(f"{what} is {kind_of(value)}", f"wanted a list of {length} numbers")
        return [self.number(item, f"{what}[{i}]") for i, item in enumerate(value)]

    def text(self, value: Any, what: str) -> str | None:
        """The value, a text or None."""
        if value is not None and not isinstance(value, str):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a text")
        return value

    def size(self, value: Any, what: str) -> int | None:
        """The value, a whole number above 0 or None."""
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise self.error(f"{what} is {kind_of(value)}", "wanted a whole number above 0")
        return value


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond 1e308
        return False


def kind_of(value: Any) -> str:
    """What a JSON value is, for a message."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "an object"
    return "missing" if value is None else repr(value)[:60]


def read_json(path: Path, largest: int = LARGEST_FILE) -> Any:
    """What a JSON file of at most ``largest`` bytes holds.

    Raises:
        PoseFileError: there is no such file, or it is not JSON.
    """
    if path.is_dir():
        raise PoseFileError(f"{path.name or path}: is a folder; wanted a pose file (.json).")
    try:
        if path.stat().st_size > largest:
            raise PoseFileError(f"{path.name}: larger than any pose file; wanted a pose file.")
        return json.loads(path.read_bytes().decode("utf-8-sig"))
    except FileNotFoundError:
        raise PoseFileError(
            f"{path.name}: no such file in {path.parent}; check the path."
        ) from None
    except OSError as error:
        raise PoseFileError(f"{path.name}: cannot be read ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise PoseFileError(
            f"{path.name}: not JSON ({str(error)[:80]}); is it a pose file, and whole?"
        ) from error


def checked_rotation(reading: Reading, matrix: FloatArray) -> FloatArray:
    """The rotation nearest to a matrix that is one but for rounding or a small error.

    A matrix that is one to the last digits is kept as it is, so that reading gives what was
    written.
    """
    if np.abs(matrix).max() > 2.0:
        raise reading.error("the rotation has entries beyond 1", "wanted an orthonormal matrix")
    if np.linalg.det(matrix) < 0.0 and _angle_off_deg(-matrix) < LARGEST_REPAIR_DEG:
        raise reading.error(
            "the rotation is a reflection (determinant -1)",
            "wanted a rotation, change the sign of one axis and of the model or camera",
        )
    error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if np.linalg.det(matrix) < 0.0 or _angle_off_deg(matrix) >= LARGEST_REPAIR_DEG:
        raise reading.error(
            f"the rotation is not a rotation matrix (R R^T differs from 1 by {error:.3g})",
            "wanted an orthonormal matrix with determinant 1",
        )
    if error < 1e-14:
        return matrix
    if error > SILENT_ROTATION_ERROR:
        reading.warnings.append(
            f"{reading.name}: the rotation was not quite orthonormal "
            f"(by {_angle_off_deg(matrix):.2g} degrees); the nearest rotation is used."
        )
    return nearest_rotation(matrix)


def _angle_off_deg(matrix: FloatArray) -> float:
    """How far a matrix is from a rotation: the Frobenius distance, as an angle.

    A small rotation by an angle moves a matrix by sqrt(2) times that angle.
    """
    distance = float(np.linalg.norm(matrix - nearest_rotation(matrix)))
    return math.degrees(distance / math.sqrt(2.0))
