"""Models painted from photos: what is painted, in which colours, and what is not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from poseviewer.api import make_registration
from poseviewer.errors import SettingsError
from poseviewer.fit.painting import PosedPhoto, paint_mesh, paint_object
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from poseviewer.geometry.painted_model import Painting
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import with_frames
from poseviewer.scene.types import PlacedModel
from tests.meshes import make_box, make_mesh, make_printed, make_sphere
from tests.moving import BALL, ball, box, off, sequence
from tests.several import CAMERA, lit_models

LIGHT = np.array([0.4, -0.7, -0.6])
SIZE = (2.0, 1.4, 1.0)
PRINTED = make_printed(SIZE)
BARE = replace(make_box(SIZE), colours=np.full((36, 3), 0.7))


def pose_at(turn: float, camera: Camera = CAMERA) -> Pose:
    return Pose(camera, RigidTransform.from_rotation_vector([0.5, turn, 0.1], [0.1, 0.0, 5.0]))


def photo_of(mesh: Mesh, pose: Pose, light=LIGHT, gain: float = 1.0, name="photo") -> PosedPhoto:
    pixels = lit_models([PlacedModel(mesh, pose)], light, np.random.default_rng(0), ground=0.9)
    counts = np.ones(pixels.shape[:2], bool)
    return PosedPhoto(name, (gain * pixels / 255.0).astype(np.float32), counts, pose)


def print_at(painting: Painting) -> tuple[np.ndarray, np.ndarray]:
    """Colours of the painted faces, and the print there, where it is even."""
    faces = painting.mesh.faces[painting.is_painted]
    middles = painting.mesh.vertices[faces].mean(axis=1)
    flat = face_normals_and_areas(painting.mesh.vertices, faces)[0]
    own = PRINTED.vertices[PRINTED.faces].mean(axis=1)
    sides = face_normals_and_areas(PRINTED.vertices, PRINTED.faces)[0]
    true, even = np.zeros(len(faces)), np.ptp(PRINTED.colours[PRINTED.faces, 0], axis=1) < 0.1
    inside = np.zeros(len(faces), bool)
    for index, (middle, normal) in enumerate(zip(middles, flat, strict=True)):
        away = np.linalg.norm(own - middle, axis=1) + 9.0 * (sides @ normal < 0.9)
        nearest = np.argmin(away)
        true[index] = PRINTED.colours[PRINTED.faces[nearest], 0].mean()
        inside[index] = even[nearest] and away[nearest] < 0.02
    colours = painting.mesh.colours[faces].mean(axis=(1, 2))
    return colours[inside], true[inside]


def assert_shows_the_print(painting: Painting, least: float = 0.9) -> None:
    colours, true = print_at(painting)
    assert len(colours) > 30
    assert np.corrcoef(colours, true)[0, 1] > least


def test_a_photo_paints_its_print_on_what_it_shows_and_on_nothing_else():
    pose = pose_at(0.6)
    painting = paint_mesh(BARE, [photo_of(PRINTED, pose)])
    assert_shows_the_print(painting)
    flat = face_normals_and_areas(painting.mesh.vertices, painting.mesh.faces)[0]
    centres = painting.mesh.vertices[painting.mesh.faces].mean(axis=1)
    towards = pose.camera_from_model.inverse().translation - centres
    assert (np.einsum("fi,fi->f", flat, towards)[painting.is_painted] > 0.0).all()
    # Most of what the photo shows, but for a margin.
    shown = SoftwareRenderer(painting.mesh).render(pose)
    assert 0.75 < painting.is_painted[shown.face_ids[shown.mask]].mean() < 1.0
    outline = np.unique(shown.face_ids[shown.mask & ~np.roll(shown.mask, 1, axis=1)])
    assert not painting.is_painted[outline].any()
    assert painting.bare is BARE
    assert 0.2 < painting.share < 0.5


def test_light_is_divided_out():
    ball, dark = make_sphere(4), np.array([0.0, -0.9, -0.3])
    plain = replace(ball, colours=np.full((len(ball.vertices), 3), (0.8, 0.5, 0.3)))
    photo = photo_of(plain, pose_at(0.0), light=dark)
    painting = paint_mesh(plain, [photo])
    colours = painting.mesh.colours[painting.mesh.faces[painting.is_painted]].mean(axis=1)
    raw = photo.pixels[SoftwareRenderer(plain).render_mask(photo.pose)]
    spread, before = (np.std(own, axis=0) / own.mean(axis=0) for own in (colours, raw))
    assert (spread < 0.4 * before).all()
    hue = colours.mean(axis=0) / colours.mean()  # and the photo's colour stays
    np.testing.assert_allclose(hue, np.array([0.8, 0.5, 0.3]) / 0.5333, rtol=0.05)


@pytest.mark.slow
@pytest.mark.long
def test_photos_from_more_sides_paint_more_whatever_their_exposure():
    poses = [pose_at(turn) for turn in (0.6, 1.9, 3.2, 4.5)]
    one = paint_mesh(BARE, [photo_of(PRINTED, poses[0])])
    gains = (1.0, 0.6, 0.8, 0.7)
    photos = [photo_of(PRINTED, *args) for args in zip(poses, [LIGHT] * 4, gains, strict=True)]
    every = paint_mesh(BARE, photos)
    assert every.share > one.share + 0.3
    assert every.photos == ("photo",) * 4
    assert_shows_the_print(every, 0.85)


@pytest.mark.slow
@pytest.mark.long
def test_a_hand_in_one_of_three_photos_paints_nothing():
    poses = [pose_at(turn) for turn in (0.5, 0.6, 0.7)]
    photos = [photo_of(PRINTED, pose) for pose in poses]
    clean = paint_mesh(BARE, photos)
    hand = photos[1].pixels.copy()
    hand[100:150, 130:180] = (0.9, 0.1, 0.1)
    painting = paint_mesh(BARE, [photos[0], replace(photos[1], pixels=hand), photos[2]])
    assert_shows_the_print(painting, 0.88)
    away = np.abs(painting.mesh.colours - clean.mesh.colours).max(axis=1)
    assert np.mean(away > 0.15) < 0.02


def test_a_highlight_that_moves_paints_nothing():
    """It stays where it is in the photo, while the box turns."""
    photos = [photo_of(PRINTED, pose_at(turn)) for turn in (0.2, 0.6, 1.0)]
    rows, columns = np.mgrid[:240, :320]
    glare = np.exp(-((columns - 150) ** 2 + (rows - 120) ** 2) / 80.0)[..., None]
    shiny = [replace(own, pixels=np.fmin(own.pixels + glare, 1).astype("f4")) for own in photos]
    three, one = (
        np.abs(paint_mesh(BARE, shiny[:n]).mesh.colours - paint_mesh(BARE, photos[:n]).mesh.colours)
        for n in (3, 1)
    )
    assert np.mean(three > 0.15) < 0.5 * np.mean(one > 0.15)


def test_a_parallel_camera_paints_as_well():
    camera = Parallel(70.0, 160.5, 120.5, 320, 240)
    assert_shows_the_print(paint_mesh(BARE, [photo_of(PRINTED, pose_at(0.6, camera))]))


def test_a_model_of_one_triangle_is_painted():
    one = make_mesh([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], [[0, 2, 1]])
    pose = Pose(CAMERA, RigidTransform.from_rotation_vector([0.0, 0.2, 0.0], [0.0, 0.0, 4.0]))
    painting = paint_mesh(one, [photo_of(one, pose)])
    assert painting.share > 0.8
    behind = Pose(CAMERA, RigidTransform.from_rotation_vector([0.0, 3.0, 0.0], [0.0, 0.0, 4.0]))
    with pytest.raises(SettingsError, match="no photo shows enough of the model to paint it"):
        paint_mesh(one, [replace(photo_of(one, behind), counts=np.zeros((240, 320), bool))])


def test_what_stands_in_front_is_not_painted():
    """The box, and nothing of the ball behind it, and the other way round."""
    scene = sequence({3: [ball(3, 0.1), box(3)]}, drawn=(lambda i: ball(i, 0.1), box))
    front, behind = paint_object(scene, 1), paint_object(scene, 0)
    alone = sequence({3: [ball(3, 0.1)]}, drawn=(lambda i: ball(i, 0.1),))
    whole = paint_object(alone, 0)
    assert 0.1 < behind.share < 0.9 * whole.share
    both = behind.mesh.colours[behind.mesh.faces[behind.is_painted]]
    assert (both[..., 0] > both[..., 2]).mean() > 0.95  # the ball is warm, the box blue
    cold = front.mesh.colours[front.mesh.faces[front.is_painted]]
    assert (cold[..., 2] > cold[..., 0]).mean() > 0.95


def test_a_sequence_is_painted_from_its_keys_alone():
    scene = sequence({0: [ball(0)], 4: [ball(4)]})
    assert paint_object(scene, 0).photos == ("0.png", "4.png")
    with pytest.raises(SettingsError, match="no key to paint it from"):
        paint_object(replace(scene, frames=tuple(replace(f, poses={}) for f in scene.frames)), 0)


def in_mirror(index: int, photo: Photo) -> Photo:
    """The ball shows its surroundings, which do not turn with it."""
    shown = SoftwareRenderer(BALL).render(ball(index).pose)
    around = np.random.default_rng(5).uniform(0.0, 255.0, (24, 48, 3)).astype(np.uint8)
    around = np.asarray(cv2.resize(around, (480, 240), interpolation=cv2.INTER_CUBIC))
    side = np.arctan2(shown.normals[..., 0], -shown.normals[..., 2]) / np.pi
    column, row = (240 + 239 * side).astype(int), (120 + 119 * shown.normals[..., 1]).astype(int)
    return replace(photo, pixels=np.where(shown.mask[..., None], around[row, column], photo.pixels))


@pytest.mark.slow
@pytest.mark.long
def test_paint_of_a_mirror_confirms_nothing_wrong():
    scene = sequence({0: [ball(0)]})
    files = [PhotoFile.of(in_mirror(i, own.file.photo)) for i, own in enumerate(scene.frames)]
    frames = [replace(own, file=file) for own, file in zip(scene.frames, files, strict=True)]
    scene = with_frames(replace(scene, views=(replace(scene.views[0], file=files[0]),)), frames)
    grey = replace(BALL, colours=np.full_like(BALL.colours, 0.6))
    scene = scene.with_object(0, model=ModelFile.of(grey, name="a"))
    tracked = make_registration(scene, object_index=0).paint().track().scene
    results = {i: own.poses["a"].result for i, own in enumerate(tracked.frames) if "a" in own.poses}
    known = [(i, own.verdict.label) for i, own in results.items() if own and own.verdict]
    assert (1, "found") in known
    assert all(off(tracked, i, ball(i)) < (1.0 if it == "found" else 2.0) for i, it in known)


@pytest.mark.slow
@pytest.mark.parametrize(("off_px", "percent"), [(0.0, 1.0), (8.0, 3.0)])
def test_paint_of_a_wrong_key_does_not_confirm_it_elsewhere(off_px, percent):
    """With a key 5 % of the model's size beside the truth, the outline draws what is found back."""
    truth = ball(0)
    place = truth.pose.camera_from_model
    away = np.array([off_px * place.translation[2] / CAMERA.fx, 0.0, 0.0])
    beside = replace(place, translation=place.translation + away)
    key = replace(truth.pose, camera_from_model=beside)
    scene = sequence({0: [PlacedModel(truth.mesh, key)]})
    grey = replace(truth.mesh, colours=np.full_like(truth.mesh.colours, 0.6))
    scene = scene.with_object(0, model=ModelFile.of(grey, name="a"))
    tracked = make_registration(scene, object_index=0).paint().track().scene
    found = list[float]()
    for index, frame in enumerate(tracked.frames):
        result = frame.poses["a"].result if index and "a" in frame.poses else None
        if result is not None and result.verdict is not None and result.verdict.label == "found":
            found.append(off(tracked, index, ball(index)))
    assert all(error < percent for error in found)
    assert off_px or len(found) == len(scene.frames) - 1
