"""What a command must not bring about, and how it is said."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document
from poseviewer.app.state.motions import radius_in_photo
from poseviewer.errors import SettingsError

LARGEST_INPUT = 1e9
"""Of px, steps and numbers: what is beyond it is a mistake, and would overflow."""


def require_sane(command: c.Command) -> None:
    """No number of the command is nan or beyond all proportion.

    Raises:
        SettingsError: one is.
    """
    for field in fields(command):
        value = getattr(command, field.name)
        if isinstance(value, int | float) and not abs(value) <= LARGEST_INPUT:
            raise SettingsError(
                f"{field.name} = {value}: wanted a number within {LARGEST_INPUT:g} of zero; "
                f"nothing was changed"
            )


def require_in_sight(document: Document) -> None:
    """The model is in front of the camera, and neither infinitely large nor infinitely far.

    Raises:
        FloatingPointError: it is not.
    """
    pose = document.pose
    radius = radius_in_photo(pose, document.registration.mesh)
    if not (0.0 < radius < math.inf and np.isfinite(pose.camera_from_model.translation).all()):
        raise FloatingPointError(
            "that pose is behind the camera or out of all proportion; nothing was changed"
        )


def sentence(text: str) -> str:
    """With a capital letter first and a full stop last."""
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."
