"""Write figures to files, without pyplot: no window, no state shared between threads."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from poseviewer.errors import SettingsError
from poseviewer.files.writing import write_whole

DOTS_PER_INCH = 150


def save_figure(path: str | Path, figure: Figure) -> None:
    """Write a figure as .png (150 dpi), .pdf or .svg, whole or not at all.

    Raises:
        SettingsError: the format is unknown, or the folder missing or not to be written to.
    """
    path = Path(path)
    try:
        data = figure_bytes(figure, path.suffix[1:].lower() or "png")
    except ValueError as error:
        raise SettingsError(
            f"{path.name}: figures cannot be written as {path.suffix!r}; use .png, .pdf or .svg."
        ) from error
    write_whole(path, data, SettingsError)


def figure_bytes(figure: Figure, kind: str = "png") -> bytes:
    """A figure as the content of a file of that ``kind``.

    Raises:
        ValueError: the kind is unknown.
    """
    memory = BytesIO()
    FigureCanvasAgg(figure).print_figure(memory, format=kind, dpi=DOTS_PER_INCH)
    return memory.getvalue()
