"""What tests that need Blender have in common."""

from __future__ import annotations

import pytest

from poseviewer.errors import RendererUnavailableError
from poseviewer.evaluation.cycles.photographer import blender_version


def require_blender() -> None:
    """Skip where no Python with ``bpy`` is known, saying so."""
    try:
        blender_version()
    except RendererUnavailableError as error:
        pytest.skip(str(error))
