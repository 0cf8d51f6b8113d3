"""Words of the command line become values, or are refused."""

from __future__ import annotations

from argparse import ArgumentTypeError

import pytest

from poseviewer.cli.options import READERS, RECTANGLE


@pytest.mark.parametrize(
    ("shown", "text", "wanted", "refused"),
    [
        ("WIDTHxHEIGHT", "640X480", (640, 480), ("", "640", "0x4", "4x-1", "4x4x4")),
        (RECTANGLE, "1,-2,30,40", (1, -2, 30, 40), ("", "1,2,3", "1,2,3,4.5")),
        ("SECONDS", "1e-4", 1e-4, ("0", "-1", "nan", "inf", "a")),
        ("N", "7", 7, ("0", "1.5", "")),
        ("PORT", "0", 0, ("-1", "65536", "a")),
        ("SEED", "0", 0, ("-1", "1.5", "")),
        ("POINTS", "9", 9, ("8", "1", "403")),
        ("N,...", "5, 15", (5, 15), ("5,,15",)),
        ("NAME,...", "a, b,", ("a", "b"), ()),
    ],
)
def test_values_are_read_or_refused(shown, text, wanted, refused):
    assert READERS[shown](text) == wanted
    for other in refused:
        with pytest.raises(ArgumentTypeError):
            READERS[shown](other)
