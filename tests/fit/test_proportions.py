"""Models of other proportions than the thing in the photo."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.api import make_registration
from poseviewer.app.state.document import with_camera
from poseviewer.confidence.verdict import FOUND_FROM
from poseviewer.files.scene_assets import load_model
from poseviewer.fit.problem import make_problem
from poseviewer.fit.proportions import StretchProbe
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import nearest_rotation
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.types import Scene
from tests.meshes import make_box, make_printed, make_sphere, merged
from tests.scene import make_scene_of


def stretched(scene, *factors: float) -> Scene:
    """The small scene, from its start, with its model stretched along x, y and z."""
    model = load_model(scene.model)
    normals = model.mesh.normals / factors
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mesh = replace(model.mesh, vertices=model.mesh.vertices * factors, normals=normals)
    return open_scene(Sources(scene.photo, model=model.with_content(mesh=mesh), start=scene.start))


def test_a_stretch_draws_a_stretched_model_and_leaves_the_rotation_rigid(scene):
    opened = stretched(scene, 1.0, 1.0, 1.0)
    mesh, factors = opened.objects[0].mesh, np.array([1.3, 0.8, 1.1])
    problem = make_problem(opened)[0]
    probe = StretchProbe(problem, SoftwareRenderer(mesh), opened.pose(0), threads=1)
    pose = probe.pose(np.append(np.zeros(len(probe.motions)), np.log(factors)))
    rotation = pose.camera_from_model.rotation
    np.testing.assert_allclose(rotation, nearest_rotation(rotation), atol=1e-12)
    about = probe.fixed_point
    longer = replace(mesh, vertices=about + (mesh.vertices - about) * factors)
    rigid = opened.pose(0)
    np.testing.assert_allclose(pose.project(mesh.vertices), rigid.project(longer.vertices))
    drawn, wanted = (
        SoftwareRenderer(of).render_mask(at) for of, at in ((mesh, pose), (longer, rigid))
    )
    assert np.count_nonzero(drawn != wanted) <= 0.01 * np.count_nonzero(wanted)


@pytest.mark.parametrize("axis", [0, 2])
def test_a_model_25_percent_too_long_along_an_axis_is_not_found(scene, axis: int):
    factors = np.where(np.arange(3) == axis, 1.25, 1.0)
    verdict = make_registration(stretched(scene, *factors)).fit().verdict
    assert verdict is not None
    assert verdict.label == "doubtful"
    assert ": another model?" in verdict.reasons[0]


def test_an_assumed_focal_length_is_the_first_suspect(scene):
    """The right model, by a focal length that is a little more than half of the photo's."""
    opened = stretched(scene, 1.0, 1.0, 1.0)
    assumed = opened.views[0].photo.default_camera()
    pose = with_camera(opened.pose(0), assumed, opened.objects[0].mesh.centre)
    verdict = make_registration(opened.with_pose(0, pose)).fit().verdict
    assert verdict is not None
    assert "a wrong focal length, which is assumed (find it), or another" in verdict.reasons[0]


def test_a_model_that_fits_stays_found(scene):
    verdict = make_registration(stretched(scene, 1.0, 1.0, 1.0)).fit().verdict
    assert verdict is not None
    assert verdict.label == "found"
    assert not any("along its" in reason for reason in verdict.reasons)


def plate(width: float, height: float, x: float = 0.0, y: float = 0.0) -> Mesh:
    """A grey plate about (x, y, 0)."""
    box = make_box((width, height, 0.1))
    colours = np.full_like(box.colours, 0.6)
    return replace(box, vertices=box.vertices + np.array([x, y, 0.0]), colours=colours)


@pytest.mark.slow
def test_a_box_is_not_found_on_an_ellipse_of_its_size(tmp_path):
    """What the ellipse lacks of the box could lie behind something."""
    ball = make_sphere()
    normals = ball.normals / [1.4, 1.0, 0.02]  # of a flat disc
    disc = replace(
        ball,
        vertices=ball.vertices * [1.4, 1.0, 0.3],
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        colours=np.full_like(ball.colours, 0.6),
    )
    plain = plate(2.8, 2.0)
    box = replace(plain, vertices=plain.vertices * [1.0, 1.0, 6.0])
    scene = make_scene_of(disc, tmp_path)
    model = load_model(scene.model).with_content(mesh=box)
    verdict = (
        make_registration(open_scene(Sources(scene.photo, model=model, start=scene.start)))
        .fit()
        .verdict
    )
    assert verdict is not None
    assert verdict.label != "found"


@pytest.mark.slow
@pytest.mark.long
def test_a_plate_that_lacks_a_corner_is_not_found_on_a_whole_one(tmp_path):
    """An L-shaped plate fits into a square one but for a fourth of its outline."""
    whole, corner = plate(2, 2), merged(plate(2, 1, 0, -0.5), plate(1, 1, -0.5, 0.5))
    scene, words = make_scene_of(whole, tmp_path), []
    model = load_model(scene.model)
    for mesh in (whole, corner):
        opened = open_scene(
            Sources(scene.photo, model=model.with_content(mesh=mesh), start=scene.start)
        )
        verdict = make_registration(opened).fit().verdict
        assert verdict is not None
        assert verdict.probability >= FOUND_FROM
        assert any("of one colour" in reason for reason in verdict.reasons)
        words.append(verdict.label)
    assert words == ["found", "doubtful"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("depth", [0.8, 1.2])
def test_proportions_that_the_photo_does_not_tell_are_named(tmp_path, depth: float):
    """A box seen straight on shows one side, whatever its depth."""
    box = make_printed((2.0, 1.4, 1.0))
    scene = make_scene_of(box, tmp_path, rotation_vector=[0.0, 0.0, 0.2])
    verdict = make_registration(stretched(scene, 1.0, 1.0, depth)).fit().verdict
    assert verdict is not None
    assert verdict.label == "found"
    assert "along its z-axis would fit as well" in verdict.reasons[-1]
