"""The loss landscape at the right: all maps, and one of them large.

All maps are one piece of HTML, in a triangle as a corner plot. The looks of its classes ``pv-...``
stand in ``page.css``.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from io import BytesIO
from itertools import combinations
from operator import attrgetter

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.app.page.controls import Controls, data_url, memoize, on_press, plain
from poseviewer.app.page.handles import model_html
from poseviewer.app.page.measure_panel import add_relative, measurement_html
from poseviewer.app.page.result import result_html
from poseviewer.app.state.edits import set_fields
from poseviewer.app.state.results import Landscape
from poseviewer.app.state.session import MappedLoss, Session
from poseviewer.app.workers.maps import covariance_about, path_about
from poseviewer.confidence.pose_covariance import ellipse
from poseviewer.errors import PoseViewerError
from poseviewer.fit.slices import Pair, Slice, end_on_maps
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.charts import OutsideChartError, short_name, tooltip
from poseviewer.losses.known_losses import LOSSES

LEVELS = 128
"""Steps of colour: more cannot be told apart, and make every picture larger."""
PALETTE: NDArray[np.uint8] = cv2.applyColorMap(
    np.linspace(255, 0, LEVELS).round().astype(np.uint8)[:, None], cv2.COLORMAP_VIRIDIS
)[:, 0, ::-1].astype(np.uint8)
"""(LEVELS, 3) sRGB, the lowest loss first: viridis, safe for the colour-blind, reversed."""
MAX_TRAIL = 60
"""Points of a trail that are drawn, at most, on each map."""
MIN_COLUMNS = 4
"""Columns that the maps are sized for: fewer maps grow no larger, and leave room for the key."""
_DOTS = '<g class="pv-dots"><path class="pv-halo" d="{0}"/><path d="{0}"/></g>'
_CROSS = '<path class="pv-halo" d="M-5-5L5 5M-5 5L5-5"/><path d="M-5-5L5 5M-5 5L5-5"/>'


@dataclass(frozen=True, slots=True, eq=False)
class LossGrid:
    """Maps of a loss, and marks on them, in the space of the chart's d parameters."""

    slices: Sequence[Slice]
    """At most one for each pair of parameters, in any order, drawn as far as known."""
    names: Sequence[str]
    """(d,) of the chart's parameters."""
    pose: FloatArray
    """(d,): the current pose; beside a map it is held at the border."""
    candidates: FloatArray | None = None
    """(n, d): the points that the search compares now."""
    trail: FloatArray | None = None
    """(t, d): the poses that the search came through, the oldest first."""
    covariance: FloatArray | None = None
    """(d, d): how sure the current pose is; nan where nothing is said of a number."""
    free: tuple[int, ...] | None = None
    """Indices of the parameters whose pairs have a place, ascending; None for all."""
    dimmed: bool = False
    """The maps are about an older pose, while new ones are computed."""
    half_width: float = 0.2
    """Reach of the maps from their centre, as a share of each parameter's scale."""
    what: str = "loss"
    """Name of the values."""
    whose: str = ""
    """Name of the loss; "": none is shown."""
    large: Pair | None = None
    """The pair whose map is shown large as well."""

    def html(self) -> str:
        """The maps, their names, the colours' meaning: 15 maps for six parameters."""
        free = tuple(range(len(self.names))) if self.free is None else self.free
        pieces = {(s.first, s.second): s for s in self.slices if not np.isnan(s.losses).all()}
        cells = "".join(
            self._cell(pieces.get(pair), f"{free.index(pair[1])}/{free.index(pair[0]) + 2}")
            for pair in combinations(free, 2)
        )
        columns = max(len(free) - 1, MIN_COLUMNS)
        large = pieces.get(self.large) if self.large is not None else None
        return (
            f'<div class="pv-with">{"" if large is None else self._large(large)}'
            f'<div class="pv-land{" pv-dim" if self.dimmed else ""}" '
            f'style="grid-template-columns:1.9rem repeat({columns},minmax(0,1fr))">'
            f"{self._labels(free)}{cells}{self._key()}</div></div>"
        )

    def _labels(self, free: Sequence[int]) -> str:
        """The second parameters left of their rows, the first ones below their columns."""
        last, labels = len(free), ""
        for i, parameter in enumerate(free):
            name, hint = (escape(say(self.names[parameter])) for say in (short_name, tooltip))
            areas = {"row": f"{i}/1" if i else "", "col": f"{last}/{i + 2}" if i < last - 1 else ""}
            for kind, area in areas.items():
                style = f'class="pv-{kind}" style="grid-area:{area}" title="{hint}"'
                labels += f"<span {style}>{name}</span>" if area else ""
        return labels

    def _large(self, piece: Slice) -> str:
        """A map with its two ranges and its least value."""
        axes = (piece.first, piece.first_values), (piece.second, piece.second_values)
        x, y = (
            f"{escape(short_name(self.names[index]))} {values[0]:.4g} ... {values[-1]:.4g}"
            for index, values in axes
        )
        least = piece.minimum
        said = "" if least is None else f", lowest {escape(self.what)} {least.loss:.3f}"
        return (
            f'<div class="pv-large">{self._cell(piece)}'
            f"<div>to the right {x}, upwards {y}{said}</div></div>"
        )

    def _cell(self, piece: Slice | None, area: str = "") -> str:
        style = f'style="grid-area:{area}"' if area else ""
        if piece is None:
            return f'<div class="pv-cell pv-none" {style}></div>'
        first, second = piece.first, piece.second
        pick, enlarge = (on_press(k, first=first, second=second) for k in ("pick", "enlarge"))
        what = escape(f"{short_name(self.names[first])}, {short_name(self.names[second])}")
        least = piece.minimum
        # The map from its first to its last grid point: half of each border pixel is cut off.
        step = 100.0 / (len(piece.first_values) - 1)
        side, start = f"{100.0 + step:.6g}", f"{-step / 2.0:.6g}"
        return (
            f'<div class="pv-cell" {style}><svg viewBox="0 0 100 100" {pick}>'
            f"<title>{what}{f': lowest {least.loss:.3f}' if least else ''}</title>"
            f'<image href="{_png_url(piece)}" x="{start}" y="{start}" width="{side}" '
            f'height="{side}" preserveAspectRatio="none"/>{self._markers(piece)}</svg>'
            f'<button type="button" title="{what}: large, and back" {enlarge}>⤢</button></div>'
        )

    def _markers(self, piece: Slice) -> str:
        """Trail, candidates, the map's own minimum and the pose, the last on top of the others."""
        drawn = ""
        end = None if self.trail is None else end_on_maps(self.slices, self.trail)
        if end is not None and len(end) > 1:
            count = len(end)
            kept = np.linspace(0, count - 1, min(count, MAX_TRAIL)).round().astype(int)
            points = _points(piece, end[kept])
            drawn += f'<polyline points="{points}"/><polyline class="pv-trail" points="{points}"/>'
        if self.candidates is not None and len(self.candidates):
            places = _on_picture(piece, self.candidates)
            within = places[np.all(np.abs(places - 50.0) <= 55.0, axis=1)]
            drawn += _DOTS.format("".join(f"M{x:.4g} {y:.4g}h0" for x, y in within))
        least, pair = piece.minimum, [piece.first, piece.second]
        if least is not None:
            parameters = np.array(self.pose)
            parameters[pair] = least.first_value, least.second_value
            x, y = _on_picture(piece, parameters)
            drawn += f'<circle class="pv-least" cx="{x:.4g}" cy="{y:.4g}" r="4"/>'
        covariance = None if self.covariance is None else self.covariance[np.ix_(pair, pair)]
        if covariance is not None and not np.isnan(covariance[0, 1]):
            region = ellipse(covariance)
            border = np.tile(self.pose, (len(region), 1))
            border[:, pair] += region
            drawn += f'<polygon class="pv-region" points="{_points(piece, border)}"/>'
        point = _on_picture(piece, self.pose)
        x, y = held = np.clip(point, 0.0, 100.0)
        beside = "" if np.array_equal(held, point) else " pv-beside"
        at = f'transform="translate({x:.4g} {y:.4g})"'
        return f'{drawn}<g class="pv-pose{beside}" {at}>{_CROSS}</g>'

    def _key(self) -> str:
        """The colours' and the markers' meaning, in the corner that the triangle leaves free."""
        what = f"{escape(self.what)}, each map by itself, ±{100.0 * self.half_width:.3g}&nbsp;%"
        error = max((piece.error or 0.0 for piece in self.slices), default=0.0)
        if error:
            what += f", good to {100.0 * error:.1g}&nbsp;%"
        whose = f"<b>{escape(self.whose)}</b><br>" if self.whose else ""
        entries = {
            "pose": f'<g class="pv-pose" transform="translate(50 50)">{_CROSS}</g>',
            "lowest": '<circle class="pv-least" cx="50" cy="50" r="4"/>',
        }
        if self.candidates is not None:
            entries["candidates"] = _DOTS.format("M43 55h0M57 55h0M52 44h0")
        if self.covariance is not None:
            entries["90 % region"] = '<ellipse class="pv-region" cx="50" cy="50" rx="8" ry="4"/>'
        if self.trail is not None:
            entries["search path"] = '<path class="pv-trail" d="M42 54L48 48L52 52L58 45"/>'
        key = "".join(
            f'<span><svg viewBox="40 40 20 20">{drawing}</svg>{text}</span>'
            for text, drawing in entries.items()
        )
        return (
            f'<div class="pv-key"><div>{whose}{what}</div>'
            '<div class="pv-bar"></div>'
            '<div class="pv-ends"><span>lowest</span><span>highest</span></div>'
            f'<div class="pv-marks">{key}</div></div>'
        )


def on_map(piece: Slice, parameters: FloatArray) -> FloatArray:
    """(..., 2): places of parameters (..., d) on a map, in shares from left and below."""
    parameters = np.asarray(parameters, dtype=float)
    x, y = piece.first_values, piece.second_values
    u = (parameters[..., piece.first] - x[0]) / (x[-1] - x[0])
    v = (parameters[..., piece.second] - y[0]) / (y[-1] - y[0])
    return np.stack([u, v], axis=-1)


def _png_url(piece: Slice) -> str:
    """URL of an 8-bit palette PNG of a map, the last row at the top, over the known losses."""
    known = piece.losses[np.isfinite(piece.losses)]
    low, high = known.min(), known.max()
    shares = np.clip((piece.fill_gaps() - low) / max(high - low, 1e-12), 0.0, 1.0)
    image = Image.fromarray((shares * (LEVELS - 1)).round().astype(np.uint8)[::-1])
    image.putpalette(PALETTE.tobytes())
    memory = BytesIO()
    image.save(memory, "PNG", bits=8, compress_level=9)
    return data_url("png", memory.getvalue())


def _on_picture(piece: Slice, parameters: FloatArray) -> FloatArray:
    """(..., 2): where parameters (..., d) lie on a map, from left and above in percent."""
    shares = np.clip(on_map(piece, parameters), -10.0, 11.0)
    return np.stack([100.0 * shares[..., 0], 100.0 - 100.0 * shares[..., 1]], axis=-1)


def _points(piece: Slice, parameters: FloatArray) -> str:
    return " ".join(f"{x:.4g},{y:.4g}" for x, y in _on_picture(piece, parameters))


def add_maps(controls: Controls) -> None:
    """The panel: the pose in numbers, the maps, or why there are none, and what they show."""
    gui = controls.gui
    alone = lambda s: (s.results.alone, s.shows_model, s.document.marks)  # noqa: E731
    controls.html(memoize(alone, model_html))
    controls.html(measurement_html)
    controls.html(result_html)
    add_relative(controls)
    maps = gui.add_html("")

    def maps_key(session: Session) -> tuple[object, ...]:
        landscapes, pose = session.results.landscapes, session.document.pose
        return landscapes, pose, session.own_progress, session.display.large_map

    controls.add(maps, content=memoize(maps_key, lambda s: maps_html(s, maps.content)))
    waiting = "Drawing the maps ..."
    controls.text(lambda s: plain(s.results.maps_note) or ("" if maps.content else waiting))
    labels = {name: loss.label for name, loss in LOSSES.items()}
    choices: dict[MappedLoss, str] = {"chosen": "selected loss", **labels, "all": "all"}
    mapped = attrgetter("display.mapped_loss")
    controls.dropdown(
        "Loss of", choices, lambda loss: set_fields("display", mapped_loss=loss), mapped
    )
    controls.field(
        gui.add_slider("Range ± %", 1.0, 50.0, 1.0, 20.0),
        lambda value: set_fields("display", half_width=value / 100.0),
        value=lambda s: s.display.half_width * 100.0,
    )
    with gui.add_folder("Save the maps", expand_by_default=False):
        controls.download("Sheet (PNG)", "sheet")
        controls.download("Numbers (NPZ)", "maps-npz")


def maps_html(session: Session, before: str) -> str:
    """The maps; until there are any for this photo and model those ``before``, dimmed."""
    if not session.results.landscapes:
        return before.replace('"pv-land"', '"pv-land pv-dim"')
    grids = "".join(grid_of(session, latest).html() for latest in session.results.landscapes)
    return f'<div class="pv-both">{grids}</div>'


def grid_of(session: Session, latest: Landscape) -> LossGrid:
    """The maps of a loss with the pose, and the search where it searches in the maps' chart."""
    problem, document = latest.problem, session.document
    pose = np.array(latest.parameters)
    covariance, trail = covariance_about(latest, session), path_about(latest, session)
    search = session.own_progress
    is_followed = trail is not None and search is not None and session.is_searching
    candidates = search.progress.candidates if is_followed and search else None
    with suppress(PoseViewerError, OutsideChartError):
        pose = document.params_in(problem)
    is_moving = session.is_searching or session.drag is not None
    return LossGrid(
        [piece.as_shown(problem.scale) for piece in latest.slices],
        problem.chart.names,
        pose,
        candidates,
        trail,
        covariance,
        free=tuple(int(i) for i in problem.free_indices),
        dimmed=latest.document.pose is not document.pose and not is_moving,
        half_width=latest.half_width,
        what=problem.scale.name,
        whose=problem.settings.loss_name,
        large=session.display.large_map,
    )
