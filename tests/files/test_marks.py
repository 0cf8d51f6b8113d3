"""Point pairs and wheels are read; mistakes are one sentence."""

import math
from pathlib import Path

import pytest

from poseviewer.errors import QuickStartError
from poseviewer.files.marks import load_pairs, wheels_from_text
from tests.writing import write

WRITTEN = {
    "two rows": "1.5,2,3,10,20\n1.5, 2 ,3,10,20\n",
    "a header": "x,y,z,u,v\n1.5,2,3,10,20\n",
    "a comment and a blank line": "# clicked\n\n1.5,2,3,10,20\n",
    "semicolons": "1.5;2;3;10;20\n",
    "tabs": "x\ty\tz\tu\tv\n1.5\t2\t3\t10\t20\n",
    "semicolons and decimal commas": "\ufeffx;y;z;u;v\r\n1,5;2;3;10;20,0\r\n",
    "quoted decimal commas": '"1,5",2,3,10,20\n',
    "spaces": "1.5 2  3 10 20\n",
    "another order": "u,v,z,y,x\n10,20,3,2,1.5\n",
    "capitals, quotes and other columns": '"ID","X","Y","Z","U","V"\n7,1.5,2,3,10,20\n',
    "a comment with marks": "# x; y\t z\nv,u,x,y,z\n20,10,1.5,2,3\n",
    "tabs and decimal commas without a header": "1,5\t2\t3\t10\t20\n",
}


@pytest.mark.parametrize("way", WRITTEN)
def test_pairs_may_be_written_in_many_ways_and_are_shifted_by_half_a_pixel(tmp_path: Path, way):
    pairs = load_pairs(write(tmp_path / "pairs.txt", WRITTEN[way]))
    count = 2 if way == "two rows" else 1
    assert pairs.points.tolist() == [[1.5, 2.0, 3.0]] * count
    assert pairs.pixels.tolist() == [[10.5, 20.5]] * count


@pytest.mark.parametrize(("text", "words"), [
    ("1,2,3,4\n", "line 1 has 4 values"),
    ("1,2,3,4,5\n1,2,3,x,5\n", "line 2: u is 'x'"),
    ("1,2,3,4,nan\n", "v is nan"),
    (b"\xff\xfe\x00\x01", "not a text"),
    (b'"' + b"1" * 200_000 + b'",2,3,4,5', "not a readable list of marks"),
    ("1e308,2,3,4,5\n", r"x is 1e\+308"),
    ("id,x,y,z,u,v\n1,2,3,4,5\n", "line 2 has 5 values; wanted 6"),
    (None, "no such file"),
])  # fmt: skip
def test_broken_pairs_are_told_by_file_and_place(tmp_path: Path, text, words: str):
    path = tmp_path / "pairs.csv"
    if text is not None:
        write(path, text)
    with pytest.raises(QuickStartError, match=rf"pairs\.csv.*{words}"):
        load_pairs(path)


def test_wheels_are_read_from_text():
    wheel = wheels_from_text("740,432,50,34,90; 401,477,61,50,0").rear
    assert (wheel.cx, wheel.cy, wheel.a, wheel.b) == (740.5, 432.5, 50.0, 34.0)
    assert wheel.angle == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(("text", "words"), [
    ("1,2,3,4,5;", "1 ellipses; wanted two"),
    ("1,2,3,4,5;1,2,3,4", "front wheel has 4 values"),
    ("1,2,3,4,5;1,2,3,x,5", "front wheel: b is 'x'"),
    ("1,2,3,-4,5;1,2,3,4,5", "must be above 0"),
    ("1,2,300,1,5;1,2,3,4,5", "edge-on"),
])  # fmt: skip
def test_broken_wheels_are_told(text: str, words: str):
    with pytest.raises(QuickStartError, match=words):
        wheels_from_text(text)
