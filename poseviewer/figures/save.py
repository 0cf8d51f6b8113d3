"""Write figures to files, without pyplot: no window, no state shared between threads."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from poseviewer.errors import SettingsError
from poseviewer.files.writing import write_whole

DOTS_PER_INCH = 150
KINDS = (".png", ".pdf", ".svg")


def check_kind(path: str | Path) -> None:
    """See whether a figure can be written to a file of this name, before it is made.

    Raises:
        SettingsError: the format is unknown.
    """
    path = Path(path)
    if path.suffix.lower() not in ("", *KINDS):
        raise SettingsError(
            f"{path.name}: figures cannot be written as {path.suffix!r}; use .png, .pdf or .svg."
        )


def save_figure(path: str | Path, figure: Figure) -> None:
    """Write a figure as .png (150 dpi), .pdf or .svg, whole or not at all."""
    check_kind(path)
    kind = Path(path).suffix[1:].lower() or "png"
    write_whole(Path(path), figure_bytes(figure, kind), SettingsError)


def figure_bytes(figure: Figure, kind: str = "png") -> bytes:
    """A figure as the content of a file of that ``kind``.

    Raises:
        ValueError: the kind is unknown.
    """
    memory = BytesIO()
    FigureCanvasAgg(figure).print_figure(memory, format=kind, dpi=DOTS_PER_INCH)
    return memory.getvalue()
