"""Cameras of still scenes against known ones: ``python -m tests.measure.still [NAME ...]``.

A row per film and way. ``rbt`` is a real film of a table with a rolling shutter; its truth holds
near the objects, not at the board of markers, which is twice as far. ``room`` and ``markers`` are
drawn by a seed: three models on a table, 60 frames of 640x480 px on an arc.

Both worlds are laid onto one another by the means of all frames: what is left are degrees, and % of
the distance to what is looked at. A scale that is not known is fitted.
"""

import argparse
import csv
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from assets.source.data_folder import DATA
from poseviewer.figures.text_table import Table
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import save_image
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform, nearest_rotation, rotation_angle
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.still.still_cameras import StillCameras, find_cameras
from tests.meshes import make_bumpy, make_printed
from tests.still_scene import MARKER, MARKERS, arc, draw, in_order, room

RBT = DATA / "films" / "rbt"
RBT_MARKER = 0.0955
"""Side of its markers, m."""
RBT_DISTANCE = 0.5
"""Distance to the objects, m."""
LARGE = Perspective(640.0, 640.0, 320.0, 240.0, 640, 480)
HEAD = (
    "film", "by", "camera", "placed", "residual px", "focal px", "scale", "deg median", "deg worst",
    "% median", "% worst", "s",
)  # fmt: skip
"""Columns; scale: the true one over the one found."""


def true_motions() -> list[RigidTransform]:
    """Poses of the world, which is the first frame's, in the frames of ``rbt``."""
    names = [f"m{row}{column}" for row in range(3) for column in range(4)]
    with (RBT / "motion.csv").open() as file:
        rows = [[float(row[name]) for name in names] for row in csv.DictReader(file)]
    return [RigidTransform.from_matrix(np.reshape(row, (3, 4))) for row in rows]


def draw_room(folder: Path, count: int, with_markers: bool) -> list[RigidTransform]:
    """Write pictures of three models on the table; return the cameras."""
    cameras = arc(count)
    placed = [
        (load_mesh(demo_case().model), 0.09, (-0.17, 0.05, 0.0)),
        (make_printed(), 0.1, (0.16, 0.1, 0.05)),
        (make_bumpy(), 0.06, (0.02, -0.12, 0.06)),
    ]
    renderers = [SoftwareRenderer(scaled(mesh, size, place)) for mesh, size, place in placed]
    for index, place in enumerate(cameras):
        solids = [room(), *(in_order(place, MARKERS) if with_markers else ())]
        picture = draw(solids, place, LARGE, index)
        pose = Pose(LARGE, place)
        order = sorted(renderers, key=lambda one: -float(place.apply(one.mesh.centre)[2]))
        for renderer in order:
            image = renderer.render(pose)
            shade = 0.5 + 0.5 * np.abs(image.normals @ np.array([0.3, 0.6, 0.74]))
            lit = np.clip(255.0 * image.reflectance * shade[..., None], 0.0, 255.0)
            picture[image.mask] = lit[image.mask].astype(np.uint8)
        save_image(folder / f"{index:04d}.png", picture)
    return cameras


def scaled(mesh: Mesh, size: float, place: Sequence[float]) -> Mesh:
    """Return a model of a size, m, in its longest half side, with its middle's foot at a place."""
    half = float(np.ptp(mesh.bounds, axis=0).max()) / 2.0
    moved = (mesh.vertices - mesh.centre) * (size / half)
    return replace(mesh, vertices=moved + np.array(place))


def last(steps: Iterator[str | StillCameras], verbose: bool) -> StillCameras:
    """Return the cameras, the last step."""
    for step in steps:
        if isinstance(step, StillCameras):
            return step
        if verbose:
            print(step)
    raise AssertionError


def compare(
    found: StillCameras, true: dict[str, RigidTransform], distance: float
) -> tuple[float, NDArray, NDArray]:
    """Return the true scale over the one found, degrees (n,) and % (n,)."""
    mine = [view.camera_from_world for view in found.views]
    theirs = [true[view.name] for view in found.views]
    turns = [b.rotation.T @ a.rotation for a, b in zip(mine, theirs, strict=True)]
    turn = nearest_rotation(np.mean(turns, axis=0))
    degrees = np.degrees([rotation_angle(one, turn) for one in turns])
    a = np.array([one.inverse().translation for one in mine]) @ turn.T
    b = np.array([one.inverse().translation for one in theirs])
    a, b = (one - one.mean(axis=0) for one in (a, b))
    scale = float(np.sum(a * b) / np.sum(a * a))
    used = 1.0 if found.is_scale_known else scale
    return scale, degrees, 100.0 * np.linalg.norm(used * a - b, axis=1) / distance


def measure(name: str, by: str, is_calibrated: bool, count: int, verbose: bool) -> tuple[str, ...]:
    """Find the cameras of a film and return a row of the table."""
    is_real = name == "rbt"
    size = (RBT_MARKER if is_real else MARKER) if by == "markers" else None
    with tempfile.TemporaryDirectory() as folder:
        if is_real:
            paths = sorted((RBT / "frames").glob("*.jpg"))
            true, distance = true_motions(), RBT_DISTANCE
            camera = load_calibration(Calibration(RBT / "camera.yml"), "", 640, 480)[0].camera
        else:
            true = draw_room(Path(folder), count, name == "markers")
            paths, distance, camera = sorted(Path(folder).glob("*.png")), 1.0, LARGE
        began = time.perf_counter()
        known = camera if is_calibrated else None
        steps = find_cameras(paths, by, camera=known, marker_size=size, unit=size and "m")  # pyright: ignore[reportArgumentType]
        found = last(steps, verbose)
        seconds = time.perf_counter() - began
    for line in found.lines:
        print(name, by, line)
    by_name = {path.name: place for path, place in zip(paths, true, strict=True)}
    scale, degrees, percents = compare(found, by_name, distance)
    residual = float(np.median([*(found.residual_px or {}).values()]))
    focal = found.views[0].camera.fx  # pyright: ignore[reportAttributeAccessIssue]
    return (
        name, by, "known" if is_calibrated else "found", f"{len(found.views)} of {len(paths)}",
        f"{residual:.2f}", f"{focal:.1f} of {camera.fx:.1f}", f"{scale:.4f}",
        *(f"{one:.3f}" for one in (np.median(degrees), degrees.max())),
        *(f"{one:.3f}" for one in (np.median(percents), percents.max())), f"{seconds:.0f}",
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=["rbt", "room", "markers"])
    parser.add_argument("--by", nargs="*", default=["features", "markers"])
    parser.add_argument("--frames", type=int, default=60, help="of the drawn films")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args(arguments)
    rows = [
        measure(name, by, is_calibrated, options.frames, options.verbose)
        for name in options.names
        for by in options.by
        if name != "room" or by == "features"
        for is_calibrated in (False, True)
    ]
    print(Table("Cameras of still scenes", HEAD, tuple(rows)).as_markdown())


if __name__ == "__main__":
    main()
