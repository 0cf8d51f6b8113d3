"""Text and JSON files into checked values: every error names the file and the field."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError, PoseViewerError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.transform import nearest_rotation

ROUNDING = 1e-6
"""A rotation this near to orthonormal is taken as rounded, and made exact without a word."""
LARGEST_REPAIR_DEG = 1.0
LARGEST_FILE = 10_000_000
"""Bytes: a pose file has some thousand."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A file being read: its name stands in every error, and it gathers warnings."""

    name: str
    warnings: list[str] = field(default_factory=list)
    error_type: type[PoseViewerError] = PoseFileError
    numbers_as_text: bool = False
    """Whether a text counts as the number that it spells."""

    def error(self, found: str, wanted: str) -> PoseViewerError:
        """An error that names the file."""
        return self.error_type(f"{self.name}: {found}; {wanted}.")

    def object(self, value: Any, what: str) -> dict[str, Any]:
        """The value, a JSON object."""
        if not isinstance(value, dict):
            raise self.error(f"{what} is {kind_of(value)}", "wanted an object {...}")
        return value

    def number(self, value: Any, what: str, positive: bool = False) -> float:
        """A finite number; bool is none, though Python thinks so."""
        try:
            if isinstance(value, bool) or (isinstance(value, str) and not self.numbers_as_text):
                raise TypeError
            found = float(value)
        except (TypeError, ValueError):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a number") from None
        except OverflowError:  # a whole number beyond 1e308
            found = math.inf
        if not math.isfinite(found):
            raise self.error(f"{what} is {str(value)[:40]}", "wanted a finite number")
        if positive and not found > 0:
            raise self.error(f"{what} is {value}", "wanted a number above 0")
        return found

    def numbers(self, value: Any, what: str, length: int) -> list[float]:
        """The value, a list of ``length`` finite numbers."""
        if not isinstance(value, list) or len(value) != length:
            raise self.error(f"{what} is {kind_of(value)}", f"wanted a list of {length} numbers")
        return [self.number(item, f"{what}[{i}]") for i, item in enumerate(value)]

    def flat_numbers(self, value: Any, what: str) -> list[float]:
        """The numbers of a list, of lists in it, or of OpenCV's ``{rows, cols, data}``."""
        value = value.get("data") if isinstance(value, dict) else value
        if not isinstance(value, list):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a list of numbers")
        rows = [item if isinstance(item, list) else [item] for item in value]
        return [self.number(item, what) for row in rows for item in row]

    def words(self, text: str, what: str, length: int | None = None) -> list[float]:
        """The numbers that a text has between its blanks: ``length`` of them, or any number."""
        words = text.split()
        if length is not None and len(words) != length:
            raise self.error(f"{what} is {text.strip()[:60]!r}", f"wanted {length} numbers")
        try:
            return [self.number(float(word), what) for word in words]
        except ValueError:
            raise self.error(f"{what} is {text.strip()[:60]!r}", "wanted numbers") from None

    def text(self, value: Any, what: str) -> str | None:
        """The value, a text or None."""
        if value is not None and not isinstance(value, str):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a text")
        return value

    def texts(self, value: Any, what: str) -> tuple[str, ...]:
        """The value, a list of texts."""
        if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a list of texts")
        return tuple(value)

    def size(self, value: Any, what: str) -> int | None:
        """The value, a whole number above 0 or None."""
        if value is None:
            return None
        found = self.number(value, what, positive=True)
        if found != int(found):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a whole number above 0")
        return int(found)


def kind_of(value: Any) -> str:
    """What a JSON value is, for a message."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "an object"
    return "missing" if value is None else repr(value)[:60]


def read_text(
    path: Path,
    largest: int = LARGEST_FILE,
    kind: str = "pose file",
    error_type: type[PoseViewerError] = PoseFileError,
) -> str:
    """What a file of ``kind`` and of at most ``largest`` bytes says, in UTF-8.

    Raises:
        error_type: there is no such file, or it is empty or no text.
    """
    reading = Reading(path.name or str(path), error_type=error_type)
    if path.is_dir():
        raise reading.error("is a folder", f"wanted a {kind}")
    try:
        if path.stat().st_size > largest:
            raise reading.error(f"larger than any {kind}", f"wanted a {kind}")
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise reading.error(f"no such file in {path.parent}", "check the path") from None
    except OSError as error:
        raise reading.error(f"cannot be read ({error.strerror})", "check the path") from error
    except UnicodeDecodeError:
        raise reading.error("not a text", f"wanted a {kind}") from None
    if not text.strip():
        raise reading.error("an empty file", f"wanted a {kind}")
    return text


def read_json(
    path: Path,
    largest: int = LARGEST_FILE,
    kind: str = "pose file",
    error_type: type[PoseViewerError] = PoseFileError,
) -> Any:
    """What a JSON file holds; arguments and errors as ``read_text``'s.

    Raises:
        error_type: it cannot be read, or is not JSON.
    """
    try:
        return json.loads(read_text(path, largest, kind, error_type))
    except (ValueError, RecursionError) as error:
        reading = Reading(path.name, error_type=error_type)
        found = f"not JSON ({str(error)[:80]})"
        raise reading.error(found, f"wanted a {kind}, a whole one") from error


def checked_rotation(reading: Reading, matrix: FloatArray) -> FloatArray:
    """The rotation nearest to a matrix (3, 3) that is one but for rounding or a small error.

    A matrix that is one to the last digits is kept as it is, so that reading gives what was
    written.
    """
    if np.abs(matrix).max() > 2.0:
        raise reading.error("the rotation has entries beyond 1", "wanted an orthonormal matrix")
    mirrored = np.linalg.det(matrix) < 0.0
    if mirrored and _angle_off_deg(-matrix) < LARGEST_REPAIR_DEG:
        raise reading.error(
            "the rotation is a reflection (determinant -1)",
            "wanted a rotation, change the sign of one axis and of the model or camera",
        )
    error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if mirrored or _angle_off_deg(matrix) >= LARGEST_REPAIR_DEG:
        raise reading.error(
            f"the rotation is not a rotation matrix (R R^T differs from 1 by {error:.3g})",
            "wanted an orthonormal matrix with determinant 1",
        )
    if error < 1e-14:
        return matrix
    if error > ROUNDING:
        reading.warnings.append(
            f"{reading.name}: the rotation was not quite orthonormal "
            f"(by {_angle_off_deg(matrix):.2g} degrees); the nearest rotation is used."
        )
    return nearest_rotation(matrix)


def _angle_off_deg(matrix: FloatArray) -> float:
    """The Frobenius distance to a rotation, as an angle: a small one moves it by sqrt(2) of it."""
    distance = float(np.linalg.norm(matrix - nearest_rotation(matrix)))
    return math.degrees(distance / math.sqrt(2.0))
