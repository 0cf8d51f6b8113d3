"""The ``distortion`` block of pose files: which undistorted photo their camera belongs to."""

from __future__ import annotations

from typing import Any

from poseviewer.files.checks import Reading, kind_of
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel, Undistortion

NOTE = (
    "The pose, its camera and its chart belong to the undistorted photo, not to the photo as taken."
)
INTRINSICS = ("fx", "fy", "cx", "cy")
MODELS: dict[str, LensModel] = {"opencv": "opencv", "opencv-fisheye": "fisheye"}
"""What the file calls a lens model."""


def distortion_as_json(undistortion: Undistortion) -> dict[str, Any]:
    """All that is needed to make the undistorted photo of the one as taken."""
    lens = undistortion.lens
    return {
        "note": NOTE,
        "model": next(name for name, model in MODELS.items() if model == lens.model),
        "coefficients": [float(value) for value in lens.coefficients],
        "camera_as_taken": intrinsics_as_json(undistortion.taken),
        "camera_undistorted": intrinsics_as_json(undistortion.camera),
    }


def distortion_from_json(reading: Reading, value: Any, width: int, height: int) -> Undistortion:
    """What a block says, for a photo of ``width`` x ``height`` px; raises the reading's error."""
    value = reading.object(value, "distortion")
    name = value.get("model")
    if not isinstance(name, str) or name not in MODELS:
        wanted = " or ".join(repr(model) for model in MODELS)
        raise reading.error(f"distortion.model is {kind_of(name)}", f"wanted {wanted}")
    model, coefficients = MODELS[name], value.get("coefficients")
    if not isinstance(coefficients, list) or len(coefficients) not in COEFFICIENTS[model]:
        wanted = ", ".join(str(count) for count in COEFFICIENTS[model])
        found = f"distortion.coefficients is {kind_of(coefficients)}"
        raise reading.error(found, f"wanted a list of {wanted} numbers")
    numbers = reading.numbers(coefficients, "distortion.coefficients", len(coefficients))
    cameras = (
        intrinsics_from_json(reading, value.get(key), f"distortion.{key}", width, height)
        for key in ("camera_as_taken", "camera_undistorted")
    )
    return Undistortion(Lens(model, tuple(numbers)), *cameras)


def intrinsics_as_json(camera: Perspective) -> dict[str, float]:
    """fx, fy, cx, cy in px, pixel centres at integers."""
    shifted = camera_as_integer_centres(camera)
    return {name: float(getattr(shifted, name)) for name in INTRINSICS}


def intrinsics_from_json(
    reading: Reading, value: Any, what: str, width: int, height: int
) -> Perspective:
    """The camera, pixel centres at i + 0.5, of an object with fx, fy, cx, cy; raises the reading's
    error.
    """
    value = reading.object(value, what)
    cx, cy = (reading.number(value.get(n), f"{what}.{n}") for n in INTRINSICS[2:])
    fx, fy = (reading.number(value.get(n), f"{what}.{n}", positive=True) for n in INTRINSICS[:2])
    return camera_from_integer_centres(Perspective(fx, fy, cx, cy, width, height))
