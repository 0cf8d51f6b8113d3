"""Tables that grow by a row at a time, and are taken up again where a run was cut off (CSV)."""

import csv
from dataclasses import asdict, fields
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from poseviewer.errors import SettingsError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile
from poseviewer.files.writing import append, write_whole

Row = TypeVar("Row")


def load_rows(path: Path, row_type: type[Row]) -> list[Row]:
    """Read rows of a dataclass, a line each; a last line that was cut off is dropped."""
    file = InputFile(path, [], SettingsError, "table of trials", MAX_DATA_BYTES)
    text = file.load_text() if path.exists() and path.stat().st_size else ""
    whole = text[: text.rfind("\n") + 1]
    table = csv.DictReader(StringIO(whole))
    if table.fieldnames not in (None, [field.name for field in fields(row_type)]):  # type: ignore[arg-type]
        raise file.error("is not a table of such trials", "name another folder")
    with file.naming_errors():
        rows = msgspec.convert(list(table), list[row_type], strict=False)
    if whole != text:
        write_whole(path, whole.encode(), SettingsError)
    return rows


def append_row(path: Path, row: Any) -> None:
    """Add a dataclass as a row to a table that ``load_rows`` has read.

    Raises:
        OSError: the file cannot be written.
    """
    values, text = asdict(row), StringIO()
    table = csv.DictWriter(text, values, lineterminator="\n")
    if not path.exists() or not path.stat().st_size:
        table.writeheader()
    table.writerow(values)
    append(path, text.getvalue().encode())
