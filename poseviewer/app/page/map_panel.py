"""The loss landscape at the right: all maps, and one of them large.

All maps are one element, in a triangle as a corner plot. The looks of its classes ``pv-...``
stand in ``page.css``.
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from itertools import combinations
from operator import attrgetter

import cv2
import htpy as h
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.app.page.controls import Controls, as_html, data_url, memoize, on_press, plain
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
MAP_SAYS = (
    "{}: how well the photo is explained as these two change, one to the right, the other upwards. "
    "The cross is the pose; yellow is better. A press moves the pose there."
)
NO_MAPS = '<div class="pv-both"></div>'
"""Place of the maps, by which a page tells whether it shows them."""
MAX_TRAIL = 60
"""Points of a trail that are drawn, at most, on each map."""
MIN_COLUMNS = 4
"""Columns that the maps are sized for: fewer maps grow no larger, and leave room for the key."""


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

    def html(self) -> h.Element:
        """The maps, their names, the colours' meaning: 15 maps for six parameters."""
        free = tuple(range(len(self.names))) if self.free is None else self.free
        pieces = {(s.first, s.second): s for s in self.slices if not np.isnan(s.losses).all()}
        cells = [
            self._cell(pieces.get(pair), f"{free.index(pair[1])}/{free.index(pair[0]) + 2}")
            for pair in combinations(free, 2)
        ]
        columns = max(len(free) - 1, MIN_COLUMNS)
        widths = f"var(--pv-names,1.9rem) repeat({columns},minmax(0,1fr))"
        large = pieces.get(self.large) if self.large is not None else None
        return h.div(".pv-with")[
            None if large is None else self._large(large),
            h.div(
                class_=["pv-land", {"pv-dim": self.dimmed}],
                style=f"grid-template-columns:{widths}",
            )[self._labels(free), cells, self._key()],
        ]

    def _labels(self, free: Sequence[int]) -> h.Node:
        """The second parameters left of their rows, the first ones below their columns."""
        last, labels = len(free), list[h.Element]()
        for i, parameter in enumerate(free):
            name, hint = (say(self.names[parameter]) for say in (short_name, tooltip))
            if i:
                labels.append(h.span(".pv-row", style=f"grid-area:{i}/1", title=hint)[name])
            if i < last - 1:
                area = f"grid-area:{last}/{i + 2}"
                labels.append(h.span(".pv-col", style=area, title=hint)[name])
        return labels

    def _large(self, piece: Slice) -> h.Element:
        """A map with its two ranges and its least value."""
        axes = (piece.first, piece.first_values), (piece.second, piece.second_values)
        x, y = (
            f"{short_name(self.names[index])} {values[0]:.4g} ... {values[-1]:.4g}"
            for index, values in axes
        )
        least = piece.minimum
        said = "" if least is None else f", lowest {self.what} {least.loss:.3f}"
        text = f"to the right {x}, upwards {y}{said}"
        return h.div(".pv-large")[self._cell(piece), h.div[text]]

    def _cell(self, piece: Slice | None, area: str = "") -> h.Element:
        style = f"grid-area:{area}" if area else None
        if piece is None:
            return h.div(".pv-cell.pv-none", style=style)
        first, second = piece.first, piece.second
        pick, enlarge = (on_press(k, first=first, second=second) for k in ("pick", "enlarge"))
        what = f"{short_name(self.names[first])}, {short_name(self.names[second])}"
        large = f"{what}: large, and back"
        least = piece.minimum
        # The map from its first to its last grid point: half of each border pixel is cut off.
        step = 100.0 / (len(piece.first_values) - 1)
        side, start = f"{100.0 + step:.6g}", f"{-step / 2.0:.6g}"
        place = {"x": start, "y": start, "width": side, "height": side}
        return h.div(".pv-cell", style=style)[
            h.svg(pick, viewBox="0 0 100 100", data_map=self._numbers(piece))[
                h.title[MAP_SAYS.format(what), least and f" Lowest: {least.loss:.3f}."],
                h.image(place, href=_png_url(piece), preserveAspectRatio="none"),
                self._markers(piece),
            ],
            h.button(enlarge, type="button", title=large, aria_label=large)["⤢"],
        ]

    def _numbers(self, piece: Slice) -> str:
        """Numbers of a map by which the page's script says those under the pointer (JSON)."""
        axes = (piece.first, piece.first_values), (piece.second, piece.second_values)
        known = piece.losses[np.isfinite(piece.losses)]
        numbers = {
            "axes": [[short_name(self.names[i]), float(v[0]), float(v[-1])] for i, v in axes],
            "low": float(known.min()),
            "high": float(known.max()),
            "what": self.what,
            "side": len(piece.first_values),
        }
        return json.dumps(numbers)

    def _markers(self, piece: Slice) -> h.Node:
        """Trail, candidates, the map's own minimum and the pose, the last on top of the others."""
        drawn = list[h.Element]()
        end = None if self.trail is None else end_on_maps(self.slices, self.trail)
        if end is not None and len(end) > 1:
            count = len(end)
            kept = np.linspace(0, count - 1, min(count, MAX_TRAIL)).round().astype(int)
            points = _points(piece, end[kept])
            drawn += h.polyline(points=points), h.polyline(".pv-trail", points=points)
        if self.candidates is not None and len(self.candidates):
            places = _on_picture(piece, self.candidates)
            within = places[np.all(np.abs(places - 50.0) <= 55.0, axis=1)]
            drawn.append(_dots("".join(f"M{x:.4g} {y:.4g}h0" for x, y in within)))
        least, pair = piece.minimum, [piece.first, piece.second]
        if least is not None:
            parameters = np.array(self.pose)
            parameters[pair] = least.first_value, least.second_value
            x, y = _on_picture(piece, parameters)
            drawn.append(_least(x, y))
        covariance = None if self.covariance is None else self.covariance[np.ix_(pair, pair)]
        if covariance is not None and not np.isnan(covariance[0, 1]):
            region = ellipse(covariance)
            border = np.tile(self.pose, (len(region), 1))
            border[:, pair] += region
            drawn.append(h.polygon(".pv-region", points=_points(piece, border)))
        point = _on_picture(piece, self.pose)
        x, y = held = np.clip(point, 0.0, 100.0)
        return drawn, _cross(x, y, is_beside=not np.array_equal(held, point))

    def _key(self) -> h.Element:
        """The colours' and the markers' meaning, in the corner that the triangle leaves free."""
        what = f"{self.what}, each map by itself, ±{100.0 * self.half_width:.3g}\xa0%"
        error = max((piece.error or 0.0 for piece in self.slices), default=0.0)
        if error:
            what += f", good to {100.0 * error:.1g}\xa0%"
        entries = {"pose": _cross(50, 50), "lowest": _least(50, 50)}
        if self.candidates is not None:
            entries["candidates"] = _dots("M43 55h0M57 55h0M52 44h0")
        if self.covariance is not None:
            entries["90 % region"] = h.ellipse(".pv-region", cx="50", cy="50", rx="8", ry="4")
        if self.trail is not None:
            entries["search path"] = h.path(".pv-trail", d="M42 54L48 48L52 52L58 45")
        box = h.svg(viewBox="40 40 20 20")
        return h.div(".pv-key")[
            h.div[self.whose and (h.b[self.whose], h.br), what],
            h.div(".pv-bar"),
            h.div(".pv-ends")[h.span["lowest"], h.span["highest"]],
            h.div(".pv-marks")[[h.span[box[drawn], text] for text, drawn in entries.items()]],
        ]


def _with_halo(path: str) -> h.Node:
    return h.path(".pv-halo", d=path), h.path(d=path)


def _dots(path: str) -> h.Element:
    return h.g(".pv-dots")[_with_halo(path)]


def _least(x: float, y: float) -> h.Element:
    return h.circle(".pv-least", cx=f"{x:.4g}", cy=f"{y:.4g}", r="4")


def _cross(x: float, y: float, is_beside: bool = False) -> h.Element:
    """The pose, at the border if it lies beside the map."""
    names, at = ["pv-pose", {"pv-beside": is_beside}], f"translate({x:.4g} {y:.4g})"
    return h.g(class_=names, transform=at)[_with_halo("M-5-5L5 5M-5 5L5-5")]


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
    has_maps = lambda: "pv-land" in maps.content  # noqa: E731
    controls.text(lambda s: plain(s.results.maps_note) or ("" if has_maps() else waiting))
    labels = {name: loss.label for name, loss in LOSSES.items()}
    choices: dict[MappedLoss, str] = {"chosen": "the one of the search", **labels, "all": "all"}
    mapped = attrgetter("display.mapped_loss")
    controls.dropdown(
        "Maps of", choices, lambda loss: set_fields("display", mapped_loss=loss), mapped
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
        return before.replace('"pv-land"', '"pv-land pv-dim"') or NO_MAPS
    grids = [grid_of(session, latest).html() for latest in session.results.landscapes]
    return as_html(h.div(".pv-both")[grids])


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
