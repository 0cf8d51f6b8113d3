"""Cameras of still scenes against known ones: ``python -m tests.measure.still [NAME ...]``.

A row per film and way. ``rbt`` is a real film of a table with a rolling shutter; its truth holds
near the objects, not at the board of markers, which is twice as far. ``room`` and ``markers`` are
drawn by a seed: three models on a table, 60 frames of 640x480 px on an arc.

Both worlds are laid onto one another by the means of all frames: what is left are degrees, and % of
the distance to what is looked at. A scale that is not known is fitted.

``--objects`` goes on with the cameras that are not known before: each object is placed once, 5
degrees and 5 % of its size off in the middle frame (``rbt``: by the keys of the first), and looked
for in all frames, beside those that were found before it. A row per object: mean distances of its
vertices in each frame from the truth there, in % of the diagonal of its box.
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
from poseviewer.files.pose import load_pose
from poseviewer.fit.search import Search
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform, nearest_rotation, rotation_angle
from poseviewer.opening.scenes import scale_of_views
from poseviewer.render.pool import processors
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.types import SceneObject
from poseviewer.still.still_cameras import StillCameras, find_cameras
from tests.meshes import make_bumpy, make_printed
from tests.still_scene import MARKER, MARKERS, arc, draw, in_order, room

RBT = DATA / "films" / "rbt"
RBT_MARKER = 0.0955
"""Side of its markers, m."""
RBT_DISTANCE = 0.5
"""Distance to the objects, m."""
CONTRAST = 0.3
"""Of table and wall: the things on it stand out, as they mostly do."""
OFF_DEG, OFF_SHARE = 5.0, 0.05
"""How far off drawn objects start: about what a hand does; the share is of its size."""
LARGE = Perspective(640.0, 640.0, 320.0, 240.0, 640, 480)
OBJECTS_HEAD = (
    "film", "by", "object", "verdict", "frames", "found alone", "median %", "largest %", "scale",
    "s",
)  # fmt: skip
"""Columns; scale: the model's, over the true one."""
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


def models() -> dict[str, Mesh]:
    """Three models where they stand on the table."""
    placed = {
        "car": (load_mesh(demo_case().model), 0.09, (-0.17, 0.05, 0.0)),
        "box": (make_printed(), 0.1, (0.16, 0.1, 0.05)),
        "bumpy": (make_bumpy(), 0.06, (0.02, -0.12, 0.06)),
    }
    return {name: scaled(*about) for name, about in placed.items()}


def draw_room(folder: Path, count: int, with_markers: bool) -> list[RigidTransform]:
    """Write pictures of three models on the table; return the cameras."""
    cameras, renderers = arc(count), [SoftwareRenderer(mesh) for mesh in models().values()]
    for index, place in enumerate(cameras):
        solids = [room(contrast=CONTRAST), *(in_order(place, MARKERS) if with_markers else ())]
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


def starts(name: str, true: Sequence[RigidTransform]) -> dict[str, tuple[Mesh, int, Pose, Pose]]:
    """Model, frame, pose there and true pose of each object of a film."""
    if name == "rbt":
        camera = load_calibration(Calibration(RBT / "camera.yml"), "", 640, 480)[0].camera
        known = {}
        for key in ("dragon", "cube"):
            pose = load_pose(RBT / f"key_{key}.json").pose
            at_first = Pose(camera, true[0].inverse() @ pose.camera_from_model)
            known[key] = load_mesh(RBT / f"{key}.obj"), 0, pose, at_first
        return known
    middle, known = len(true) // 2, {}
    for key, mesh in models().items():
        size = float(np.ptp(mesh.bounds, axis=0).max())
        off = RigidTransform.from_rotation_vector(
            np.radians(OFF_DEG) * np.array([0.6, -0.64, 0.48]), np.zeros(3)
        )
        centre = mesh.centre + OFF_SHARE * size * np.array([0.6, 0.64, -0.48])
        moved = replace(off, translation=centre - off.apply(mesh.centre))
        at = Pose(LARGE, true[middle] @ moved)
        known[key] = mesh, middle, at, Pose(LARGE, RigidTransform(np.eye(3), np.zeros(3)))
    return known


def place_all(
    name: str, cameras: StillCameras, true: dict[str, RigidTransform]
) -> Iterator[tuple[str, ...]]:
    """Place each object once, search for it in all frames, and yield its row of the table."""
    scene, sure = cameras.scene, list[Mesh]()
    ordered = [true[view.name] for view in cameras.views]
    for key, (mesh, index, start, world_pose) in starts(name, ordered).items():
        view = scene.views[index]
        start = replace(start, camera=view.camera)
        scale = scene.objects[0].world_from_model.scale if scene.objects else 1.0
        if scene.free_scale:
            scale = 1.0 / scale_of_views(scene.views, index, mesh, start, name)
        item = SceneObject(
            id=key, model=ModelFile.of(mesh, name=key),
            world_from_model=view.world_from_model(start, scale),
        )  # fmt: skip
        scene = replace(scene, objects=(*scene.objects, item))
        sure.append(mesh)
        renderers = {at: SoftwareRenderer(one) for at, one in enumerate(sure)}
        began, at = time.perf_counter(), len(sure) - 1
        *_, now = Search(scene, renderers, [at], processors(), index).run()
        seconds, scene = time.perf_counter() - began, replace(now.scene, free_scale=False)
        result, errors = scene.objects[at].result, []
        assert result is not None
        assert result.verdict is not None
        for number, own in enumerate(scene.views):
            truth = true[own.name] @ world_pose.camera_from_model
            there = Pose(world_pose.camera, truth)
            shown, symmetry = scene.pose(at, number), scene.objects[at].symmetry
            errors.append(pose_error(mesh, shown, there, symmetry).percent)
        alone = sum(one.label == "found" for one in result.verdict.views)
        for note in result.notes:
            print(name, key, note)
        long = scene.objects[at].world_from_model.scale * compare(cameras, true, 1.0)[0]
        yield (
            name, cameras.by, key, f"{result.verdict.label} {result.verdict.probability:.2f}",
            f"{len(errors)}", f"{alone}", f"{np.median(errors):.2f}", f"{max(errors):.2f}",
            f"{long:.4f}", f"{seconds:.0f}",
        )  # fmt: skip


def measure(
    name: str, by: str, is_calibrated: bool, count: int, options: argparse.Namespace
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Find the cameras of a film and return a row of the table, and those of its objects."""
    is_real = name == "rbt"
    has_size = by == "markers" or options.sized
    size = (RBT_MARKER if is_real else MARKER) if has_size else None
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
        found = last(steps, options.verbose)
        seconds = time.perf_counter() - began
        for line in found.lines:
            print(name, by, line)
        by_name = {path.name: place for path, place in zip(paths, true, strict=True)}
        objects = list[tuple[str, ...]]()
        if options.objects:
            for row in place_all(name, found, by_name):
                print(*row)
                objects.append(row)
    scale, degrees, percents = compare(found, by_name, distance)
    residual = float(np.median([*(found.residual_px or {}).values()]))
    focal = found.views[0].camera.fx  # pyright: ignore[reportAttributeAccessIssue]
    row = (
        name, by, "known" if is_calibrated else "found", f"{len(found.views)} of {len(paths)}",
        f"{residual:.2f}", f"{focal:.1f} of {camera.fx:.1f}", f"{scale:.4f}",
        *(f"{one:.3f}" for one in (np.median(degrees), degrees.max())),
        *(f"{one:.3f}" for one in (np.median(percents), percents.max())), f"{seconds:.0f}",
    )  # fmt: skip
    return row, objects


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=["rbt", "room", "markers"])
    parser.add_argument("--by", nargs="*", default=["features", "markers"])
    parser.add_argument("--frames", type=int, default=60, help="of the drawn films")
    parser.add_argument("--sized", action="store_true", help="markers' side by features, too")
    parser.add_argument("--objects", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args(arguments)
    rows = [
        measure(name, by, is_calibrated, options.frames, options)
        for name in options.names
        for by in options.by
        if name != "room" or by == "features"
        for is_calibrated in ((False,) if options.objects else (False, True))
    ]
    print(Table("Cameras of still scenes", HEAD, tuple(row for row, _ in rows)).as_markdown())
    if options.objects:
        objects = tuple(one for _, own in rows for one in own)
        print(Table("Objects of still scenes", OBJECTS_HEAD, objects).as_markdown())


if __name__ == "__main__":
    main()
