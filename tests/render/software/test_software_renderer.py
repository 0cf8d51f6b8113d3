"""The rasteriser against analytic pictures, exact coverage, and the plain path to the moments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.losses.paper_loss import lighting_loss
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.moments import moments_of_images
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import (
    make_box,
    make_bumpy,
    make_mesh,
    make_painted,
    make_soup,
    make_sphere,
    merged,
)

SEEDS = st.integers(0, 2**32 - 1)
MESHES = {
    "box": make_box(),
    "bumpy": make_bumpy(3),
    "soup": make_soup(0),
    "all kinds of reflectance": make_painted(),
    "tiny triangles": make_sphere(5, radius=0.3),
}
RENDERERS = {name: SoftwareRenderer(mesh) for name, mesh in MESHES.items()}


def make_photo(channels, weights=None, **settings) -> PhotoAttributes:
    """Attributes of float64 test data; weights 1 unless given."""
    channels = np.asarray(channels, np.float32)
    weights = np.ones(channels.shape[:2]) if weights is None else weights
    return PhotoAttributes(channels, np.asarray(weights, np.float32), **settings)


def random_pose(random, parallel: bool, width=96, height=72) -> Pose:
    """The model somewhere in, or partly out of, the picture; sometimes around the camera."""
    transform = RigidTransform.from_rotation_vector(
        random.normal(size=3) * 2.0, [*random.uniform(-1.0, 1.0, 2), random.uniform(0.2, 6.0)]
    )
    cx, cy = random.uniform(0.2, 0.8, 2) * (width, height)
    if parallel:
        return Pose(Parallel(random.uniform(5.0, 60.0), cx, cy, width, height), transform)
    fx, fy = random.uniform(50.0, 150.0, 2)
    return Pose(Perspective(fx, fy, cx, cy, width, height), transform)


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("name", MESHES)
@given(seed=SEEDS)
@settings(deadline=None, max_examples=25)
def test_fast_path_to_moments_matches_the_plain_one(name, parallel, seed):
    random = np.random.default_rng(seed)
    pose = random_pose(random, parallel)
    n = random.choice([1, 3])
    weights = random.uniform(size=(72, 96)) * (random.uniform(size=(72, 96)) > 0.2)
    channels = random.uniform(size=(72, 96, n))
    photo = make_photo(channels, weights, clipped=bool(random.integers(2)))
    renderer = RENDERERS[name]
    plain = moments_of_images(renderer.render(pose), photo)
    fast = renderer.moments(pose, photo)
    assert fast.pixels == plain.pixels
    assert fast.weight == pytest.approx(plain.weight, rel=1e-5)
    assert fast.mean == pytest.approx(plain.mean, rel=1e-4, abs=1e-5)
    assert fast.covariance == pytest.approx(plain.covariance, rel=1e-4, abs=1e-5)
    assert lighting_loss(fast) == pytest.approx(lighting_loss(plain), abs=1e-4)


@pytest.mark.parametrize("parallel", [False, True])
def test_a_sphere_is_a_disc_with_its_own_normals(parallel):
    place = 80.3, 60.7, 160, 120
    camera = Parallel(50.0, *place) if parallel else Perspective(200.0, 200.0, *place)
    pose = Pose(camera, RigidTransform(np.eye(3), np.array([0.0, 0.0, 4.0])))
    image = SoftwareRenderer(make_sphere(6)).render(pose)
    v, u = np.mgrid[0.5:120, 0.5:160]
    x, y = (u - 80.3) / (50.0 if parallel else 200.0), (v - 60.7) / (50.0 if parallel else 200.0)
    if parallel:
        hit = 1.0 - x * x - y * y
        depth = 4.0 - np.sqrt(np.maximum(hit, 0.0))
    else:
        square = 1.0 + x * x + y * y
        hit = 16.0 - 15.0 * square
        depth = (4.0 - np.sqrt(np.maximum(hit, 0.0))) / square
    assert np.mean(image.mask != (hit > 0.0)) < 1e-3
    inside = image.mask & (hit > 0.05)
    share = np.ones_like(x) if parallel else depth
    point = np.stack([x * share, y * share, depth], -1)
    normal = point - np.array([0.0, 0.0, 4.0])
    cosine = np.sum(image.normals[inside] * normal[inside], axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 0.2


@pytest.mark.parametrize("scale", [1, 4])  # faces over 64 px are drawn in another way
@given(seed=SEEDS)
@settings(deadline=None, max_examples=40)
def test_shared_edges_are_drawn_once(scale, seed):
    """A square cut into a fan of triangles: every pixel inside belongs to exactly one of them."""
    random = np.random.default_rng(seed)
    width, height = 64 * scale, 48 * scale
    square = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    middle = np.round(scale * random.uniform(1, 40, 2) * 2.0) / 2.0  # often on a pixel centre
    vertices = np.column_stack([np.vstack([square, middle]), np.zeros(5)])
    faces = np.array([[0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]])
    pose = Pose(Parallel(1.0, 0.0, 0.0, width, height), RigidTransform.identity())
    counts = np.zeros((height, width), int)
    for face in faces:
        counts += SoftwareRenderer(make_mesh(vertices, face[None])).render(pose).mask
    assert np.all(counts == 1)


def test_the_rule_is_top_left():
    """An edge through pixel centres: the pixels above or left of the shape are not its own."""
    vertices = np.array([[0.5, 0.5, 0], [4.5, 0.5, 0], [4.5, 3.5, 0], [0.5, 3.5, 0]])
    mesh = make_mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    pose = Pose(Parallel(1.0, 0.0, 0.0, 8, 6), RigidTransform.identity())
    expected = np.zeros((6, 8), bool)
    expected[0:3, 0:4] = True
    assert np.array_equal(SoftwareRenderer(mesh).render(pose).mask, expected)


def test_faces_behind_the_camera_are_clipped_not_mirrored():
    """A floor that runs from behind the camera to far ahead fills just the lower half."""
    floor = np.array([[-50, 1, -50], [50, 1, -50], [50, 1, 5000], [-50, 1, 5000]], float)
    mesh = make_mesh(floor, np.array([[0, 2, 1], [0, 3, 2]]))
    pose = Pose(Perspective(100.0, 100.0, 32.0, 24.0, 64, 48), RigidTransform.identity())
    mask = SoftwareRenderer(mesh).render(pose).mask
    assert not mask[:24].any()
    near = 1e-3 * mesh.diameter
    lowest = int(24 + 100.0 * 1.0 / near)
    assert mask[25 : min(lowest, 48) - 1].all()


def test_textures_are_sampled_at_their_texels():
    texture = np.random.default_rng(0).integers(0, 256, (6, 8, 3)).astype(np.uint8)
    vertices, faces = [[0, 0, 0], [8, 0, 0], [8, 6, 0], [0, 6, 0]], [[0, 1, 2], [0, 2, 3]]
    of_texture = {"uvs": [[0, 1], [1, 1], [1, 0], [0, 0]], "face_texture": np.zeros(2)}
    mesh = make_mesh(vertices, faces, colours=np.ones((4, 3)), textures=(texture,), **of_texture)
    pose = Pose(Parallel(1.0, 0.0, 0.0, 8, 6), RigidTransform.identity())
    image = SoftwareRenderer(mesh).render(pose)
    assert image.reflectance == pytest.approx(texture / 255.0, abs=1e-6)


@pytest.mark.parametrize("place", [[500.0, 0.0, 4.0], [0.0, 0.0, -4.0], [0.0, 1e7, 4.0]])
def test_a_model_outside_the_picture_shows_nothing(place):
    pose = Pose(
        Perspective(100.0, 100.0, 32.0, 24.0, 64, 48), RigidTransform(np.eye(3), np.array(place))
    )
    renderer = SoftwareRenderer(make_box())
    assert not renderer.render(pose).mask.any()
    photo = make_photo(np.random.default_rng(0).uniform(size=(48, 64, 3)))
    assert lighting_loss(renderer.moments(pose, photo)) == 3.0


SHAPE = make_bumpy(4)
NESTED = SoftwareRenderer(merged(SHAPE, replace(SHAPE, vertices=0.7 * SHAPE.vertices)))


@pytest.mark.parametrize("parallel", [False, True])
@given(seed=SEEDS)
@settings(deadline=None, max_examples=25)
def test_near_a_pose_nothing_of_what_it_hides_is_missed(parallel, seed):
    random = np.random.default_rng(seed)
    pose = random_pose(random, parallel)
    culled = NESTED.cull(pose)
    across, down = random.uniform(-0.7, 0.7, 2)
    camera = pose.camera
    moved = replace(camera, cx=camera.cx + across, cy=camera.cy + down)
    for near in (pose, replace(pose, camera=moved)):
        assert np.array_equal(culled.render(near).face_ids, NESTED.render(near).face_ids)


@pytest.mark.parametrize("parallel", [False, True])
def test_pictures_do_not_depend_on_what_was_drawn_before(parallel):
    """Buffers are emptied where something was drawn alone; their rows have whole blocks."""
    used, random = NESTED.clone(), np.random.default_rng(0)
    for width in (96, 96, 97, 100, 96):
        photo = make_photo(random.uniform(size=(72, width, 3)))
        for _ in range(8):  # searches jump, and stay about a pose
            pose, fresh = random_pose(random, parallel, width), NESTED.clone()
            moments, expected = used.moments(pose, photo), fresh.moments(pose, photo)
            assert np.array_equal(moments.covariance, expected.covariance)
            image, other = used.render(pose), fresh.render(pose)
            assert np.array_equal(image.face_ids, other.face_ids)
            assert np.array_equal(image.normals, other.normals)


def test_of_two_faces_at_the_same_depth_the_same_one_is_always_seen():
    mesh = make_bumpy(3)
    renderer, random = SoftwareRenderer(merged(mesh, mesh)), np.random.default_rng(1)
    for _ in range(10):
        assert renderer.render(random_pose(random, False)).face_ids.max() < len(mesh.faces)


@pytest.mark.parametrize("parallel", [False, True])
def test_what_one_of_some_poses_shows_is_not_culled(parallel):
    random = np.random.default_rng(0)
    poses = [random_pose(random, parallel) for _ in range(6)]
    culled = NESTED.cull_unseen(poses)
    assert len(culled._surface.faces) <= len(SHAPE.faces)
    for pose in poses:
        assert np.array_equal(culled.render(pose).face_ids, NESTED.render(pose).face_ids)
    away = replace(poses[0], camera=replace(poses[0].camera, cx=-1e4))
    for pose in poses:  # what shows nothing culls nothing
        shown = NESTED.cull_unseen([away]).render(pose)
        assert np.array_equal(shown.face_ids, NESTED.render(pose).face_ids)
