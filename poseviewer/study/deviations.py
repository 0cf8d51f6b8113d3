"""Starts beside the truth: how far, and by which reading of "per cent off"."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from poseviewer.errors import SingularChartError
from poseviewer.geometry.arrays import FloatArray

Reading = Literal["relative", "absolute"]
"""``relative``: each number is off by up to a share of its own value, as in the paper.
``absolute``: by up to that share of its span, which is harder for numbers near 0."""
READINGS: tuple[Reading, ...] = get_args(Reading)

TRIES = 1000


def draw_start(
    parameters: FloatArray,
    scales: FloatArray,
    reading: Reading,
    share: float,
    seed: int,
    is_pose: Callable[[FloatArray], bool],
) -> FloatArray:
    """(d,): ``numbers`` (d,), each off by a uniform draw within +- ``share``; the same for the
    same seed. ``spans`` (d,) are the chart's 100 %. Draws that are no pose are drawn again.

    Raises:
        SingularChartError: there is none in a thousand draws.
    """
    random = np.random.default_rng(seed)
    size = np.abs(parameters) if reading == "relative" else scales
    for _ in range(TRIES):
        start = parameters + share * size * random.uniform(-1.0, 1.0, len(parameters))
        if is_pose(start):
            return start
    raise SingularChartError(
        f"none of {TRIES} starts up to {share:.0%} off is a pose of the vehicle chart; "
        "choose smaller --deviations"
    )


def make_seed(*what: object) -> int:
    """A number for what is drawn: the same for the same words, on every machine."""
    return zlib.crc32("/".join(str(part) for part in what).encode())
