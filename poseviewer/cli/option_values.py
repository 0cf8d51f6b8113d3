"""Values of options, read from their words; a wrong one is refused in a few words.

Each raises ``argparse.ArgumentTypeError``, which argparse prints with the option's name.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from poseviewer.geometry.rectangle import Rectangle


def positive(text: str) -> float:
    """A finite number above 0."""
    value = _number(text, float, "a number above 0")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0")
    return value


def whole(text: str) -> int:
    """A whole number above 0."""
    value = int(_number(text, int, "a whole number above 0"))
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number above 0")
    return value


def whole_from_zero(text: str) -> int:
    """A whole number, 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a number, 0 or more")
    return int(text)


def port(text: str) -> int:
    """A port of this machine; 0 for any free one."""
    value = int(_number(text, int, "a port, from 0 to 65535"))
    if not 0 <= value <= 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port, from 0 to 65535")
    return value


def map_size(text: str) -> int:
    """Points a side of a map of the loss."""
    value = int(_number(text, int, "an odd number from 3 to 401"))
    if not 3 <= value <= 401 or value % 2 == 0:
        raise argparse.ArgumentTypeError(f"{text} is not an odd number from 3 to 401")
    return value


def size(text: str) -> tuple[int, int]:
    """Width and height in px, ``1920x1080``."""
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() and int(side) > 0 for side in sides):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size, such as 1920x1080")
    return int(sides[0]), int(sides[1])


def rectangle(text: str) -> Rectangle:
    """``left,top,width,height`` in px of the photo."""
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not four whole numbers, left,top,width,height"
        ) from None
    return Rectangle(left, top, width, height)


def listed(kind: Callable[[str], Any]) -> Callable[[str], tuple[Any, ...]]:
    """Several values, with commas between them."""
    return lambda text: tuple(kind(part.strip()) for part in text.split(","))


def _number(text: str, kind: type[int] | type[float], wanted: str) -> float:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not {wanted}") from None
