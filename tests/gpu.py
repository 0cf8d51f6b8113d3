"""What tests that need a GPU have in common: Mesa's lavapipe will do, which is none."""

from __future__ import annotations

import os

import pytest

from poseviewer.errors import RendererUnavailableError
from poseviewer.render.gpu.device import ADAPTER_VARIABLE, gpu_device


def gpu_unavailable_reason() -> str | None:
    """Why there is no GPU here, in a sentence, or None."""
    try:
        gpu_device()
    except RendererUnavailableError as error:
        return str(error)
    return None


def require_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let software adapters do; skip where there is not even one, but fail on a CI machine."""
    monkeypatch.setenv(ADAPTER_VARIABLE, "software")
    reason = gpu_unavailable_reason()
    if reason and os.environ.get("CI"):
        pytest.fail(reason)
    if reason:
        pytest.skip(f"{reason} Debian: mesa-vulkan-drivers")
