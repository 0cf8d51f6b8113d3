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
    memory = BytesIO()
    try:
        kind = path.suffix[1:].lower() or "png"
        FigureCanvasAgg(figure).print_figure(memory, format=kind, dpi=DOTS_PER_INCH)
    except ValueError as error:
        raise SettingsError(
            f"{path.name}: figures cannot be written as {path.suffix!r}; use .png, .pdf or .svg."
        ) from error
    write_whole(path, memory.getvalue(), SettingsError)
