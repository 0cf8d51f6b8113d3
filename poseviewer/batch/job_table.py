"""The table of jobs: photo, model and start of each row."""

import csv
import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from poseviewer.errors import BatchError
from poseviewer.files.checks import InputFile
from poseviewer.scene.settings import FitSettings, settings_as_json

COLUMNS = ("photo", "model", "start")
"""Columns that a table must have."""
BOX = "box"
"""Optional column: a rectangle about the object, for the start ``auto``."""
KEY_LENGTH = 16
"""Hexadecimal digits of a job's key: enough for millions of rows, short enough for file names."""

JobKey = Annotated[str, Meta(pattern=r"^[0-9a-z-]*\Z")]
"""A part of file names, which never leads out of a folder of results that someone else made."""


@dataclass(frozen=True, slots=True)
class Job:
    """A row: one photo to fit."""

    row: int
    """Number of the row, from 1 for the first after the column names."""
    photo: str
    """Path as in the table; ``model`` and ``start`` likewise."""
    model: str
    start: str
    folder: str
    """Folder of the table, absolute; relative paths start from it."""
    key: JobKey = ""
    """Hash of the files' names, sizes and times and of the settings; it names the result."""
    box: str = ""
    """Rectangle for the start ``auto``, as in the table: left, top, width, height in px."""
    problem: str = ""
    """Why the row cannot be fitted, as far as who made it knows; or empty."""
    is_hidden: bool = False
    """Whether the scene says that nothing of the object is visible in the photo."""
    frames: tuple[int, int] = (0, 0)
    """Indices of the first and last frame of a chain of a sequence."""

    def path(self, text: str) -> Path:
        """Return the absolute path of a file that the row names."""
        return Path(self.folder) / text

    def rectangle(self) -> tuple[int, int, int, int] | None:
        """Parse the box; None for an empty cell."""
        if not self.box:
            return None
        try:
            left, top, width, height = (int(part) for part in re.split(r"[\s,;]+", self.box))
        except ValueError:
            raise BatchError(
                f"the box {self.box!r} is not four whole numbers; write left,top,width,height."
            ) from None
        return left, top, width, height


def load_jobs(path: str | Path, settings: FitSettings) -> tuple[Job, ...]:
    """Read the rows of a CSV file by its ``COLUMNS`` and perhaps ``BOX``."""
    path = Path(path)
    folder = str(path.resolve().parent)
    jobs = [
        Job(number, row["photo"], row["model"], row["start"], folder, box=row.get(BOX, ""))
        for number, row in enumerate(_read_rows(path), 1)
    ]
    if not jobs:
        raise BatchError(f"{path.name}: no rows; wanted a photo, a model and a start in each.")
    return with_keys(jobs, settings)


def with_keys(jobs: Iterable[Job], settings: FitSettings) -> tuple[Job, ...]:
    """Give jobs their keys."""
    written = settings_as_json(settings)
    return tuple(replace(job, key=_key(job, written)) for job in jobs)


def _read_rows(path: Path) -> list[dict[str, str]]:
    reading = InputFile(path, [], BatchError, "table of jobs (CSV)")
    text = reading.load_text()
    head = text.split("\n", 1)[0]
    # Many spreadsheets write semicolons.
    delimiter = ";" if ";" in head and "," not in head else ","
    with reading.naming_errors():
        lines = list(csv.reader(StringIO(text, newline=""), delimiter=delimiter))
    lines = [cells for line in lines if any(cells := [cell.strip() for cell in line])]
    names = [name.lower() for name in lines[0]] if lines else []
    missing = [column for column in COLUMNS if column not in names]
    if missing:
        given = ", ".join(names)[:100] or "nothing"
        raise reading.error(
            f"no column {missing[0]!r} in its first line, which has {given}",
            f"wanted {', '.join(COLUMNS)}",
        )
    double = next((name for name, count in Counter(names).items() if name and count > 1), None)
    if double is not None:
        raise reading.error(f"two columns are called {double[:100]!r}", "wanted each name once")
    columns = [(name, names.index(name)) for name in (*COLUMNS, BOX) if name in names]
    return [{name: "".join(line[at : at + 1]) for name, at in columns} for line in lines[1:]]


def _key(job: Job, settings: Mapping[str, Any]) -> str:
    files = [job.path(text) for text in (job.photo, job.model, job.start)]
    content: list[Any] = [[str(path), *file_stamp(path)] for path in files]
    content += [job.box] if job.box else []
    content += ["hidden"] if job.is_hidden else []
    text = json.dumps([content, settings], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_LENGTH]


def file_stamp(path: Path) -> tuple[int, int]:
    """Return size and time of a file, which differ if it changed; zeros for a missing file."""
    try:
        state = path.stat()
    except (OSError, ValueError):
        return 0, 0
    return state.st_size, state.st_mtime_ns
