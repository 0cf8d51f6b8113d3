"""Tables of rows read back as they were, also where their writer was cut off."""

from dataclasses import dataclass

import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.table import append_row, load_rows
from tests.writing import write


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    name: str
    draw: int
    error: float
    found: bool


ROWS = [
    Row(name='a, "b"', draw=1, error=0.1 + 0.2, found=True),
    Row(name="", draw=-2, error=float("inf"), found=False),
]


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "t.csv"
    for row in ROWS:
        append_row(path, row)
    return path


def test_rows_read_back_to_the_last_digit(path):
    assert load_rows(path.with_name("none.csv"), Row) == []
    assert load_rows(path, Row) == ROWS
    assert path.read_text().splitlines()[0] == "name,draw,error,found"


def test_a_row_that_was_cut_off_is_dropped(path):
    whole = path.read_bytes()
    path.write_bytes(whole[:-4])
    assert load_rows(path, Row) == ROWS[:1]
    append_row(path, ROWS[1])
    assert path.read_bytes() == whole


HEADER = "name,draw,error,found\n"


@pytest.mark.parametrize("rows", ["x,y,1.0,True\n", "x,1,1,yes\n", "x,1\n", None])
def test_another_table_is_refused_and_left_as_it_is(tmp_path, rows):
    content = "a,b\n1,2\n" if rows is None else HEADER + rows
    path = write(tmp_path / "t.csv", content)
    with pytest.raises(SettingsError, match=r"t\.csv"):
        load_rows(path, Row)
    assert path.read_text() == content
