"""All maps of the loss in one piece of HTML, in a triangle as a corner plot.

The client's script answers presses: ``window.poseviewerPick(first, second, u, v, event)`` with the
place from the map's left and lower border, each as a share of its side, and
``window.poseviewerOpen(first, second)``. Until it is there, presses do nothing.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import combinations

import numpy as np

from poseviewer.app.page.landscape_marks import (
    Marks,
    on_map,
    short_trail,
    simplex_outline,
)
from poseviewer.app.page.landscape_style import STYLE
from poseviewer.app.page.palette import LossRange, css_gradient, loss_png, loss_range
from poseviewer.fit.landscape import Pair, Slice, slice_minimum
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.chart_names import short_name

FEWEST_COLUMNS = 4
"""Fewer maps than fill so many columns do not grow larger, and leave room for the key."""
_PICK = (
    "var r=this.getBoundingClientRect();window.poseviewerPick&&poseviewerPick({first},{second},"
    "(event.clientX-r.left)/r.width,(r.bottom-event.clientY)/r.height,event)"
)
_OPEN = "event.stopPropagation();window.poseviewerOpen&&poseviewerOpen({first},{second})"
_CROSS = "M-5-5L5 5M-5 5L5-5"


@dataclass(frozen=True, slots=True)
class GridOptions:
    """How the maps are shown."""

    parameters: tuple[int, ...] | None = None
    """Indices of the numbers whose pairs have a place, ascending; None for all."""
    shared_scale: bool = True
    """One colour for one loss over all maps; else each map has its own range, which shows faint
    basins."""
    dimmed: bool = False
    """The maps are about an older pose, while new ones are computed."""
    half_width: float = 0.2
    """How far the maps reach from their centre, as a share of each number's span."""


def landscape_grid(
    slices: Sequence[Slice], names: Sequence[str], marks: Marks, options: GridOptions
) -> str:
    """The maps, their names, the colours' meaning: 15 maps for six numbers, 21 for seven.

    Args:
        slices: at most one for each pair, in any order; unfinished ones are drawn as far as known,
            those of numbers without a place are left out, and missing ones leave an empty place.
        names: (d,) of the chart's numbers.
        marks: places in the space of the d numbers. A pose beside a map is held at its border.
        options: see there.
    """
    parameters = options.parameters if options.parameters is not None else tuple(range(len(names)))
    pieces = {(s.first, s.second): s for s in slices if not np.isnan(s.losses).all()}
    pairs = list(combinations(parameters, 2))
    known = [pieces[pair] for pair in pairs if pair in pieces]
    shared = loss_range([piece.losses for piece in known]) if options.shared_scale else None
    cells = []
    for pair in pairs:
        place = f"grid-area:{parameters.index(pair[1])}/{parameters.index(pair[0]) + 2}"
        cells.append(_cell(pieces.get(pair), pair, names, marks, shared, place))
    columns = max(len(parameters) - 1, FEWEST_COLUMNS)
    return (
        f'<div class="pv-land{" pv-dim" if options.dimmed else ""}" '
        f'style="grid-template-columns:auto repeat({columns},minmax(0,1fr))">'
        f"<style>{STYLE}</style>{_labels(parameters, names)}{''.join(cells)}"
        f"{_key(shared, marks, options)}</div>"
    )


def _labels(parameters: Sequence[int], names: Sequence[str]) -> str:
    """The second numbers left of their rows, the first ones below their columns."""
    last = len(parameters)
    labels = []
    for i, number in enumerate(parameters):
        name = short_name(names[number])
        turned = " pv-turned" if len(name) > 3 else ""
        if i > 0:
            labels.append(
                f'<span class="pv-row{turned}" style="grid-area:{i}/1">{escape(name)}</span>'
            )
        if i < last - 1:
            labels.append(
                f'<span class="pv-col" style="grid-area:{last}/{i + 2}">{escape(name)}</span>'
            )
    return "".join(labels)


def _cell(
    piece: Slice | None,
    pair: Pair,
    names: Sequence[str],
    marks: Marks,
    shared: LossRange | None,
    place: str,
) -> str:
    if piece is None:
        return f'<div class="pv-cell pv-none" style="{place}"></div>'
    scale = shared or loss_range([piece.losses]) or LossRange(0.0, 1.0)
    first, second = pair
    pick, enlarge = (escape(script.format(first=first, second=second)) for script in (_PICK, _OPEN))
    what = escape(f"{short_name(names[first])}, {short_name(names[second])}")
    return (
        f'<div class="pv-cell" style="{place}">'
        f'<svg viewBox="0 0 100 100" onpointerdown="{pick}"><title>{what}{_least(piece)}</title>'
        f"{_picture(piece, scale)}{_marks(piece, marks)}</svg>"
        f'<button type="button" title="{what}: open large" onpointerdown="{enlarge}" '
        f"onkeydown=\"if(event.key=='Enter'){{{enlarge}}}\">⤢</button></div>"
    )


def _least(piece: Slice) -> str:
    least = slice_minimum(piece)
    return f": least loss {least.loss:.4g}" if least else ""


def _picture(piece: Slice, scale: LossRange) -> str:
    """The map from its first to its last grid point: half of each border pixel is cut off."""
    data = base64.b64encode(loss_png(piece.filled(), scale)).decode()
    step = 100.0 / (len(piece.first_values) - 1)
    side, start = f"{100.0 + step:.6g}", f"{-step / 2.0:.6g}"
    return (
        f'<image href="data:image/png;base64,{data}" x="{start}" y="{start}" '
        f'width="{side}" height="{side}" preserveAspectRatio="none"/>'
    )


def _marks(piece: Slice, marks: Marks) -> str:
    """Trail, simplex, the map's own minimum and the pose, the last on top of the others."""
    drawn = []
    name = f"pv-t{piece.first}-{piece.second}"
    if marks.trail is not None and len(marks.trail) > 1:
        points = _points(on_map(piece, short_trail(marks.trail)))
        drawn.append(f'<polyline id="{name}" points="{points}"/>')
        drawn.append(f'<use href="#{name}" class="pv-trail"/>')
    if marks.simplex is not None and len(marks.simplex):
        points = _points(simplex_outline(piece, marks.simplex))
        drawn.append(f'<polygon class="pv-simplex" points="{points}"/>')
    least = slice_minimum(piece)
    if least is not None:
        parameters = np.array(marks.pose)
        parameters[[piece.first, piece.second]] = least.first_value, least.second_value
        x, y = _on_picture(on_map(piece, parameters))
        drawn.append(f'<circle class="pv-least" cx="{x:.4g}" cy="{y:.4g}" r="4"/>')
    u, v = on_map(piece, marks.pose)
    beside = "" if 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0 else " pv-beside"
    x, y = _on_picture(np.clip([u, v], 0.0, 1.0))
    drawn.append(
        f'<g class="pv-pose{beside}" transform="translate({x:.4g} {y:.4g})">'
        f'<path class="pv-halo" d="{_CROSS}"/><path d="{_CROSS}"/></g>'
    )
    return "".join(drawn)


def _on_picture(shares: FloatArray) -> FloatArray:
    """(..., 2): places from left and below as shares (..., 2), from left and above in percent."""
    shares = np.clip(shares, -10.0, 11.0)
    return np.stack([100.0 * shares[..., 0], 100.0 - 100.0 * shares[..., 1]], axis=-1)


def _points(shares: FloatArray) -> str:
    return " ".join(f"{x:.4g},{y:.4g}" for x, y in _on_picture(shares))


def _key(shared: LossRange | None, marks: Marks, options: GridOptions) -> str:
    """The colours' and the marks' meaning, in the corner that the triangle leaves free."""
    low, high = (f"{shared.low:.3f}", f"{shared.high:.3f}") if shared else ("least", "greatest")
    what = "loss" if shared or options.shared_scale else "loss, each map by itself"
    entries = [
        f'<g class="pv-pose" transform="translate(50 50)"><path class="pv-halo" d="{_CROSS}"/>'
        f'<path d="{_CROSS}"/></g>|pose',
        '<circle class="pv-least" cx="50" cy="50" r="4"/>|least of its map',
    ]
    if marks.simplex is not None:
        entries.append('<polygon class="pv-simplex" points="43,55 57,55 52,44"/>|simplex')
    if marks.trail is not None:
        entries.append('<path class="pv-trail" d="M42 54L48 48L52 52L58 45"/>|the way here')
    key = "".join(
        f'<span><svg viewBox="40 40 20 20">{drawing}</svg>{text}</span>'
        for drawing, text in (entry.split("|") for entry in entries)
    )
    return (
        f'<div class="pv-key"><div>{what}, ±{100.0 * options.half_width:.3g}&nbsp;%</div>'
        f'<div class="pv-bar" style="background:{css_gradient()}"></div>'
        f'<div class="pv-ends"><span>{low}</span><span>{high}</span></div>'
        f'<div class="pv-marks">{key}</div></div>'
    )
