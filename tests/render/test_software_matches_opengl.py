"""Two rasterisers that share no code but the texture pyramid must give the same pictures."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import AttributeImage
from poseviewer.render.opengl import OpenGLRenderer
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_box, make_bumpy, make_mesh, make_painted, make_soup, make_sphere
from tests.renderers import require_opengl

WIDTH, HEIGHT = 320, 240
POSES = 40


def make_crowded() -> Mesh:
    """A box after 70,000 faces without area."""
    box = make_box()
    return make_mesh(box.vertices, np.concatenate([np.zeros((70_000, 3), int), box.faces]))


@pytest.fixture(autouse=True, scope="module")
def _opengl():
    require_opengl()


def make_poses(mesh: Mesh, seed: int) -> list[Pose]:
    """Half perspective, half parallel; from near to far, some partly out of view."""
    random = np.random.default_rng(seed)
    return [make_pose(mesh, random, perspective=k % 2 == 0) for k in range(POSES)]


def make_pose(mesh: Mesh, random: np.random.Generator, perspective: bool) -> Pose:
    rotation = Rotation.random(rng=random).as_matrix()
    cx, cy = random.uniform(0.3, 0.7, 2) * [WIDTH, HEIGHT]
    x, y = random.uniform(-0.4, 0.4, 2) * mesh.diameter
    z = random.uniform(0.8, 3.0) * mesh.diameter
    translation = np.array([x, y, z]) - rotation @ mesh.centre
    if perspective:
        fx, fy = random.uniform(250.0, 500.0) * random.uniform(0.9, 1.1, 2)
        camera = Perspective(fx, fy, cx, cy, WIDTH, HEIGHT)
    else:
        camera = Parallel(400.0 / z, cx, cy, WIDTH, HEIGHT)
    return Pose(camera, RigidTransform(rotation, translation))


def angles_deg(a: AttributeImage, b: AttributeImage, where: np.ndarray) -> np.ndarray:
    """Angles between the normals of both pictures."""
    first, second = a.normals[where].astype(float), b.normals[where].astype(float)
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.degrees(np.arctan2(sine, np.sum(first * second, axis=1)))


@pytest.mark.parametrize(
    "mesh",
    [make_box(), make_bumpy(), make_soup(3), make_painted(), make_crowded()],
    ids=["sharp", "smooth", "soup", "painted", "face numbers beyond two bytes"],
)
def test_software_matches_opengl(mesh):
    opengl, software = OpenGLRenderer(mesh), SoftwareRenderer(mesh)
    seen = 0
    for pose in make_poses(mesh, seed=4):
        a, b = opengl.render(pose), software.render(pose)
        union = np.sum(a.mask | b.mask)
        if union < 200:
            continue
        seen += 1
        both = a.mask & b.mask
        same = both & (a.face_ids == b.face_ids)
        assert both.sum() >= 0.995 * union
        assert same.sum() >= 0.99 * union
        assert np.median(angles_deg(a, b, both)) < 0.1
        # Normals and colours are those between corners snapped to 1/256 px: slivers feel it.
        angles = angles_deg(a, b, same)
        assert np.percentile(angles, 99) < 0.05
        assert angles.max() < 1.0
        differences = np.abs(a.reflectance - b.reflectance)[same]
        assert np.percentile(differences, 99) < 1e-3
        assert np.mean(differences > 0.02) < 3e-3  # a sliver may get the next texture level
    assert seen > 0.7 * POSES
    opengl.close()


def test_several_renderers_sizes_and_closing_do_not_disturb_one_another():
    first, second = OpenGLRenderer(make_sphere(2)), OpenGLRenderer(make_sphere(3))
    camera = Perspective(410.0, 395.0, 97.3, 148.6, 251, 203)
    pose = Pose(camera, RigidTransform(np.eye(3), np.array([0.1, 0.0, 5.0])))
    before = first.render(pose)
    assert second.render(pose.rescale(0.5)).mask.shape == (102, 126)
    first.close()
    assert second.render(pose).mask.any()
    assert (first.render(pose).face_ids == before.face_ids).all()
    first.close()
    second.close()
