"""Where the panels lie on a page, and its theme: each page has its own, by its script's report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import viser

from poseviewer.app.below_viser.client_script import Placement, place_panel

PANEL_WIDTHS, MAPS_WIDTHS = (300, 260), (420, 300)
"""CSS px: at the left, and of maps beside the photo; in a wide and in a small window."""
WIDE_WINDOW = 1280
"""CSS px: in a window less wide the panels leave room to the photo."""
MARGIN = 6
"""CSS px about maps that lie below the photo."""
LARGEST_WINDOW = 16_384
"""CSS px: more is no window."""
PLACES = (
    '<div class="pv-places"><b>Loss landscape</b> &nbsp;'
    + " ".join(
        f'<button type="button" data-place="{place}" onclick="poseviewer.placeMaps(\'{place}\')">'
        f"{place}</button>"
        for place in ("beside", "below", "away")
    )
    + "</div>"
)
"""The buttons that place the maps; the page remembers the choice."""


def choose_theme(gui: viser.GuiApi, light: bool = False) -> None:
    """Dark, or as the browser prefers light ones."""
    gui.configure_theme(
        dark_mode=not light, show_logo=False, show_share_button=False, brand_color=(23, 162, 184)
    )


def arrange(client: viser.ClientHandle, maps: viser.PanelHandle, report: Mapping[str, Any]) -> None:
    """Place the panels on one page as its script asks; a report that makes no sense is dropped."""
    try:
        width, height = (int(report[name]) for name in ("width", "height"))
    except (KeyError, OverflowError, TypeError, ValueError):
        return
    if not (0 < width <= LARGEST_WINDOW and 0 < height <= LARGEST_WINDOW):
        return
    small = width < WIDE_WINDOW
    choose_theme(client.gui, report.get("light") is True)
    left: Any = {"kind": "edge", "edge": "left"}
    place_panel(client, client.gui.main_panel, Placement(left, PANEL_WIDTHS[small]))
    place = Placement({"kind": "edge", "edge": "right"}, MAPS_WIDTHS[small])
    if report.get("maps") == "below":
        free = width - PANEL_WIDTHS[small] - 2 * MARGIN
        place = Placement({"kind": "float", "x": MARGIN, "y": -MARGIN}, free, height)
    elif report.get("maps") == "away":
        place = replace(place, collapsed=True)
    if report.get("only") == "width":
        place = replace(place, position=None)
    place_panel(client, maps, place)
