"""The formats by name; what their files hold stands in ``assets/docs/formats.md``."""

from pathlib import Path

from msgspec import structs

from poseviewer.files.checks import Reading
from poseviewer.files.formats.bop import BOP
from poseviewer.files.formats.conversion import ConvertOptions, Format
from poseviewer.files.formats.gltf import GLTF
from poseviewer.files.formats.matrices import DOPE, MATRIX, OPENCV
from poseviewer.files.formats.meshlab import MESHLAB
from poseviewer.files.formats.reconstructions import COLMAP, NERFSTUDIO
from poseviewer.files.masks import load_mask, mask_as_png, mask_path
from poseviewer.files.pose import load_pose, pose_bytes
from poseviewer.files.scene_json import SceneRecord, load_scene, scene_contents, scene_of_pose


def write_own(scene: SceneRecord, out: Path, *_: object) -> dict[Path, bytes]:
    """Write a pose file of our own, and its mask beside it."""
    view, record, contents = scene.views[0], scene.pose_record(0), {}
    if view.mask and Path(view.mask).is_file():
        mask = load_mask(view.mask, view.photo.width, view.photo.height)
        contents[mask_path(out)] = mask_as_png(mask)
        record = structs.replace(record, mask=mask_path(out).name)
    return {**contents, out: pose_bytes(out, record)}


def read_own(path: Path, request: ConvertOptions) -> SceneRecord:
    """Read a pose file."""
    scene = scene_of_pose(path, load_pose(path))
    view = request.sized(Reading(path), scene.views[0])
    return structs.replace(scene, views=(view, *scene.views[1:]))


FORMATS = {
    "poseviewer": Format(write_own, read_own, several_photos=False, is_own=True),
    "opencv": OPENCV,
    "bop": BOP,
    "colmap": COLMAP,
    "nerfstudio": NERFSTUDIO,
    "gltf": GLTF,
    "meshlab": MESHLAB,
    "matrix": MATRIX,
    "dope": DOPE,
    "scene": Format(
        lambda scene, out, *_: scene_contents(out, scene),
        lambda path, _: load_scene(path),
        several_objects=True,
        is_own=True,
    ),
}
