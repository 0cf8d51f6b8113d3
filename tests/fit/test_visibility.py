"""Which pixels show which of several models, and what that leaves to be compared."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import make_problem
from poseviewer.fit.visibility import MARGIN_PX, NOTHING, depth_image, make_occlusion, visibility
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.types import PlacedModel
from tests.meshes import make_box, make_sphere
from tests.opened import scene_of

CAMERA = Perspective(100.0, 100.0, 80.0, 60.0, 160, 120)
BOX = make_box((2.0, 1.0, 0.5))


def place(x: float, z: float, mesh=BOX, camera=CAMERA, turn=(0.0, 0.0, 0.0)) -> PlacedModel:
    return PlacedModel(mesh, Pose(camera, RigidTransform.from_rotation_vector(turn, [x, 0.0, z])))


@pytest.mark.parametrize("camera", [CAMERA, Parallel(12.0, 80.0, 60.0, 160, 120)])
def test_depth_is_that_of_the_surface(camera):
    ball = make_sphere(5)
    depth = depth_image(place(0.0, 6.0, ball, camera))
    rows, columns = np.nonzero(np.isfinite(depth))
    z = depth[rows, columns].astype(float)
    offset = np.column_stack([columns + 0.5 - 80.0, rows + 0.5 - 60.0])
    xy = offset * z[:, None] / 100.0 if isinstance(camera, Perspective) else offset / 12.0
    radius = np.linalg.norm(np.column_stack([xy, z - 6.0]), axis=1)
    assert len(z) > 300
    assert radius == pytest.approx(1.0, abs=0.01)
    assert z.max() < 6.05


def test_a_near_camera_cuts_depth_as_it_cuts_the_picture():
    inside = place(0.0, 0.0, make_box((4.0, 4.0, 4.0)))
    depth = depth_image(inside)
    assert np.isfinite(depth).all()
    assert depth.max() == pytest.approx(2.0, abs=1e-3)
    assert depth.min() > 0.0


def test_the_nearest_is_seen_whatever_the_order():
    near, far = place(1.2, 5.0), place(0.0, 8.0)
    one, other = visibility([near, far]), visibility([far, near])
    assert np.array_equal(one.mask(0), other.mask(1))
    assert np.array_equal(one.mask(1), other.mask(0))
    assert np.array_equal(one.mask(0), one.silhouettes[0])
    assert np.array_equal(one.nearest == NOTHING, ~(one.silhouettes[0] | one.silhouettes[1]))
    share = np.count_nonzero(one.silhouettes[1] & ~one.silhouettes[0]) / np.count_nonzero(
        one.silhouettes[1]
    )
    assert one.visible_fractions == pytest.approx([1.0, share])
    assert 0.1 < share < 0.9
    assert visibility([place(0.0, 6.0), place(40.0, 6.0)]).visible_fractions == pytest.approx(
        [1.0, 0.0]
    )


def test_what_is_in_front_hides_also_where_the_model_is_not_yet():
    model = place(0.0, 8.0)
    near = place(0.6, 5.0)
    far = place(0.6, 12.0)
    found = make_occlusion(model, [near])
    assert np.array_equal(found.occluded, np.isfinite(depth_image(near)))
    assert not make_occlusion(model, [far]).occluded.any()
    apart = place(-1.8, 5.0)
    assert not (np.isfinite(depth_image(apart)) & found.silhouette).any()
    assert np.array_equal(make_occlusion(model, [apart]).occluded, np.isfinite(depth_image(apart)))
    both = make_occlusion(model, [near, far, apart])
    assert np.array_equal(both.occluded, found.occluded | np.isfinite(depth_image(apart)))
    assert not both.is_total


def attributes(model: PlacedModel, *others: PlacedModel) -> PhotoAttributes:
    """F and P of a photo of a model, among others that are locked."""
    pixels = np.random.default_rng(0).integers(0, 255, (120, 160, 3))
    photo = Photo(pixels.astype(np.uint8), "p.png", "0" * 64)
    scene = scene_of(photo, model.mesh, model.pose)
    (own,), (view,) = scene.objects, scene.views
    locked = []
    for number, one in enumerate(others):
        place, file = view.world_from_model(one.pose), ModelFile.of(one.mesh)
        other = replace(own, id=f"{number} more", model=file, world_from_model=place, locked=True)
        locked.append(other)
    return make_problem(replace(scene, objects=(own, *locked)))[0].photo


def test_hidden_pixels_do_not_count():
    model, near = place(0.0, 8.0), place(0.6, 5.0)
    alone = attributes(model)
    together = attributes(model, near)
    hidden = np.isfinite(depth_image(near))
    assert not together.weights[hidden].any()
    distance = np.asarray(distance_transform_edt(~hidden))
    away = distance > 1.5 * MARGIN_PX
    assert np.array_equal(together.weights[away], alone.weights[away])
    at_edge = (distance <= MARGIN_PX) & ~hidden & (alone.weights > 0.0)
    assert at_edge.any()
    assert not together.weights[at_edge].any()
    assert np.count_nonzero(together.weights) < np.count_nonzero(alone.weights)


def test_a_model_wholly_behind_another_is_said():
    model = place(0.0, 8.0)
    wall = place(0.0, 5.0, make_box((4.0, 4.0, 0.5)))
    with pytest.raises(SettingsError, match="wholly behind other objects"):
        attributes(model, wall)
    beside = replace(wall, pose=place(9.0, 5.0).pose)
    attributes(model, beside)
