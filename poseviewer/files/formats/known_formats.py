"""The formats by name; what their files hold stands in ``assets/docs/formats.md``."""

from __future__ import annotations

from pathlib import Path

from poseviewer.files.checks import Reading
from poseviewer.files.formats.bop import BOP
from poseviewer.files.formats.conversion import (
    ConvertOptions,
    Format,
    Written,
)
from poseviewer.files.formats.gltf import GLTF
from poseviewer.files.formats.meshlab import MESHLAB
from poseviewer.files.formats.opencv import OPENCV
from poseviewer.files.formats.reconstructions import COLMAP, NERFSTUDIO
from poseviewer.files.masks import load_mask, save_pose_and_mask
from poseviewer.files.pose import record_from_json
from poseviewer.files.scene_file import SceneRecord, load_scene, save_scene, scene_of_pose


def write_own(scene: SceneRecord, out: Path, options: ConvertOptions) -> Written:
    """Write a pose file of our own, and its mask beside it."""
    options.refuse_existing([out])
    view, record = scene.views[0], scene.pose_record(0)
    mask = None
    if view.mask and Path(view.mask).is_file():
        mask = load_mask(view.mask, view.photo.width, view.photo.height)
    save_pose_and_mask(out, record, mask)
    return Written((out,))


def read_own(path: Path, request: ConvertOptions) -> SceneRecord:
    """Read a pose file, which often says the photo's size; if not, the request must."""
    reading = Reading(path)
    data = reading.load_object()
    photo = data.get("photo")
    photo = photo if isinstance(photo, dict) else {}
    width, height = request.size_of(reading, photo.get("width"), photo.get("height"))
    return scene_of_pose(path, record_from_json(reading, data, width, height))


def write_scene(scene: SceneRecord, out: Path, options: ConvertOptions) -> Written:
    """Write a scene file."""
    options.refuse_existing([out])
    save_scene(out, scene)
    return Written((out,))


FORMATS = {
    "poseviewer": Format(write_own, read_own, several_photos=False, is_own=True),
    "opencv": OPENCV,
    "bop": BOP,
    "colmap": COLMAP,
    "nerfstudio": NERFSTUDIO,
    "gltf": GLTF,
    "meshlab": MESHLAB,
    "scene": Format(
        write_scene, lambda path, _: load_scene(path), several_objects=True, is_own=True
    ),
}
