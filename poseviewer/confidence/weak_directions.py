"""Directions in which a pose can move without the photo minding, in words."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from poseviewer.fit.probing import Probe
from poseviewer.fit.verdict import WeakDirection
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel

STEP = 0.06
"""Of the differences that curvature is taken from: 3 % of the model's size at its rim."""
REACHES = (0.1, 0.2, 0.4)
"""How far along a direction it is tried whether the photo minds."""
MINDS = 0.15
"""The photo minds from this share of what a wrong pose typically costs more."""
NAMED = 0.35
"""A part of a motion is named from this share of the greatest part on."""


def curvature(probe: Probe, place: FloatArray, centre: float) -> FloatArray:
    """(k, k): directions, a row each, the least curved first, by the second derivatives of the
    loss at a ``place`` (k,), where it is ``centre``.
    """
    size = len(place)
    axes = STEP * np.eye(size)
    pairs = list(combinations(range(size), 2))
    ways = np.array([*axes, *(axes[i] + axes[j] for i, j in pairs)])
    # (w,): the losses on both sides together.
    both = probe.losses([*(place + ways), *(place - ways)]).reshape(2, -1).sum(axis=0)
    hessian = np.diag((both[:size] - 2.0 * centre) / STEP**2)
    for (i, j), mixed in zip(pairs, both[size:], strict=True):
        bend = mixed - both[i] - both[j] + 2.0 * centre
        hessian[i, j] = hessian[j, i] = bend / (2.0 * STEP**2)
    if not np.all(np.isfinite(hessian)):
        return np.eye(size)
    return np.linalg.eigh(hessian)[1].T


def weak_directions(
    probe: Probe, place: FloatArray, directions: FloatArray, contrast: float
) -> tuple[WeakDirection, ...]:
    """Those of the ``directions`` (k, k) along which the loss stays what it is at a ``place`` (k,)
    for the first of the reaches at least; ``contrast`` is what a typical wrong pose costs more.
    """
    found = []
    most = float(probe.losses([place])[0]) + MINDS * contrast
    for direction in directions:
        reach = _reach(probe, place, direction, most)
        if reach > 0.0:
            found.append(_in_words(probe, direction @ probe.motions, reach))
    return tuple(found)


def _reach(probe: Probe, place: FloatArray, direction: FloatArray, most: float) -> float:
    """How far the pose can go to both sides for less than ``most``; 0 if not to the first reach."""
    reach = 0.0
    for wanted in REACHES:
        way = wanted * direction
        if np.any(probe.losses([place + way, place - way]) > most):
            break
        reach = wanted
    return reach


def _in_words(probe: Probe, motion: FloatArray, reach: float) -> WeakDirection:
    """The parts of a unit motion (d,) that matter, each with how far it can go."""
    turn, shift, depth = motion[:3], motion[3:5], abs(float(motion[5]))
    focal = abs(float(motion[6])) if len(motion) > 6 else 0.0
    sizes = {
        "focal": focal,
        "turn": float(np.linalg.norm(turn)),
        "shift": float(np.linalg.norm(shift)),
        "depth": depth,
    }
    greatest = max(sizes.values())
    named = [name for name, size in sizes.items() if size >= NAMED * greatest]
    degrees = math.degrees(reach * sizes["turn"]) if "turn" in named else 0.0
    percents, words = [], []
    for name in named:
        if name == "turn":
            words.append(f"turning {_axis(turn)} by {degrees:.0f}°")
        else:
            percent = _percent(probe, name, reach * sizes[name])
            percents.append(percent)
            words.append(f"{_NOUNS[name](probe)} by {percent:.0f} %")
    return WeakDirection(
        " with ".join(words), degrees, max(percents, default=0.0), tuple(float(x) for x in motion)
    )


_NOUNS = {
    "focal": lambda _: "changing the focal length",
    "shift": lambda _: "shifting in the picture",
    "depth": lambda probe: (
        "changing the scale"
        if isinstance(probe.chart.start.camera, Parallel)
        else "changing the distance"
    ),
}


def _percent(probe: Probe, name: str, way: float) -> float:
    """Of the model's size (two radii) for a shift; else of the number itself."""
    if name == "shift":
        return 50.0 * way
    if name == "focal":
        way *= probe.chart.focal_gain
    return 100.0 * (math.exp(min(way, 5.0)) - 1.0)


def _axis(turn: FloatArray) -> str:
    """An axis (3,) of the camera frame in words."""
    share = np.abs(turn) / np.linalg.norm(turn)
    names = ("the picture's horizontal", "the picture's vertical", "the line of sight")
    nearest = int(np.argmax(share))
    if share[nearest] > 0.9:
        return f"about {names[nearest]}"
    if nearest == 2 or share[2] > 0.5:
        return f"about a slanted axis near {names[nearest]}"
    return "about an axis in the picture's plane"
