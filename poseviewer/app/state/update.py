"""``update(session, command)``: the session after a command. Pure; bad input is refused with a
sentence in ``error_message``, and nothing else changes.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from poseviewer.app.state.camera_change import with_camera
from poseviewer.app.state.commands import UNLOCK, Command, Release
from poseviewer.app.state.document import Document, label_of
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
        before = session
        if session.drag is not None and command.ends_drag:
            before = Release()(session)
        found = command(before)
        if not command.goes_back:
            _require_unlocked(before.document, found.document)
        _require_known_cameras(before.document, found.document)
        return found
    except REFUSALS as error:
        return session.with_error(str(error))


def _require_unlocked(before: Document, now: Document) -> None:
    """An object that is locked is where it was in the photo; under another camera, too.

    Raises:
        SettingsError: it is not.
    """
    is_same = before.shows_same(now) and before.pose is not now.pose
    if not (is_same and before.object.locked and now.object.locked):
        return
    kept = with_camera(before.pose, now.pose.camera, now.mesh.centre)
    ways = (pose.camera_from_model for pose in (kept, now.pose))
    (rotation, place), (its_rotation, its_place) = ((w.rotation, w.translation) for w in ways)
    if not (np.allclose(rotation, its_rotation) and np.allclose(place, its_place)):
        label = label_of(now.object)
        raise SettingsError(f"{label} is locked: {UNLOCK} to move it; nothing was changed")


def _require_known_cameras(before: Document, now: Document) -> None:
    """The cameras of several views stay as they are.

    Raises:
        SettingsError: another one is wanted.
    """
    old, new = ([(v.photo, v.camera) for v in one.scene.views] for one in (before, now))
    same_photos = [photo for photo, _ in old] == [photo for photo, _ in new]
    if len(old) > 1 and same_photos and old != new:
        raise SettingsError(
            "the cameras of several photos are known: open this photo alone to change its camera"
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
