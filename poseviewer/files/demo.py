"""Find the bundled demo: in the package, or in the source tree it was made in."""

from dataclasses import dataclass
from pathlib import Path

from poseviewer.errors import PoseFileError

PLACES = (Path(__file__).parents[1] / "demo_files", Path(__file__).parents[2] / "assets")


@dataclass(frozen=True, slots=True)
class DemoCase:
    """One bundled photo with a true pose and a start."""

    photo: Path
    model: Path
    start: Path
    truth: Path


def demo_case(projection: str = "perspective") -> DemoCase:
    """The demo photographed in ``perspective``, or (nearly) in ``parallel`` projection."""
    name = "" if projection == "perspective" else "_parallel"
    folder = next((place for place in PLACES if place.is_dir()), PLACES[0])
    photo = folder / f"demo_photo{name}.jpg"
    if not photo.exists():
        raise PoseFileError(f"{photo.name}: the bundled demo is not there; install poseviewer anew")
    start, truth = (folder / f"demo{name}_pose_{kind}.json" for kind in ("start", "true"))
    return DemoCase(photo, folder / "demo_car.glb", start, truth)
