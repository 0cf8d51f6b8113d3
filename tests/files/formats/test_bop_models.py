"""Files of a BOP data set that cannot be read are said in a line."""

from pathlib import Path

import pytest

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.bop_models import RESULTS, load_bop_estimates, load_bop_models
from tests.writing import write

HALF_TURN = [-1, 0, 0, 2, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
"""About the axis through (1, 0, 0) along z."""


@pytest.mark.parametrize(("more", "said"), [
    ({"symmetries_discrete": [[*HALF_TURN[:-8], 2, *HALF_TURN[-7:]]]}, "no rotation and shift"),
    ({"symmetries_discrete": [HALF_TURN[:9]]}, "wanted a list of length >= 16"),
    ({"symmetries_continuous": [{"axis": [0, 0, 0], "offset": [0, 0, 0]}]}, "has no length"),
    ({"diameter": -1}, "1.diameter is -1"),
    ({"symmetries_discrete": 3}, "wanted a list"),
    ({"symmetries_discrete": [HALF_TURN, [*HALF_TURN[:3], 3, *HALF_TURN[4:]]]},
     "leave no common point"),
])  # fmt: skip
def test_symmetries_that_are_none_are_said(tmp_path: Path, more, said: str) -> None:
    path = write(tmp_path / "i.json", {"1": {"diameter": 4.0, **more}})
    with pytest.raises(PoseFileError, match=said):
        load_bop_models(path)


@pytest.mark.parametrize(("text", "said"), [
    ("a,b\n", "its head is 'a,b'"),
    (",".join(RESULTS) + "\n1,2,3,0.5,1 0 0,0 0 0,-1\n", "wanted 9 numbers"),
    (",".join(RESULTS) + "\n1,2,3\n", "line 2 has 3 cells"),
    (",".join(RESULTS) + "\n1,x,3,0.5,1 0 0 0 1 0 0 0 1,0 0 0,-1\n", "wanted a number"),
])  # fmt: skip
def test_tables_that_are_none_are_said(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(PoseFileError, match=said):
        load_bop_estimates(write(tmp_path / "t.csv", text))
