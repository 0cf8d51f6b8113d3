"""Skip tests where the machine has no OpenGL or GPU; a CI machine must have both."""

import os
from collections.abc import Callable

import pytest

from poseviewer.errors import RendererUnavailableError
from poseviewer.render.gpu.device import ADAPTER_VARIABLE, gpu_device
from poseviewer.render.opengl import opengl


def require_opengl() -> None:
    _require(opengl)


def require_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mesa's lavapipe will do, which is none (Debian: mesa-vulkan-drivers)."""
    monkeypatch.setenv(ADAPTER_VARIABLE, "software")
    _require(gpu_device)


def _require(make: Callable[[], object]) -> None:
    try:
        make()
    except RendererUnavailableError as error:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(str(error))
