"""Sheets of maps: how many, of what, with which marks; and that they can be saved."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from poseviewer.figures import landscape_sheet as sheet
from poseviewer.fit.slices import Slice

NAMES = ("mu_x", "mu_y", "delta_x", "delta_y", "psi_x", "psi_y", "width_per_focal")


def make_slices(count: int, known: float = 1.0) -> list[Slice]:
    random, axis = np.random.default_rng(0), np.linspace(-0.2, 0.2, 9)
    x, y = np.meshgrid(axis, axis)
    pieces = []
    for first, second in combinations(range(count), 2):
        losses = 0.3 + (x - 0.05) ** 2 + 0.5 * (y + 0.1) ** 2
        losses[random.uniform(size=losses.shape) > known] = np.nan
        pieces.append(Slice(first, second, axis + first, axis + second, losses))
    return pieces


def maps_of(figure):
    """The axes that have a map, without the colour bar."""
    return [axes for axes in figure.axes if axes.lines]


def _place(mark):
    return np.asarray(mark.get_xydata())[0]


def _limits(axes):
    return axes.collections[0].norm.vmin, axes.collections[0].norm.vmax


@pytest.mark.parametrize(("count", "maps"), [(2, 1), (3, 3), (6, 15), (7, 21)])
def test_every_pair_has_a_map_with_both_marks(count, maps):
    pose = np.arange(count, dtype=float)
    figure = sheet.make_landscape_sheet(make_slices(count), NAMES[:count], pose)
    assert len(maps_of(figure)) == maps
    for axes, (first, second) in zip(maps_of(figure), combinations(range(count), 2), strict=True):
        least, cross = axes.lines
        assert _place(cross) == pytest.approx([pose[first], pose[second]])
        assert _place(least) == pytest.approx([first + 0.05, second - 0.1])


def test_a_shared_scale_gives_one_loss_one_colour():
    slices = make_slices(3)
    bright = Slice(1, 2, slices[2].first_values, slices[2].second_values, slices[2].losses + 0.4)
    shared = sheet.make_landscape_sheet([*slices[:2], bright], NAMES[:3], np.zeros(3))
    assert len({_limits(axes) for axes in maps_of(shared)}) == 1


def test_maps_side_by_side_have_their_own_scales_and_marks():
    piece, pose = make_slices(2)[0], np.array([0.0, 1.0])
    steep = Slice(0, 1, piece.first_values, piece.second_values, 3.0 * piece.losses)
    figure = sheet.make_landscape_row({"flat": (piece, pose), "steep": (steep, pose)}, NAMES, 0.1)
    flat, steeper = maps_of(figure)
    assert (flat.get_title(), steeper.get_title()) == ("flat", "steep")
    assert _limits(steeper) == pytest.approx(3.0 * np.array(_limits(flat)))
    (box,) = flat.patches
    assert isinstance(box, Rectangle)
    assert box.get_bbox().extents == pytest.approx([0.0, 0.9, 0.0, 1.1])
    marks = np.array([_place(mark) for mark in flat.lines])
    assert marks == pytest.approx(np.array([[0.05, 0.9], pose]))


@pytest.mark.parametrize("known", [0.0, 0.2])
def test_unfinished_and_constant_maps_are_drawn(known):
    slices = make_slices(3, known=known)
    axis = np.linspace(0, 1, 9)
    slices[1] = Slice(0, 2, axis, axis, np.ones((9, 9)))
    figure = sheet.make_landscape_sheet(slices, NAMES[:3], np.zeros(3))
    assert len(maps_of(figure)) == 3
    assert sheet.figure_bytes(figure)
