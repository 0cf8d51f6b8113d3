"""Where the bundled demo lies: in the package, or in the source tree it was made in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from poseviewer.errors import PoseFileError

_IN_PACKAGE = Path(__file__).parents[1] / "demo_files"
_IN_SOURCE = Path(__file__).parents[2] / "assets"


@dataclass(frozen=True, slots=True)
class DemoCase:
    """One bundled photo with a true pose and a start."""

    photo: Path
    model: Path
    start: Path
    truth: Path


def _case(name: str) -> DemoCase:
    folder = _IN_PACKAGE if _IN_PACKAGE.is_dir() else _IN_SOURCE
    photo = folder / f"demo_photo{name}.jpg"
    if not photo.exists():
        raise PoseFileError(f"{photo.name}: the bundled demo is not there; install poseviewer anew")
    return DemoCase(
        photo,
        folder / "demo_car.glb",
        folder / f"demo{name}_pose_start.json",
        folder / f"demo{name}_pose_true.json",
    )


def demo_case(projection: str = "perspective") -> DemoCase:
    """The demo photographed in ``perspective``, or (nearly) in ``parallel`` projection."""
    return _case("" if projection == "perspective" else "_parallel")
