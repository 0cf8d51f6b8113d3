"""Sheets of maps: how many, of what, with which marks; and that they can be saved."""

from itertools import combinations

import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import region_reach
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


def place_of(mark):
    return np.asarray(mark.get_xydata())[0]


def limits_of(axes):
    return axes.collections[0].norm.vmin, axes.collections[0].norm.vmax


@pytest.mark.parametrize(("count", "maps"), [(2, 1), (3, 3), (6, 15), (7, 21)])
def test_every_pair_has_a_map_with_both_marks(count, maps):
    pose = np.arange(count, dtype=float)
    figure = sheet.make_landscape_sheet(make_slices(count), NAMES[:count], pose)
    assert len(maps_of(figure)) == maps
    for axes, (first, second) in zip(maps_of(figure), combinations(range(count), 2), strict=True):
        least, cross = axes.lines
        assert place_of(cross) == pytest.approx([pose[first], pose[second]])
        assert place_of(least) == pytest.approx([first + 0.05, second - 0.1])


def test_a_shared_scale_gives_one_loss_one_colour():
    slices = make_slices(3)
    bright = Slice(1, 2, slices[2].first_values, slices[2].second_values, slices[2].losses + 0.4)
    shared = sheet.make_landscape_sheet([*slices[:2], bright], NAMES[:3], np.zeros(3))
    assert len({limits_of(axes) for axes in maps_of(shared)}) == 1


@pytest.mark.parametrize("known", [0.0, 0.2])
def test_unfinished_and_constant_maps_are_drawn(known):
    slices = make_slices(3, known=known)
    axis = np.linspace(0, 1, 9)
    slices[1] = Slice(0, 2, axis, axis, np.ones((9, 9)))
    figure = sheet.make_landscape_sheet(slices, NAMES[:3], np.zeros(3))
    assert len(maps_of(figure)) == 3
    assert sheet.figure_bytes(figure)


def test_the_sheet_has_the_pages_labels_and_colours_and_what_the_search_found():
    steps = np.array([0.0, 0.9, 0.1, 0.05, 0.0])  # the maps reach to 0.2
    pose, path = np.arange(3.0), np.arange(3.0) + steps[:, None]
    covariance = np.diag([1e-4, 4e-4, np.nan])
    covariance[2] = covariance[:, 2] = np.nan
    figure = sheet.make_landscape_sheet(
        make_slices(3), NAMES[:3], pose, covariance=covariance, path=path
    )
    first, second, _ = maps_of(figure)
    assert (first.get_ylabel(), second.get_xlabel()) == ("rear wheel y", "rear wheel x")
    drawn = {line.get_label(): np.asarray(line.get_xydata()) for line in first.lines}
    np.testing.assert_allclose(drawn["search path"], path[1:, :2])
    away = (drawn["90 % region"] - pose[:2]) / [0.01, 0.02]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), region_reach(2))
    assert [line.get_label() for line in second.lines] == [
        "search path", "least of the map", "current pose",
    ]  # fmt: skip
    (legend,) = figure.legends
    said = {text.get_text() for text in legend.get_texts()}
    assert said == {"search path", "90 % region", "least of the map", "current pose"}
    bright, dark = (sum(first.collections[0].get_cmap()(share)[:3]) for share in (0.0, 1.0))
    assert bright > dark  # the lowest loss, as on the page
