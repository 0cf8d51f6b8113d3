"""Register a known 3D model onto one photo.

As a library (``poseviewer.api``)::

    import poseviewer

    result = poseviewer.load("photo.jpg", "car.glb", "start.json").fit()
    result.save("pose.json")

The names below are imported at their first use, so that ``import poseviewer`` alone is quick.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from poseviewer.api import (
        AutoStart,
        FitResult,
        FitSettings,
        LossMaps,
        Mask,
        PoseViewerError,
        Registration,
        Scene,
        SetChoice,
        StartCamera,
        load,
        load_frames,
    )

__version__ = "0.2.0.dev0"

__all__ = [
    "AutoStart",
    "FitResult",
    "FitSettings",
    "LossMaps",
    "Mask",
    "PoseViewerError",
    "Registration",
    "Scene",
    "SetChoice",
    "StartCamera",
    "load",
    "load_frames",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from poseviewer import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
