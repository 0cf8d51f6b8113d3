"""On which machine, and with which versions, a figure was measured."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from poseviewer.render.opengl.context import opengl_renderer_name
from poseviewer.render.pool import processors

PACKAGES = ("poseviewer", "numpy", "numba", "scipy", "pyrender")


def machine() -> dict[str, str | int | float | None]:
    """The processor, its cores, the system, and how busy it was (mean over the last minute)."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {"cpu": _cpu_model(), "cores": processors(), "system": platform.system(), "load": load}


def versions() -> dict[str, str | None]:
    """Of Python and the packages that do the work; ``opengl`` is None where there is none."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    found |= {name: version(name) for name in PACKAGES}
    return found | {"opengl": opengl_renderer_name()}


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
