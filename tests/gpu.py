"""What tests that need a GPU have in common: Mesa's lavapipe will do, which is none."""

from __future__ import annotations

import os

import pytest

from poseviewer.render.gpu.device import ADAPTER_VARIABLE, gpu_unavailable_reason


def require_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let software adapters do; skip where there is not even one, but fail on a CI machine."""
    monkeypatch.setenv(ADAPTER_VARIABLE, "software")
    reason = gpu_unavailable_reason()
    if reason and os.environ.get("CI"):
        pytest.fail(reason)
    if reason:
        pytest.skip(f"{reason} Debian: mesa-vulkan-drivers")
