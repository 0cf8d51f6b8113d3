"""What tests that need OpenGL have in common."""

from __future__ import annotations

import os

import pytest

from poseviewer.render.opengl import opengl_unavailable_reason


def require_opengl() -> None:
    """Skip where the machine has no OpenGL; fail if it is a CI machine, which must have it."""
    reason = opengl_unavailable_reason()
    if reason and os.environ.get("CI"):
        pytest.fail(reason)
    if reason:
        pytest.skip(reason)
