"""The formats by name; what their files hold stands in ``assets/docs/formats.md``."""

from dataclasses import replace
from pathlib import Path

from poseviewer.files.checks import InputFile
from poseviewer.files.formats.bop import BOP
from poseviewer.files.formats.conversion import ConvertOptions, Format
from poseviewer.files.formats.gltf_export import GLTF
from poseviewer.files.formats.matrices import DOPE, LINEMOD, MATRIX, OPENCV
from poseviewer.files.formats.meshlab import MESHLAB
from poseviewer.files.formats.reconstructions import COLMAP, NERFSTUDIO
from poseviewer.files.masks import masks_beside, pose_contents
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import load_scene, pose_json, scene_contents, scene_of_pose
from poseviewer.scene.types import InView, Scene


def write_own(scene: Scene, out: Path, *_: object) -> dict[Path, bytes]:
    """Write a pose file of our own, and its masks beside it."""
    return pose_contents(out, pose_json(scene), scene.mask(0), scene.occluders(0))


def read_own(path: Path, request: ConvertOptions) -> Scene:
    """Read a pose file."""
    record = load_pose(path)
    scene = scene_of_pose(path, record)
    view = request.with_size(InputFile(path), scene.views[0])
    size = view.file.width, view.file.height
    mask, occluders, notes = masks_beside(path, record, size)
    scene = replace(scene, views=(replace(view, mask=mask),), notes=(*scene.notes, *notes))
    return scene.with_object(0, in_views=(InView(occluders=occluders),)) if occluders else scene


FORMATS = {
    "poseviewer": Format(write_own, read_own, several_photos=False, is_own=True),
    "opencv": OPENCV, "bop": BOP, "colmap": COLMAP, "nerfstudio": NERFSTUDIO, "gltf": GLTF,
    "meshlab": MESHLAB, "matrix": MATRIX, "linemod": LINEMOD, "dope": DOPE,
    "scene": Format(
        lambda scene, out, *_: scene_contents(out, scene), lambda path, _: load_scene(path),
        several_objects=True, several_of_both=True, is_own=True,
    ),
}  # fmt: skip
