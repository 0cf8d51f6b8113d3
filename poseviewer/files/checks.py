"""Checked values of files: every error names the file and the field."""

import json
import logging
import math
import re
import stat
import struct
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Annotated, Any, TypeVar

import msgspec
import numpy as np
from cv2.utils import logging as cv2_logging
from msgspec import Meta
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError, PoseViewerError, SettingsError, printable
from poseviewer.files.writing import keep
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.transform import nearest_rotation

ROUNDING = 1e-6
"""A rotation this near to orthonormal is taken as rounded, and made exact without a warning."""
MAX_REPAIR_DEG = 1.0
MAX_FILE_BYTES = 50_000_000
"""Limit of a file of numbers and names; 100,000 cameras have fewer."""
MAX_DATA_BYTES = 2_000_000_000
"""Limit of a picture, a model or a table."""
MAX_NUMBER = 1e30
"""Beyond it, and below its reciprocal, products of numbers leave the range of 32-bit floats."""
MAX_PX = 1e7
"""Limit of focal lengths, principal points and sides: 100 times those of the largest pictures."""
MAX_NAME_LETTERS = 200
MAX_QUOTE_LETTERS = 60
Number = Annotated[float, Meta(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Positive = Annotated[float, Meta(ge=1.0 / MAX_NUMBER, le=MAX_NUMBER)]
Pixels = Annotated[int, Meta(ge=1, le=10_000_000)]
Three = Annotated[tuple[Number, ...], Meta(min_length=3, max_length=3)]
Rows = Annotated[tuple[Three, ...], Meta(min_length=3, max_length=3)]
OWN = (PoseFileError, SettingsError)
"""Errors of files that poseviewer writes itself and may replace; others are the user's own."""
KEY = re.compile(r"[^.\[\]]+|\.\.\.")
TYPE = re.compile(r"`(.*?)`")
NAMES = {
    "float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false",
    "array": "a list", "object": "an object {...}",
}  # fmt: skip
"""msgspec's types in words."""
LIMITS = {
    f" >= {1.0 / MAX_NUMBER}": " above 0",
    f" >= {-MAX_NUMBER}": f" of at most {MAX_NUMBER:g}",
    f" <= {MAX_NUMBER}": f" of at most {MAX_NUMBER:g}",
}
"""msgspec's limits in words."""

PATTERN = re.compile(r"%\d*d|#{2,}|[*?]|\{:?\d*d?\}")
"""Placeholders of numbers in names, as renderers and ffmpeg have them."""
OF_PYTHON = (
    LookupError, TypeError, AttributeError, ArithmeticError, AssertionError, UnicodeError,
    StopIteration, RecursionError, NotImplementedError, struct.error, EOFError, ImportError,
)  # fmt: skip
"""Errors of a parser that met what it had not expected, whose words say nothing of the file."""
WORDS_OF_PYTHON = re.compile(
    "could not convert|invalid literal|to unpack|reshape|buffer|broadcast|inhomogeneous|concatenate"
    "|dtype|operands|object of type|__"
)
"""Words, likewise, of errors of other kinds."""

Value = TypeVar("Value")

_log = logging.getLogger(__name__)


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Silence Pillow and OpenCV (not libjpeg) inside the ``with`` block."""
    pillow, cv2_level = logging.getLogger("PIL"), cv2_logging.getLogLevel()
    level = pillow.level
    cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_SILENT)
    pillow.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        cv2_logging.setLogLevel(cv2_level)
        pillow.setLevel(level)


@dataclass(frozen=True, slots=True)
class InputFile:
    """A file to be read, with its checks: each takes a value and its name."""

    path: Path
    warnings: list[str] = field(default_factory=list)
    error_type: type[PoseViewerError] = PoseFileError
    kind: str = "pose file"
    largest: int = MAX_FILE_BYTES
    numbers_as_text: bool = False
    """Whether a text counts as the number that it spells."""

    def error(self, found: str, wanted: str) -> PoseViewerError:
        """Return an error that names the file."""
        name = printable(self.path.name or str(self.path), MAX_NAME_LETTERS)
        return self.error_type(f"{name}: {found}; {wanted}.")

    def check_size(self) -> None:
        """Raise unless it is a regular file (a pipe blocks) of 1 to ``largest`` bytes."""
        wanted = f"wanted a {self.kind}"
        try:
            status = self.path.stat()
        except (FileNotFoundError, ValueError):  # or a name that no file can have
            wanted = "check the path"
            if PATTERN.search(self.path.name):
                wanted = "name the folder of the images, not a pattern of their names"
            raise self.error(f"no such file in {self.path.parent}", wanted) from None
        if stat.S_ISDIR(status.st_mode):
            raise self.error("is a folder", wanted)
        if not stat.S_ISREG(status.st_mode):
            raise self.error("a pipe or a device, not a file", wanted)
        if status.st_size > self.largest:
            wanted = f"poseviewer takes a {self.kind} of up to {self.largest:,}"
            raise self.error(f"{status.st_size:,} bytes", wanted)
        if not status.st_size:
            raise self.error("an empty file", f"{wanted}, copy it again")
        if self.error_type not in OWN:
            keep(self.path)

    def open(self) -> IO[bytes]:
        """Open the file once its size is checked.

        Raises:
            PoseViewerError, OSError: the file cannot be read, or is too large.
        """
        self.check_size()
        return self.path.open("rb")

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
            is_of_python = isinstance(error, OF_PYTHON) or WORDS_OF_PYTHON.search(str(error))
            reason = "" if is_of_python else printable(str(error), 120)
            found = f"not a readable {self.kind}{reason and f' ({reason})'}"
            raise self.error(found, "is it whole? Make it again") from error

    def load_bytes(self) -> bytes:
        """Load the file's content, 1 to ``largest`` bytes."""
        with self.naming_errors(), self.open() as file:
            return file.read()

    def load_text(self) -> str:
        """Load the file's text, in UTF-8."""
        try:
            return self.load_bytes().decode("utf-8-sig")
        except UnicodeDecodeError:
            raise self.error("not a text in UTF-8", f"wanted a {self.kind}") from None

    def load_json(self) -> Any:
        """Load the file's JSON."""
        try:
            return json.loads(self.load_text())
        except (ValueError, RecursionError) as error:
            wanted = f"wanted a {self.kind}, a whole one"
            raise self.error(f"not JSON ({str(error)[:80]})", wanted) from error

    def load_object(self) -> dict[str, Any]:
        """Load the file's JSON, an object."""
        return self.object(self.load_json(), "its content")

    def object(self, value: Any, what: str) -> dict[str, Any]:
        """Check that a value is a JSON object."""
        if not isinstance(value, dict):
            raise self.error(f"{what} is {kind_of(value)}", "wanted an object {...}")
        return value

    def load_beside_model(self, name: str, unit: str | None) -> dict[str, Any]:
        """Load a file of the format ``name`` that lies beside a model, in the model's unit."""
        data = self.load_object()
        self.require_format(data, name)
        own = data.get("unit")
        if own is not None and unit is not None and own != unit:
            found = f"lengths in {kind_of(own)}, the model's are in {unit!r}"
            raise self.error(found, "give them in the model's unit")
        return data

    def require_format(self, data: dict[str, Any], name: str, wanted: int = 1) -> None:
        """Raise unless ``format`` and ``version`` are absent or are those that are wanted."""
        if data.get("format", name) != name:
            raise self.error(f"format is {kind_of(data['format'])}", f"wanted {name!r}")
        version = data.get("version", wanted)
        if version is True or version != wanted:
            reads = f"this poseviewer reads version {wanted}, open it with the one that wrote it"
            raise self.error(f"version is {kind_of(version)}", reads)

    def decode(
        self, data: Any, kind: type[Value], what: str = "", raw: Sequence[str] = ()
    ) -> Value:
        """Convert JSON data to a type that msgspec knows.

        Null counts as missing, 640.0 as a whole number; a rotation is made exact.

        Args:
            data: values as JSON holds them.
            kind: type that is wanted.
            what: name of the data in messages.
            raw: keys whose texts, or maps of texts, stay as they are; others are ``printable``.

        Raises:
            PoseViewerError: names the place, what is there, and what was wanted.
        """
        data = self._plain(data, raw)
        try:
            return msgspec.convert(data, kind)
        except msgspec.ValidationError as error:
            raise self._refusal(str(error), data, what) from None

    def _refusal(self, said: str, data: Any, what: str) -> PoseViewerError:
        """Return the error for what msgspec ``said`` of data: a reason, " - at `$" and a place."""
        reason, _, place = said.removesuffix("`").partition(" - at `$")
        where = (what + place).lstrip(".")
        if reason.startswith("Object missing"):
            name = f"{where}.{reason.split('`')[1]}".lstrip(".")
            return self.error(f"{name} is missing", "wanted it")
        if not reason.startswith(("Expected", "Invalid", "Number")):  # a struct's own check
            found, _, wanted = reason.partition("; ")
            return self.error(f"{where}{found}".lstrip("."), wanted)
        found = f"{where or 'its content'} is {kind_of(_value_at(place, data))}"
        return self.error(found, f"wanted {_wanted(reason)}")

    def _plain(self, value: Any, raw: Sequence[str]) -> Any:
        if isinstance(value, str):
            value = printable(value)
            with suppress(ValueError):
                value = float(value) if self.numbers_as_text else value
        if isinstance(value, list):
            return [self._plain(item, raw) for item in value]
        if isinstance(value, dict):
            kept = {printable(key): item for key, item in value.items() if item is not None}
            with suppress(KeyError, msgspec.ValidationError):
                matrix = np.array(msgspec.convert(kept["rotation"], Rows))
                kept["rotation"] = repair_rotation(self, matrix).tolist()
            return {
                key: item if key in raw and isinstance(item, str | dict) else self._plain(item, raw)
                for key, item in kept.items()
            }
        if isinstance(value, float) and 0.0 < abs(value) < 1e15 and value.is_integer():
            return int(value)
        return value

    def number(self, value: Any, what: str, most: float = MAX_NUMBER) -> float:
        """Check a number from -``most`` to ``most``; no truth value."""
        kind: Any = Annotated[float, Meta(ge=-most, le=most)]
        return self.decode(value, kind, what)

    def positive(self, value: Any, what: str, most: float = MAX_NUMBER) -> float:
        """Check a number above 0 and up to ``most``."""
        kind: Any = Annotated[float, Meta(ge=1.0 / MAX_NUMBER, le=most)]
        return self.decode(value, kind, what)

    def flat_numbers(self, value: Any, what: str, length: int | None = None) -> list[float]:
        """Flatten the numbers of a text, of (lists in) a list, or of OpenCV's ``{rows, data}``."""
        value = value.get("data") if isinstance(value, dict) else value
        file = replace(self, numbers_as_text=True) if isinstance(value, str) else self
        value = value.split() if isinstance(value, str) else value
        rows = file.decode(value, list[Number | list[Number]], what)
        numbers = [item for row in rows for item in (row if isinstance(row, list) else [row])]
        if length not in (None, len(numbers)):
            raise self.error(f"{what} has {len(numbers)} numbers", f"wanted {length} numbers")
        return numbers

    def text(self, value: Any, what: str) -> str:
        """Check a text, made ``printable``; "" for None."""
        kind: Any = str | None
        return self.decode(value, kind, what) or ""

    def size(self, value: Any, what: str) -> int | None:
        """Check a whole number above 0, or None."""
        kind: Any = Pixels
        return None if value is None else self.decode(value, kind, what)


def _value_at(place: str, data: Any) -> Any:
    """Return the value in JSON data at a place such as ``.poses[0].camera``."""
    for key in KEY.findall(place):
        if not isinstance(data, dict):
            data = data[int(key)]
        elif key == "...":  # any entry of a map
            data = next(iter(data.values()))
        else:
            data = data.get(key)
    return data


def _wanted(reason: str) -> str:
    """Say in words what msgspec wanted."""
    if not reason.startswith("Expected"):
        return "one of those in the file's schema"
    wanted = TYPE.sub(_words, reason.removeprefix("Expected ").partition(", got")[0])
    for limit, words in LIMITS.items():
        wanted = wanted.replace(limit, words)
    return wanted


def _words(types: re.Match[str]) -> str:
    return " or ".join(NAMES.get(name, name) for name in types[1].split(" | ") if name != "null")


def kind_of(value: Any) -> str:
    """Describe a JSON value for a message."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "an object"
    if value is None:
        return "missing"
    try:
        return printable(repr(value), MAX_QUOTE_LETTERS)
    except ValueError:  # Python writes no whole number of over 4300 digits
        return "a number of thousands of digits"


def is_there(path: Path) -> bool:
    """Tell whether there is such a file, by any name that files say of others."""
    try:
        return path.is_file()
    except OSError:  # too long, or a folder that is not to be looked into
        return False


def rotation_of(file: InputFile, quaternion: Sequence[float], what: str) -> FloatArray:
    """Return the rotation matrix of a quaternion x y z w, whose length is 1 but for rounding."""
    if not 0.99 < float(np.linalg.norm(quaternion)) < 1.01:
        raise file.error(f"{what} is {list(quaternion)}", "wanted a quaternion of length 1")
    return Rotation.from_quat(quaternion).as_matrix()


def repair_rotation(file: InputFile, matrix: FloatArray) -> FloatArray:
    """Return the nearest rotation; the matrix itself where it is one to the last digits."""
    nearest = nearest_rotation(matrix)
    # A small angle moves the matrix by sqrt(2) of it, in the Frobenius norm.
    off_deg = math.degrees(float(np.linalg.norm(matrix - nearest)) / math.sqrt(2.0))
    if off_deg >= MAX_REPAIR_DEG:
        found = f"the rotation is not a rotation matrix (determinant {np.linalg.det(matrix):.3g})"
        wanted = "wanted an orthonormal one of determinant 1; where it is -1, change the sign of"
        raise file.error(found, f"{wanted} an axis of the model or camera")
    error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if error < 1e-14:
        return matrix
    if error > ROUNDING:
        found = f"the rotation was not quite orthonormal (by {off_deg:.2g} degrees)"
        file.warnings.append(f"{file.path.name}: {found}; the nearest rotation is used.")
    return nearest
