"""Tables that grow by a row at a time, and are taken up again where a run was cut off (CSV)."""

from __future__ import annotations

import csv
from dataclasses import asdict, fields
from io import StringIO
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from poseviewer.errors import SettingsError
from poseviewer.files.checks import Reading
from poseviewer.files.writing import write_whole

Row = TypeVar("Row")
LARGEST = 1_000_000_000
"""Bytes."""


class RowTable(Generic[Row]):
    """Rows of a dataclass of texts, numbers and truth values, a line each."""

    def __init__(self, path: Path, row_type: type[Row]) -> None:
        """Read what is there; a last line that was cut off is dropped."""
        self._path, self._type = path, row_type
        self.columns = [field.name for field in fields(row_type)]  # type: ignore[arg-type]
        reading = Reading(path, error_type=SettingsError, kind="table of trials", largest=LARGEST)
        text = reading.load_text() if path.exists() and path.stat().st_size else ""
        whole = text[: text.rfind("\n") + 1]
        self.rows: list[Row] = self._parse(whole) if whole else []
        if whole != text or not whole:
            write_whole(path, (whole or self._line(self.columns)).encode(), SettingsError)

    def append(self, row: Row) -> None:
        """Add a row, here and in the file."""
        values = asdict(row)  # type: ignore[call-overload]
        line = self._line([values[name] for name in self.columns])
        try:
            with self._path.open("a", encoding="utf-8", newline="") as file:
                file.write(line)
        except OSError as error:
            raise SettingsError(
                f"{self._path}: cannot be written to ({error.strerror}); free the place and run "
                "the same again"
            ) from None
        self.rows.append(row)

    def _line(self, values: list[Any]) -> str:
        memory = StringIO()
        csv.writer(memory, lineterminator="\n").writerow(values)
        return memory.getvalue()

    def _parse(self, text: str) -> list[Row]:
        reader = csv.DictReader(StringIO(text))
        if reader.fieldnames != self.columns:
            raise SettingsError(
                f"{self._path}: is not a table of such trials; name another folder, or take it away"
            )
        try:
            return msgspec.convert(list(reader), list[self._type], strict=False)
        except msgspec.ValidationError as error:
            raise SettingsError(
                f"{self._path}: holds a row that cannot be read ({error}); mend it, or name "
                "another folder"
            ) from None
