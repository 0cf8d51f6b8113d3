"""Files into checked values: every error names the file, and the field; the libraries that parse
files are silent.
"""

from __future__ import annotations

import json
import logging
import math
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from cv2.utils import logging as cv2_logging

from poseviewer.errors import PoseFileError, PoseViewerError, printable
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera
from poseviewer.geometry.transform import nearest_rotation

SILENT = logging.CRITICAL + 1


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Silence trimesh, Pillow and OpenCV (not libjpeg) inside the ``with`` block."""
    levels = {logging.getLogger(name): logging.getLogger(name).level for name in ("trimesh", "PIL")}
    cv2_level = cv2_logging.getLogLevel()
    cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_SILENT)
    for logger in levels:
        logger.setLevel(SILENT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        cv2_logging.setLogLevel(cv2_level)
        for logger, level in levels.items():
            logger.setLevel(level)


VERSION = 1
"""Version of all our JSON formats."""
ROUNDING = 1e-6
"""A rotation this near to orthonormal is taken as rounded, and made exact without a warning."""
LARGEST_REPAIR_DEG = 1.0
LARGEST_FILE = 50_000_000
"""Bytes of numbers and names; a hundred thousand materials, or cameras, have fewer."""
LARGEST_NUMBER = 1e30
"""Beyond it, and below its reciprocal, products of numbers leave the range of 32-bit floats."""
LARGEST_PX = 1e7
"""Limit of focal lengths, principal points and sides: 100 times those of the longest lenses and
largest pictures."""
LONGEST_NAME = 200
"""Characters of a file's name in a message."""
LONGEST_QUOTE = 60
"""Characters of a value in a message."""

AnyCamera = TypeVar("AnyCamera", bound=Camera)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Reading:
    """A file being read, named in every error; its checks take a value and its name."""

    path: Path
    warnings: list[str] = field(default_factory=list)
    error_type: type[PoseViewerError] = PoseFileError
    kind: str = "pose file"
    """Kind of file that is wanted, for messages."""
    largest: int = LARGEST_FILE
    """Bytes."""
    numbers_as_text: bool = False
    """Whether a text counts as the number that it spells."""

    def error(self, found: str, wanted: str) -> PoseViewerError:
        """An error that names the file."""
        name = printable(self.path.name or str(self.path), LONGEST_NAME)
        return self.error_type(f"{name}: {found}; {wanted}.")

    def check_size(self) -> None:
        """Raise unless it is a regular file (a pipe blocks) of 1 to ``largest`` bytes."""
        wanted = f"wanted a {self.kind}"
        try:
            found = self.path.stat()
        except FileNotFoundError:
            raise self.error(f"no such file in {self.path.parent}", "check the path") from None
        except (OSError, ValueError) as error:  # a name that no file can have
            reason = getattr(error, "strerror", None) or str(error)
            raise self.error(f"cannot be read ({reason})", "check the path") from error
        if stat.S_ISDIR(found.st_mode):
            raise self.error("is a folder", wanted)
        if not stat.S_ISREG(found.st_mode):
            raise self.error("a pipe or a device, not a file", wanted)
        if found.st_size > self.largest:
            wanted = f"poseviewer takes a {self.kind} of up to {self.largest:,}"
            raise self.error(f"{found.st_size:,} bytes", wanted)
        if not found.st_size:
            raise self.error("an empty file", f"{wanted}, copy it again")

    def open(self) -> IO[bytes]:
        """The file, once its size is checked, for reading."""
        self.check_size()
        try:
            return self.path.open("rb")
        except OSError as error:
            raise self.error(f"cannot be read ({error.strerror})", "check the path") from error

    @contextmanager
    def naming_errors(self) -> Iterator[None]:
        """Turn any exception of a parser into an error that names the file; log unforeseen ones."""
        try:
            yield
        except PoseViewerError:
            raise
        except MemoryError as error:
            raise self.error("too large for this machine's memory", "make it smaller") from error
        except OSError as error:
            reason = error.strerror or error
            raise self.error(f"cannot be read ({reason})", "check the file") from error
        except Exception as error:
            _log.debug("reading %s", self.path, exc_info=error)
            found = printable(str(error), 120) or type(error).__name__
            wanted = "is it whole? Make it again"
            raise self.error(f"not a readable {self.kind} ({found})", wanted) from error

    def load_bytes(self) -> bytes:
        """The file's content, 1 to ``largest`` bytes."""
        with self.naming_errors(), self.open() as file:
            return file.read()

    def load_text(self) -> str:
        """Text of the file, in UTF-8."""
        try:
            return self.load_bytes().decode("utf-8-sig")
        except UnicodeDecodeError:
            raise self.error("not a text in UTF-8", f"wanted a {self.kind}") from None

    def load_json(self) -> Any:
        """Value of the file, JSON."""
        try:
            return json.loads(self.load_text())
        except (ValueError, RecursionError) as error:
            found = f"not JSON ({str(error)[:80]})"
            raise self.error(found, f"wanted a {self.kind}, a whole one") from error

    def load_object(self) -> dict[str, Any]:
        """Value of the file, a JSON object."""
        return self.object(self.load_json(), "its content")

    def object(self, value: Any, what: str) -> dict[str, Any]:
        """The value, a JSON object."""
        if not isinstance(value, dict):
            raise self.error(f"{what} is {kind_of(value)}", "wanted an object {...}")
        return value

    def require_format(self, data: dict[str, Any], name: str, newest: int = VERSION) -> None:
        """Raise unless ``format`` is absent or equals ``name``, in a version up to the newest."""
        if data.get("format", name) != name:
            raise self.error(f"format is {kind_of(data['format'])}", f"wanted {name!r}")
        version = data.get("version", VERSION)
        if version is True or version not in range(VERSION, newest + 1):
            wanted = f"this poseviewer reads versions up to {newest}, try a newer one"
            raise self.error(f"version is {kind_of(version)}", wanted)

    def require_unit(self, data: dict[str, Any], unit: str | None) -> None:
        """Raise unless the object's lengths are in the model's ``unit``, or it is not said."""
        own = data.get("unit")
        if own is not None and unit is not None and own != unit:
            found = f"lengths in {kind_of(own)}, the model's are in {unit!r}"
            raise self.error(found, "give them in the model's unit")

    def fields(
        self, value: Any, what: str, **checks: Callable[[Reading, Any, str], Any]
    ) -> list[Any]:
        """The fields of a JSON object that ``checks`` names, each checked by its function."""
        value, where = self.object(value, what or "its content"), f"{what}." if what else ""
        return [check(self, value.get(key), where + key) for key, check in checks.items()]

    def number(self, value: Any, what: str, most: float = LARGEST_NUMBER) -> float:
        """A number from -``most`` to ``most``; not a bool, which is an int in Python."""
        try:
            if isinstance(value, bool) or (isinstance(value, str) and not self.numbers_as_text):
                raise TypeError
            found = float(value)
        except (TypeError, ValueError, OverflowError):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a number") from None
        if not abs(found) <= most:  # nor nan
            wanted = f"wanted a finite number, of at most {most:g}"
            raise self.error(f"{what} is {kind_of(value)}", wanted)
        return found

    def positive(self, value: Any, what: str, most: float = LARGEST_NUMBER) -> float:
        """A number above 0 and up to ``most``."""
        found = self.number(value, what, most)
        if not found >= 1.0 / LARGEST_NUMBER:
            raise self.error(f"{what} is {kind_of(value)}", "wanted a number above 0")
        return found

    def numbers(self, value: Any, what: str, length: int = 3) -> list[float]:
        """The value, a list of ``length`` finite numbers."""
        if not isinstance(value, list) or len(value) != length:
            raise self.error(f"{what} is {kind_of(value)}", f"wanted a list of {length} numbers")
        return [self.number(item, f"{what}[{i}]") for i, item in enumerate(value)]

    def flat_numbers(self, value: Any, what: str, length: int | None = None) -> list[float]:
        """Numbers of a text, of (lists in) a list, or of OpenCV's ``{rows, cols, data}``."""
        value = value.get("data") if isinstance(value, dict) else value
        reading = replace(self, numbers_as_text=True) if isinstance(value, str) else self
        value = value.split() if isinstance(value, str) else value
        if not isinstance(value, list):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a list of numbers")
        rows = [item if isinstance(item, list) else [item] for item in value]
        numbers = [reading.number(item, what) for row in rows for item in row]
        if length not in (None, len(numbers)):
            raise self.error(f"{what} has {len(numbers)} numbers", f"wanted {length} numbers")
        return numbers

    def text(self, value: Any, what: str) -> str | None:
        """The value, a text or None; made ``printable``."""
        if value is not None and not isinstance(value, str):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a text")
        return None if value is None else printable(value)

    def size(self, value: Any, what: str) -> int | None:
        """The value, a whole number above 0 or None."""
        if value is None:
            return None
        found = self.positive(value, what, LARGEST_PX)
        if found != int(found):
            raise self.error(f"{what} is {kind_of(value)}", "wanted a whole number above 0")
        return int(found)


def kind_of(value: Any) -> str:
    """Describe a JSON value for a message."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "an object"
    if value is None:
        return "missing"
    try:
        return printable(repr(value), LONGEST_QUOTE)
    except ValueError:  # Python writes no whole number of over 4300 digits
        return "a number of thousands of digits"


def is_there(path: Path) -> bool:
    """Whether there is such a file; no file can have some names that files say of others."""
    try:
        return path.is_file()
    except OSError:  # too long, or a folder that is not to be looked into
        return False


def read_json(path: Path) -> Any:
    """Value of a JSON file; raises PoseFileError where it cannot be read, or is none."""
    return Reading(path).load_json()


def checked_camera(reading: Reading, camera: AnyCamera) -> AnyCamera:
    """The camera, whose numbers a picture can hold; raises the reading's error where it cannot."""
    below, above = 1.0 / LARGEST_PX, LARGEST_PX
    for name in ("fx", "fy", "cx", "cy"):
        found = getattr(camera, name, 1.0)  # a parallel camera has a scale instead of fx and fy
        least = below if name.startswith("f") else -above
        if not least <= found <= above:
            raise reading.error(f"{name} is {found:.6g} px", f"wanted {least:g} to {above:g}")
    return camera


def checked_rotation(reading: Reading, matrix: FloatArray) -> FloatArray:
    """The nearest rotation; the matrix itself where it is one to the last digits."""
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
            f"{reading.path.name}: the rotation was not quite orthonormal "
            f"(by {_angle_off_deg(matrix):.2g} degrees); the nearest rotation is used."
        )
    return nearest_rotation(matrix)


def _angle_off_deg(matrix: FloatArray) -> float:
    """The Frobenius distance to a rotation, as an angle: a small one moves it by sqrt(2) of it."""
    distance = float(np.linalg.norm(matrix - nearest_rotation(matrix)))
    return math.degrees(distance / math.sqrt(2.0))
