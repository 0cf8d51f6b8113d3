"""``update(session, command)``: the session after a command. Pure; bad input is refused with a
sentence in ``error_message``, and nothing else changes.
"""

from __future__ import annotations

from dataclasses import fields, replace

from poseviewer.app.state.commands import Command, Release
from poseviewer.app.state.document import Document
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError, SettingsError, SingularChartError
from poseviewer.geometry.charts import OutsideChartError

LARGEST_INPUT = 1e9
"""Of px, steps and parameters: what is beyond it is a mistake, and would overflow."""
REFUSALS = (
    OutsideChartError,
    SingularChartError,
    SettingsError,
    QuickStartError,
    ArithmeticError,
)


def update(session: Session, command: Command) -> Session:
    """The session after a command; the same object where nothing changes."""
    if session.error_message and not command.keeps_error:
        session = replace(session, error_message="")
    try:
        _require_sane(command)
        ends_drag = session.drag is not None and command.ends_drag
        found = command(Release()(session) if ends_drag else session)
        _require_known_camera(found.document)
        return found
    except REFUSALS as error:
        return session.with_error(str(error))


def _require_known_camera(now: Document) -> None:
    """The cameras of a set are as the set has them.

    Raises:
        SettingsError: another one is wanted.
    """
    if now.views is not None and now.pose.camera != now.views.views.views[now.views.at].camera:
        raise SettingsError(
            "the cameras of a set are known: open this photo alone to change its camera"
        )


def _require_sane(command: Command) -> None:
    """No number of the command is nan or beyond all proportion."""
    for field in fields(command):  # pyright: ignore[reportArgumentType] - all are dataclasses
        value = getattr(command, field.name)
        if isinstance(value, int | float) and not abs(value) <= LARGEST_INPUT:
            raise SettingsError(
                f"{field.name} = {value}: wanted a number within {LARGEST_INPUT:g} of zero; "
                f"nothing was changed"
            )
