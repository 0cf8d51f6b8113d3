"""The maps as a page shows them: colours where the losses say, marks where the numbers say."""

import base64
import re
from dataclasses import replace
from io import BytesIO
from itertools import combinations
from typing import Any

import numpy as np
from lxml import html
from PIL import Image

from poseviewer.app.page.controls import as_html
from poseviewer.app.page.map_panel import PALETTE, LossGrid, maps_html, on_map
from poseviewer.app.state.pose_edits import parameters_at
from poseviewer.confidence.pose_covariance import region_reach
from poseviewer.fit.slices import Slice
from tests.app.state.documents import make_session

NAMES = ("mu_x", "mu_y", "delta_x", "delta_y", "psi_x", "psi_y")
CENTRE = np.array([0.3, 0.6, -0.2, 0.1, 0.5, 0.0])


def make_slices(size: int, names: tuple[str, ...] = NAMES) -> list[Slice]:
    """Bowls about a point that lies beside the centre, differently in each number."""
    least = CENTRE + np.array([0.05, -0.1, 0.02, 0.11, -0.05, 0.15])
    found = []
    for first, second in combinations(range(len(names)), 2):
        x = CENTRE[first] + np.linspace(-0.2, 0.2, size)
        y = CENTRE[second] + np.linspace(-0.2, 0.2, size)
        losses = (x[None] - least[first]) ** 2 + 2.0 * (y[:, None] - least[second]) ** 2
        found.append(Slice(first, second, x, y, losses))
    return found


def pictures(page: str) -> list[np.ndarray]:
    """The maps' pictures, as RGB."""
    found = re.findall(r"data:image/png;base64,([A-Za-z0-9+/=]+)", page)
    return [
        np.asarray(Image.open(BytesIO(base64.b64decode(data))).convert("RGB")) for data in found
    ]


def test_every_pixel_has_the_colour_of_its_loss():
    slices = make_slices(21)
    shown = pictures(as_html(LossGrid(slices, NAMES, CENTRE).html()))
    assert len(shown) == 15
    for piece, picture in zip(slices, shown, strict=True):
        share = (piece.losses - piece.losses.min()) / np.ptp(piece.losses)
        wanted = PALETTE[np.rint(share * (len(PALETTE) - 1)).astype(int)]
        upwards = picture[::-1]  # the first row of the losses is the lowest on the page
        np.testing.assert_array_equal(upwards, wanted)


def test_a_pick_at_a_mark_gives_the_marks_numbers():
    for piece in make_slices(11):
        parameters = np.array(CENTRE)
        parameters[piece.first] += 0.137
        parameters[piece.second] -= 0.071
        u, v = on_map(piece, parameters)
        np.testing.assert_allclose(parameters_at(piece, CENTRE, (u, v)), parameters, atol=1e-12)
        beside = parameters_at(piece, CENTRE, (7.0, -3.0))  # its border is meant
        ends = piece.first_values[-1], piece.second_values[0]
        assert tuple(beside[[piece.first, piece.second]]) == ends


def test_the_page_is_small_and_says_what_it_shows():
    piece = make_slices(41)[3]
    trail = CENTRE + np.linspace(0.1, 0.0, 200)[:, None] * np.ones(6)
    candidates = CENTRE + 0.05 * np.vstack([np.zeros(6), np.eye(6)])
    slices = [replace(one, error=0.0083) for one in make_slices(41)]
    texts: Any = {"whose": "<ours> & theirs", "large": (piece.first, piece.second)}
    names = ("<img src=x>", "b&c", *NAMES[2:])
    page = as_html(LossGrid(slices, names, CENTRE, candidates, trail, **texts).html())
    assert len(page) < 80_000
    assert "<img src=x>" not in page
    tree = html.fromstring(page)
    (large,) = tree.xpath("//div[@class='pv-large']")
    assert len(tree.xpath("//svg[@data-report]")) == 15 + len(large.xpath(".//image"))
    assert f"{piece.first_values[0]:.4g} ... {piece.first_values[-1]:.4g}" in large.text_content()
    assert piece.minimum is not None
    assert f"lowest loss {piece.minimum.loss:.3f}" in large.text_content()
    (key,) = tree.xpath("//div[@class='pv-key']")
    assert "good to 0.8\xa0%" in key.text_content()
    assert key.xpath(".//b")[0].text_content() == "<ours> & theirs"


def test_maps_of_another_model_are_dimmed_until_there_are_new_ones():
    before = as_html(LossGrid(make_slices(9), NAMES, CENTRE).html())
    assert "pv-dim" not in before
    assert "pv-dim" in maps_html(make_session(), before)


def test_every_corner_of_a_simplex_is_a_dot_on_every_map():
    corners = CENTRE + 0.05 * np.vstack([np.zeros(6), np.eye(6)])
    slices = make_slices(9)
    page = html.fromstring(as_html(LossGrid(slices, NAMES, CENTRE, corners).html()))
    cells = page.xpath("//div[@class='pv-cell']")
    assert len(cells) == len(slices)
    for piece, cell in zip(slices, cells, strict=True):
        dots = cell.xpath(".//g[@class='pv-dots']/path")[-1].get("d")
        shown = np.array([place.split() for place in dots.split("M")[1:]])
        places = np.array([[float(x), float(y.removesuffix("h0"))] for x, y in shown])
        wanted = 100.0 * on_map(piece, corners)
        wanted[:, 1] = 100.0 - wanted[:, 1]
        np.testing.assert_allclose(places, wanted, atol=0.01)


def test_every_map_shows_the_region_that_the_pose_is_sure_to():
    factor = 0.01 * np.random.default_rng(0).normal(size=(6, 6))
    covariance, slices = factor @ factor.T, make_slices(9)
    page = html.fromstring(as_html(LossGrid(slices, NAMES, CENTRE, covariance=covariance).html()))
    cells = page.xpath("//div[@class='pv-cell']")
    for piece, cell in zip(slices, cells, strict=True):
        (border,) = cell.xpath(".//polygon[@class='pv-region']/@points")
        shown = np.array([place.split(",") for place in border.split()], float) / 100.0
        x, y = piece.first_values, piece.second_values
        u, v = shown[:, 0], 1.0 - shown[:, 1]
        away = np.stack([x[0] + u * (x[-1] - x[0]), y[0] + v * (y[-1] - y[0])], axis=1)
        pair = [piece.first, piece.second]
        away -= CENTRE[pair]
        inverse = np.linalg.inv(covariance[np.ix_(pair, pair)])
        reached = np.einsum("ni,ij,nj->n", away, inverse, away)
        np.testing.assert_allclose(reached, region_reach(2) ** 2, rtol=0.05)
    assert "90 % region" in page.xpath("//div[@class='pv-key']")[0].text_content()


def test_of_a_path_its_end_is_drawn_from_where_it_last_comes_onto_all_maps():
    steps = np.array([0.0, 0.1, 0.5, -0.5, 0.4, 0.1, 0.0])  # maps reach to 0.2
    slices, trail = make_slices(9), CENTRE + steps[:, None] * np.ones(6)
    tree = html.fromstring(as_html(LossGrid(slices, NAMES, CENTRE, trail=trail).html()))
    drawn = tree.xpath("//polyline[@class='pv-trail']/@points")
    assert len(drawn) == len(slices)
    for piece, points in zip(slices, drawn, strict=True):
        places = np.array([place.split(",") for place in points.split()], float)
        wanted = 100.0 * on_map(piece, trail[4:])
        wanted[:, 1] = 100.0 - wanted[:, 1]
        np.testing.assert_allclose(places, wanted, atol=0.01)
    beside = as_html(LossGrid(slices, NAMES, CENTRE, trail=trail[:4]).html())
    assert "polyline" not in beside
