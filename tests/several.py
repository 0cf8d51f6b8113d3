"""Three objects in one photo, one in front of another: in memory, and as files."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from poseviewer.files.formats.bop import MODEL_FILE, BopObject, save_bop_images
from poseviewer.files.photo import save_image
from poseviewer.files.scene_assets import model_file, view_of_file
from poseviewer.files.scene_json import save_scene
from poseviewer.fit.visibility import visibility
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import Renderer
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.types import PlacedModel, Scene, SceneObject
from tests.meshes import make_box, make_bumpy

CAMERA = Perspective(420.0, 420.0, 160.5, 120.5, 320, 240)
IDS = ("ball", "front", "apart")
LIGHT = np.array([0.4, -0.7, -0.6])


def coloured(mesh: Mesh, tint: ArrayLike) -> Mesh:
    """One pigment of varying strength: grey reflectance explains its colour photo."""
    return replace(mesh, colours=mesh.colours[:, :1] * np.array(tint, np.float32))


MESHES = (
    coloured(make_bumpy(3), (1.0, 0.8, 0.6)),
    coloured(make_box((1.3, 2.2, 0.9)), (0.5, 0.7, 1.0)),
    coloured(make_box((1.2, 0.8, 1.5)), (0.7, 1.0, 0.6)),
)
PLACES = (
    RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [-0.2, 0.05, 7.0]),
    RigidTransform.from_rotation_vector([0.1, 0.6, -0.1], [0.55, 0.1, 5.0]),
    RigidTransform.from_rotation_vector([0.5, 0.7, 0.3], [-2.2, 0.2, 7.5]),
)
OFF = (
    np.array([0.04, -0.05, 0.03, 0.05, -0.04, 0.04]),
    np.array([-0.03, 0.03, -0.03, 0.04, 0.03, -0.04]),
    np.array([0.03, 0.04, -0.02, -0.05, 0.04, 0.03]),
)
TRUTH = tuple(
    PlacedModel(mesh, Pose(CAMERA, place)) for mesh, place in zip(MESHES, PLACES, strict=True)
)
STARTS = tuple(
    PlacedModel(one.mesh, FreeBodyChart.near(one.mesh, one.pose).to_pose(off))
    for one, off in zip(TRUTH, OFF, strict=True)
)


@cache
def make_photo() -> Photo:
    """All three, lit, on a dark ground; smoothed and noisy."""
    return Photo(lit_models(TRUTH, LIGHT, np.random.default_rng(0)), "three.png", "0" * 64)


def lit_models(
    models: Sequence[PlacedModel],
    light: ArrayLike,
    random: np.random.Generator,
    ground: ArrayLike = 0.08,
    factor: float = 3.0,
) -> NDArray[np.uint8]:
    """A noisy photo of models before a ``ground``: grey, or a picture ``factor`` times as large."""
    large = [replace(one, pose=one.pose.rescale(factor)) for one in models]
    seen = visibility(large)
    lit = np.broadcast_to(np.asarray(ground, float), (*seen.nearest.shape, 3))
    for index, one in enumerate(large):
        image = SoftwareRenderer(one.mesh).render(one.pose)
        shade = np.clip(0.5 + 0.45 * image.normals @ np.asarray(light), 0.03, 1.0)
        lit = np.where(seen.mask(index)[..., None], image.reflectance * shade[..., None], lit)
    size = (models[0].pose.camera.width, models[0].pose.camera.height)
    small = cv2.resize(lit, size, interpolation=cv2.INTER_AREA)
    noisy = small + random.normal(0.0, 0.01, small.shape)
    return np.rint(np.clip(noisy, 0.0, 1.0) * 255.0).astype(np.uint8)


def lit_on_noise(renderer: Renderer, pose: Pose, noise: float = 0.05) -> NDArray[np.float32]:
    """(height, width, 3): the model lit from one side, on a grey ground of noise; not clipped."""
    image = renderer.render(pose)
    lit = image.reflectance * (0.5 + 0.45 * image.normals @ LIGHT)[..., None]
    ground = np.random.default_rng(1).normal(0.4, noise, lit.shape)
    return np.where(image.mask[..., None], lit, ground).astype(np.float32)


def save_halves(path: Path, mesh: Mesh) -> None:
    """An OBJ of two parts, ``left`` and ``right``, by the sign of x."""
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices]
    is_left = mesh.vertices[mesh.faces, 0].mean(axis=1) < 0.0
    for name, faces in (("left", mesh.faces[is_left]), ("right", mesh.faces[~is_left])):
        lines += [f"o {name}", *("f {} {} {}".format(*face) for face in faces + 1)]
    path.write_text("\n".join(lines) + "\n")


def save_model(path: Path, mesh: Mesh) -> None:
    """A PLY with colours."""
    shape = trimesh.Trimesh(
        mesh.vertices,
        mesh.faces,
        vertex_colors=np.rint(mesh.colours * 255).astype(np.uint8),
        process=False,
    )
    shape.export(str(path))


def make_three(folder: Path, placed: Sequence[PlacedModel] = STARTS) -> Path:
    """Write photo, models and a scene file of the starts, or of others; returns the scene file."""
    photo = make_photo()
    save_image(folder / "three.png", photo.pixels)
    view, objects = view_of_file(folder / "three.png", CAMERA), []
    for name, one in zip(IDS, placed, strict=True):
        path = folder / f"{name}.ply"
        save_model(path, one.mesh)
        objects.append(
            SceneObject(
                id=name, model=model_file(path), world_from_model=view.world_from_model(one.pose)
            )
        )
    scene = Scene(views=(view,), objects=tuple(objects))
    save_scene(folder / "three.scene.json", scene)
    return folder / "three.scene.json"


def make_bop(folder: Path) -> Path:
    """Write the same as a BOP scene of image 4, the starts as poses, and ``models`` 1 to 3."""
    (folder / "models").mkdir()
    objects = []
    for number, one in enumerate(STARTS, 1):
        save_model(folder / "models" / MODEL_FILE.format(number), one.mesh)
        objects.append(BopObject(number, one.pose.camera_from_model))
    save_image(folder / "bop.png", make_photo().pixels)
    return write_bop_scene(folder / "bop", CAMERA, {4: folder / "bop.png"}, {4: objects})


def write_bop_scene(
    scene: Path,
    camera: Perspective,
    photos: Mapping[int, Path],
    objects: Mapping[int, Sequence[BopObject]],
    worlds: Mapping[int, RigidTransform] | None = None,
) -> Path:
    """Write a BOP scene of photos by one camera, perhaps with its poses in the scene's world."""
    (scene / "rgb").mkdir(parents=True)
    cameras = {}
    for number, photo in photos.items():
        shutil.copy(photo, scene / "rgb" / f"{number:06d}.png")
        entry = {"cam_K": opencv_matrix(camera).ravel().tolist(), "depth_scale": 1.0}
        if worlds:
            entry["cam_R_w2c"] = worlds[number].rotation.ravel().tolist()
            entry["cam_t_w2c"] = worlds[number].translation.tolist()
        cameras[str(number)] = entry
    save_bop_images(scene, cameras, objects)
    return scene
