"""Words of the command line become values, or are refused."""

from __future__ import annotations

from argparse import ArgumentTypeError

import pytest

from poseviewer.cli import options as values


@pytest.mark.parametrize(
    ("read", "text", "wanted"),
    [
        (values.size, "1920x1080", (1920, 1080)),
        (values.size, "640X480", (640, 480)),
        (values.rectangle, "1,-2,30,40", (1, -2, 30, 40)),
        (values.positive, "1e-4", 1e-4),
        (values.whole, "7", 7),
        (values.port, "0", 0),
        (values.map_size, "9", 9),
        (values.listed(values.whole), "5, 15", (5, 15)),
        (values.names, "a, b,", ("a", "b")),
    ],
)
def test_values_are_read(read, text, wanted):
    assert read(text) == wanted


@pytest.mark.parametrize(
    ("read", "texts"),
    [
        (values.size, ("", "640", "0x4", "4x-1", "4x4x4")),
        (values.rectangle, ("", "1,2,3", "1,2,3,4.5")),
        (values.positive, ("0", "-1", "nan", "inf", "a")),
        (values.whole, ("0", "1.5", "")),
        (values.port, ("-1", "65536", "a")),
        (values.seed, ("-1", "1.5", "")),
        (values.map_size, ("8", "1", "403")),
    ],
)
def test_others_are_refused(read, texts):
    for text in texts:
        with pytest.raises(ArgumentTypeError):
            read(text)
