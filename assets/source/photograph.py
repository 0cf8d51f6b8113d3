"""Photograph the demo car in its street: Blender Cycles, then a little camera physics in numpy.

    python photograph.py near|far [--draft]
    python photograph.py round FOLDER
    python photograph.py table FOLDER MODEL.ply [MODEL.ply ...]

Needs Blender as a Python module (`bpy` 4.5), trimesh and Pillow. Reads `demo_car.glb`, writes
`demo_photo.jpg` / `demo_photo_parallel.jpg` and the true pose beside it. World frame = car frame.
`round` writes photos from around the car and `views.json`, a set of photos for `--views` with exact
cameras, whose frame is the car's; `table` photos from around the models (in mm, with texture or
colours) on a table, and for each a set `MODEL.views.json` in its frame: what
`tests.measure.view_sets` measures on. Photos that are in the folder stay.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import blender_car
import bpy
import nodes
import numpy as np
import poses
import street
import tabletop
import trimesh
from mathutils import Vector
from PIL import Image
from solids import rounded_block

ASSETS = Path(__file__).resolve().parent.parent
SENSOR_MM = 36.0


@dataclass(frozen=True)
class Shot:
    """A photo: camera at azimuth (deg from +y towards +x), distance and height aimed at a point."""

    photo: str
    true_pose: str
    azimuth: float
    distance: float
    height: float
    aim: tuple[float, float, float]
    lens_mm: float
    sun_azimuth: float
    sun_height: float
    sun_watts: float
    sky: float
    haze: float
    exposure: float
    size: tuple[int, int] = (960, 720)
    seed: int = 1
    f_stop: float = 5.6
    nearer: float = 0.8
    """By how much the lens is focused nearer than the point."""


SHOTS = {
    "near": Shot(
        "demo_photo.jpg",
        "demo_pose_true.json",
        37.0,
        8.1,
        1.58,
        (0.05, 0.0, 0.78),
        50.0,
        sun_azimuth=67.0,
        sun_height=47.0,
        sun_watts=4.2,
        sky=0.15,
        haze=1.2,
        exposure=1.5,
    ),
    "far": Shot(
        "demo_photo_parallel.jpg",
        "demo_parallel_pose_true.json",
        -38.0,
        120.0,
        16.0,
        (-0.05, 0.0, 0.72),
        730.0,
        sun_azimuth=-62.0,
        sun_height=27.0,
        sun_watts=1.5,
        sky=0.20,
        haze=4.0,
        exposure=1.7,
        seed=2,
    ),
}


TABLE = replace(
    SHOTS["near"], aim=(0.0, 0.0, 0.05), distance=0.75, lens_mm=40.0, f_stop=16.0, nearer=0.0
)
TABLE_ROUND = [(-150.0, 0.55), (-78.0, 0.75), (-6.0, 0.5), (66.0, 0.8), (138.0, 0.65)]
"""Azimuth and height of the cameras about a table."""
ROUND = [(-72.0, 1.3), (-36.0, 2.6), (0.0, 1.7), (37.0, 1.58), (74.0, 2.2)]
"""Azimuth and height of the cameras of a set: all on the side of the street."""
ROUND_SAMPLES = 16
"""Of each pixel: denoised, 64 of them look no better at this size."""


def _towards(azimuth: float, height: float) -> Vector:
    a, h = np.radians([azimuth, height])
    return Vector((np.sin(a) * np.cos(h), np.cos(a) * np.cos(h), np.sin(h)))


def place_camera(shot: Shot) -> poses.Pose:
    """Set up Blender's camera; returns the exact perspective pose in OpenCV's convention."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width, data.lens = "HORIZONTAL", SENSOR_MM, shot.lens_mm
    data.clip_end = 1000.0
    camera = bpy.data.objects.new("camera", data)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    flat = shot.distance * _towards(shot.azimuth, 0.0)
    camera.location = (flat.x, flat.y, shot.height)
    look = Vector(shot.aim) - camera.location
    camera.rotation_euler = look.to_track_quat("-Z", "Y").to_euler()
    if shot.lens_mm < 100:  # a real lens is not sharp everywhere, but the car should be
        data.dof.use_dof, data.dof.aperture_fstop = True, shot.f_stop
        data.dof.focus_distance = look.length - shot.nearer
    bpy.context.view_layer.update()
    world = np.array(camera.matrix_world)
    u, _, vt = np.linalg.svd(world[:3, :3])  # Blender's numbers are single precision
    rotation = np.diag([1.0, -1.0, -1.0]) @ (u @ vt).T  # its camera looks along -z, y up
    width, height = shot.size
    focal = shot.lens_mm / SENSOR_MM * width
    # Blender's image centre is the corner between the middle pixels: (W-1)/2 in pixel centres
    intrinsics = {"fx": focal, "fy": focal, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return poses.Pose("perspective", intrinsics, rotation, -rotation @ world[:3, 3])


def light(shot: Shot) -> None:
    """Sun lamp and physical sky, from the same direction."""
    towards = _towards(shot.sun_azimuth, shot.sun_height)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle = shot.sun_watts, np.radians(0.53 * (1 + shot.haze))
    warm = np.clip((45 - shot.sun_height) / 45, 0, 1)
    sun.data.color = (1.0, 0.95 - 0.14 * warm, 0.88 - 0.32 * warm)
    sun.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(sun)
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    sky = world.node_tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type, sky.sun_disc = "NISHITA", False
    sky.sun_elevation, sky.sun_rotation = np.radians(shot.sun_height), np.radians(shot.sun_azimuth)
    sky.dust_density = shot.haze
    background = world.node_tree.nodes["Background"]
    world.node_tree.links.new(sky.outputs[0], background.inputs[0])
    background.inputs[1].default_value = shot.sky


def furnish() -> None:
    """Seats, dashboard, wheel: seen dimly through the panes (only in the photo)."""
    cloth = nodes.plain("cloth", (0.055, 0.055, 0.060), Roughness=0.9)
    dash = nodes.plain("dash", (0.030, 0.030, 0.032), Roughness=0.7)
    blocks = []
    for x, z in ((0.05, 0.0), (-0.85, 0.03)):
        for y in (-0.36, 0.36):
            blocks += [
                ((0.50, 0.50, 0.22), (x + 0.12, y, 0.48 + z), 0, cloth),
                ((0.17, 0.47, 0.62), (x - 0.20, y, 0.80 + z), -14, cloth),
                ((0.10, 0.27, 0.20), (x - 0.31, y, 1.15 + z), -10, cloth),
            ]
    blocks.append(((0.50, 1.36, 0.30), (0.72, 0.0, 0.78), 12, dash))
    for size, at, tilt, material in blocks:
        shape = rounded_block(size, 4.0, 10)
        thing = street.add_mesh("seat", shape.vertices, shape.faces.tolist(), material)
        thing.location, thing.rotation_euler = at, (0, np.radians(tilt), 0)
        thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))
    bpy.ops.mesh.primitive_torus_add(
        location=(0.42, 0.36, 0.92),
        rotation=(0, np.radians(-62), 0),
        major_radius=0.185,
        minor_radius=0.016,
    )
    bpy.context.object.data.materials.append(dash)


def render(shot: Shot, samples: int, scale: int) -> np.ndarray:
    """Render the scene; returns display-referred values (h,w,3) in 0..1."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = samples, True, shot.seed
    scene.cycles.max_bounces, scene.cycles.transparent_max_bounces = 5, 12
    scene.cycles.use_adaptive_sampling, scene.cycles.adaptive_threshold = True, 0.015
    scene.render.resolution_x, scene.render.resolution_y = shot.size
    scene.render.resolution_percentage = scale
    scene.view_settings.view_transform, scene.view_settings.look = (
        "AgX",
        "AgX - Medium High Contrast",
    )
    scene.view_settings.exposure = shot.exposure
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "PNG", "16"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "render.png")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        values = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)
    return values[::-1, :, :3]


def camera_physics(picture: np.ndarray, seed: int) -> np.ndarray:
    """Lens blur, vignette, shot and read noise; (h,w,3) in 0..1 in, 8 bit out."""
    kernel = np.exp(-0.5 * (np.arange(-2, 3) / 0.55) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        wide = np.pad(picture, [(2, 2) if a == axis else (0, 0) for a in range(3)], "edge")
        n = picture.shape[axis]
        picture = sum(k * np.take(wide, range(i, i + n), axis) for i, k in enumerate(kernel))
    h, w = picture.shape[:2]
    y, x = np.mgrid[:h, :w]
    r2 = ((x - (w - 1) / 2) ** 2 + (y - (h - 1) / 2) ** 2) / (0.25 * (w * w + h * h))
    picture = picture * (1 - 0.16 * r2**1.3)[..., None]
    rng = np.random.default_rng(seed)
    spread = np.sqrt(0.0045**2 + 0.00016 * np.clip(picture, 0, 1))
    grain = 0.75 * rng.normal(size=(h, w, 1)) + 0.5 * rng.normal(size=(h, w, 3))
    return np.round(255 * np.clip(picture + spread * grain, 0, 1)).astype(np.uint8)


def save(path: Path, picture: np.ndarray, lens_mm: float) -> None:
    """JPEG with EXIF focal length (tags 0x920A FocalLength, 0xA405 in 35 mm terms)."""
    image = Image.fromarray(picture)
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "poseviewer", "demo camera (rendered)"
    exif.get_ifd(0x8769).update({0x920A: float(lens_mm), 0xA405: round(lens_mm)})
    image.save(path, quality=92, subsampling=0, exif=exif)


def photograph(folder: Path, name: str, shots: list[Shot]) -> dict[str, poses.Pose]:
    """Photos from around, by their names, with the pose of what is photographed."""
    found = {}
    for number, shot in enumerate(shots):
        path, begun = folder / f"{name}-{number}.jpg", time.time()
        found[path.name] = place_camera(shot)
        if not path.exists():
            picture = camera_physics(render(shot, ROUND_SAMPLES, 100), shot.seed)
            save(path, picture, shot.lens_mm)
            print(f"{path.name}: {time.time() - begun:.0f} s", flush=True)
    return found


def save_set(path: Path, photos: dict[str, poses.Pose], unit: str) -> None:
    """The photos as a set, whose frame is that of the poses."""
    views = []
    for name, pose in photos.items():
        place = {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}
        views.append({"photo": name, "camera": pose.camera, "camera_from_set": place})
    text = json.dumps({"format": "poseviewer-views", "version": 1, "unit": unit, "views": views})
    path.write_text(text + "\n")


def round_shots(like: Shot, cameras: list[tuple[float, float]]) -> list[Shot]:
    """The same from other azimuths and heights."""
    return [
        replace(like, azimuth=azimuth, height=height, seed=10 + number)
        for number, (azimuth, height) in enumerate(cameras)
    ]


def photograph_table(folder: Path, models: list[Path]) -> None:
    """Photos from around the models on a table, and a set for each model."""
    things = tabletop.build(models)
    light(TABLE)
    photos = photograph(folder, "table", round_shots(TABLE, TABLE_ROUND))
    for name, thing in things.items():
        turn, shift = tabletop.place_of(thing)
        own = {
            photo: replace(
                pose,
                rotation=pose.rotation @ turn,
                translation=pose.rotation @ shift + pose.translation / tabletop.UNIT,
            )
            for photo, pose in photos.items()
        }
        save_set(folder / f"{name}.views.json", own, "mm")


def main() -> None:
    """Take one photo, or those of a set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shot", choices=[*sorted(SHOTS), "round", "table"])
    parser.add_argument("folder", nargs="?", type=Path, help="of a set")
    parser.add_argument("models", nargs="*", type=Path, help="on a table")
    parser.add_argument("--draft", type=Path, help="write a small quick PNG here and nothing else")
    parser.add_argument("--pose-only", action="store_true", help="keep the photo, redo its pose")
    arguments = parser.parse_args()
    is_set, is_table = arguments.shot in ("round", "table"), arguments.shot == "table"
    if is_set != (arguments.folder is not None) or is_table != bool(arguments.models):
        parser.error("round wants a folder, table a folder and models, the others none")
    shot = SHOTS["near" if is_set else arguments.shot]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if is_table:
        photograph_table(arguments.folder, arguments.models)
        return
    made: dict[str, bpy.types.Material] = {}
    for part in blender_car.load_car(ASSETS / "demo_car.glb").values():
        kind = part["material"]
        if kind not in made:
            made[kind] = nodes.car_material(kind, tuple(part["color"])[:3])
        part.data.materials.append(made[kind])
    furnish()
    street.build()
    light(shot)
    if is_set:
        photos = photograph(arguments.folder, "car", round_shots(shot, ROUND))
        save_set(arguments.folder / "views.json", photos, "m")
        return
    pose = place_camera(shot)
    begun = time.time()
    if arguments.draft:
        picture = render(shot, 16, 50)
        Image.fromarray(camera_physics(picture, shot.seed)).save(arguments.draft)
        print(f"draft {time.time() - begun:.0f} s")
        return
    if not arguments.pose_only:
        picture = camera_physics(render(shot, 64, 100), shot.seed)
        save(ASSETS / shot.photo, picture, shot.lens_mm)
        print(f"{shot.photo}: {time.time() - begun:.0f} s")
    if arguments.shot == "far":
        scene = trimesh.load(ASSETS / "demo_car.glb", process=False)
        points = np.unique(np.round(scene.to_mesh().vertices, 5), axis=0)
        exact = pose.project(points)
        pose = poses.fit_parallel(points, exact, pose, shot.size)
        off = np.linalg.norm(pose.project(points) - exact, axis=1)
        print(f"parallel fit: mean {off.mean():.2f}, most {off.max():.2f} px")
    poses.write(ASSETS / shot.true_pose, pose, shot.photo, shot.size)


if __name__ == "__main__":
    main()
