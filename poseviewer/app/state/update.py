"""Update of a session by an edit: numbers are checked, a drag ends, errors become sentences."""

from poseviewer.app.state.edits import Edit
from poseviewer.app.state.pointer_edits import release
from poseviewer.app.state.session import Session
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.geometry.charts import OutsideChartError

MAX_INPUT = 1e9
"""Largest number (px, steps, parameters) that is no mistake; larger ones would overflow."""


def update(session: Session, edit: Edit) -> Session:
    """The session after an edit; the same object where nothing changes.

    Raises:
        PoseViewerError: the edit cannot be made; a sentence for the user.
    """
    for value in (*edit.arguments, *edit.named.values()):
        if isinstance(value, int | float) and not abs(value) <= MAX_INPUT:
            wanted = f"wanted one within {MAX_INPUT:g} of zero; nothing was changed."
            raise SettingsError(f"A number is {value}: {wanted}")
    try:
        return edit(session if edit.keeps_drag or session.drag is None else release()(session))
    except (PoseViewerError, OutsideChartError, ArithmeticError) as error:
        text = str(error)
        end = "" if text.endswith((".", "!", "?")) else "."
        raise SettingsError(f"{text[:1].upper()}{text[1:]}{end}") from error
