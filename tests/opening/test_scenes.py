"""Scenes from files, and back to the records that are saved."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError
from poseviewer.files.masks import MaskFile
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import as_saved, load_scene, pose_json, save_scene
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.symmetry_group import Symmetry, SymmetryAxis
from poseviewer.opening.photo_sets import LoadedViews, SetChoice
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import ChartParameters, InView, Scene, SearchResult
from tests.several import IDS, make_three
from tests.view_sets import DISTANCE, NAMES, TRUTH, make_views, write_set, write_views
from tests.writing import edit


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_three(tmp_path)


def open_saved(path: Path) -> Scene:
    return open_scene(Sources(scene=path))


def open_views(views: Path | LoadedViews, model: Path, start: Path | Pose, **choice) -> Scene:
    made = SetChoice(**choice)
    return open_scene(Sources(views=views, model=model, start=start, choice=made))


def searched(scene, index: int = 0):
    """The scene with the end of a search, and all else that an object can have."""
    one, pose = scene.objects[index], scene.pose(index)
    sure = PoseCovariance(pose, one.mesh.centre, np.diag(np.arange(1.0, 7.0)), 0.5)
    alone = Verdict("doubtful", 0.5, ("Less is seen.",))
    verdict = Verdict("found", 0.9, ("It is seen.",), {"outline": 0.75}, (alone,))
    hidden = np.zeros((240, 320), bool)
    hidden[:, :40] = True
    result = SearchResult(
        verdict=verdict,
        loss=0.25,
        unexplained=0.5,
        chart=ChartParameters("free-body", ("x", "y"), (1.0, 2.0)),
        settings={"seed": 3},
        seen=(0.5,),
        hidden=(hidden,),
        notes=("The focal length is assumed.",),
        covariance=sure,
    )
    return scene.with_object(
        index,
        result=result,
        settings=FitSettings(seed=3, limits=Limits(7)),
        in_views=(
            InView(
                mask=Mask.of(np.tri(240, 320)),
                region=Rectangle(1.0, 2.0, 30.0, 40.0),
                is_compared=False,
            ),
        ),
        locked=True,
        name="the first",
    )


def test_what_is_saved_of_a_scene_is_opened_again(path, tmp_path):
    scene = searched(open_saved(path))
    save_scene(tmp_path / "again.json", as_saved(scene))
    again = open_saved(tmp_path / "again.json")
    one, before = again.objects[0], scene.objects[0]
    assert [own.id for own in again.objects] == list(IDS)
    assert np.array_equal(
        one.world_from_model.rigid.rotation, again.pose(0).camera_from_model.rotation
    )
    for index in range(3):
        place, wanted = again.pose(index).camera_from_model, scene.pose(index).camera_from_model
        assert np.array_equal(place.rotation, wanted.rotation)
        assert np.array_equal(place.translation, wanted.translation)
    assert (one.settings, one.locked, one.name) == (before.settings, True, "the first")
    own, mask = again.in_view(0), scene.mask(0)
    assert (own.region, own.is_compared) == ((1.0, 2.0, 30.0, 40.0), False)
    assert own.mask is not None
    assert mask is not None
    assert np.array_equal(own.mask.weights, mask.weights)
    assert one.result is not None
    assert before.result is not None
    for name in ("verdict", "loss", "unexplained", "chart", "settings", "seen", "notes"):
        assert getattr(one.result, name) == getattr(before.result, name), name
    assert one.result.covariance is not None
    assert before.result.covariance is not None
    assert np.array_equal(one.result.covariance.matrix, before.result.covariance.matrix)
    assert again.objects[1].result is None


def test_a_model_that_has_lost_a_part_has_no_result(path):
    scene = open_scene(Sources(scene=as_saved(searched(open_saved(path)))))
    assert scene.objects[0].result is not None
    with pytest.raises(PoseViewerError, match="no part 'mirror'"):
        open_scene(Sources(scene=path, settings=FitSettings(without=("ball:mirror",))))
    with pytest.raises(PoseViewerError, match="say of which object, as ID:PART"):
        open_scene(Sources(scene=path, settings=FitSettings(without=("mirror",))))


def test_equal_poses_are_saved_as_one(path):
    symmetry = Symmetry.from_axes([0.0, 0.0, 0.1], [SymmetryAxis(np.array([0.0, 0.0, 1.0]), 2)])
    scene = open_saved(path)
    scene = scene.with_object(0, model=scene.objects[0].model.with_content(said_symmetry=symmetry))
    turned = [
        searched(scene.with_pose(0, replace(pose, camera_from_model=pose.camera_from_model @ turn)))
        for pose in (scene.pose(0),)
        for turn in symmetry.transforms()
    ]
    canonical, deviation = symmetry.canonical(scene.pose(0)), np.full(6, 0.1)
    for one in turned:
        record, result = pose_json(as_saved(one)), one.objects[0].result
        sure = result and result.covariance
        require_near(record.pose, canonical)
        assert record.covariance
        assert sure
        moved = symmetry.canonical(sure.pose_at(deviation))
        require_near(record.covariance.pose_at(deviation), moved)
        kept = as_saved(one, canonical=False).pose(0).camera_from_model
        assert np.array_equal(kept.rotation, one.pose(0).camera_from_model.rotation)


def require_near(pose, wanted) -> None:
    place, wanted = pose.camera_from_model, wanted.camera_from_model
    np.testing.assert_allclose(place.rotation, wanted.rotation, atol=1e-9)
    np.testing.assert_allclose(place.translation, wanted.translation, atol=1e-9)


def test_views_begin_with_the_one_of_the_start(tmp_path):
    views, model, start = write_views(tmp_path)
    scene = open_views(views, model, start)
    assert [one.name for one in scene.views] == list(NAMES)
    assert not scene.free_scale
    edit(start, lambda data: data["photo"].update(file="c.png"))
    scene = open_views(views, model, start)
    assert [one.name for one in scene.views] == ["c.png", "a.png", "b.png"]
    place, wanted = scene.pose(0).camera_from_model, load_pose(start, 320, 240).pose
    np.testing.assert_allclose(place.rotation, wanted.camera_from_model.rotation, atol=1e-12)
    with pytest.raises(PoseViewerError, match=r"no photo z\.png; .* one of a\.png, b\.png"):
        open_views(views, model, start, view="z.png")


def test_an_unknown_scale_is_told_by_where_the_cameras_look(tmp_path):
    _, model, _ = write_views(tmp_path)
    found = open_views(make_views(2.5, None), model, TRUTH[0], view="a.png")
    assert found.free_scale
    assert 1.0 / found.objects[0].world_from_model.scale == pytest.approx(2.5, rel=0.05)
    known = open_views(make_views(2.5, None), model, TRUTH[0], view="a.png", scale=2.5)
    assert (known.objects[0].world_from_model.scale, known.free_scale) == (1.0 / 2.5, False)


def test_a_model_without_a_unit_is_taken_in_the_sets_and_that_is_said(tmp_path):
    _, model, start = write_views(tmp_path)
    views = write_set(tmp_path, unit="mm")
    scene = open_views(views, model, start)
    assert scene.objects[0].world_from_model.scale == 1.0
    assert [note for note in scene.notes if "m.ply says no unit: the set's, mm, is taken" in note]
    assert not [n for n in open_views(views, model, start, scale=2.0).notes if "no unit" in n]


def test_a_set_that_was_fitted_is_opened_again(tmp_path):
    views, model, start = write_views(tmp_path)
    scene = open_views(views, model, start, scale=2.0)
    save_scene(tmp_path / "found.scene.json", as_saved(scene))
    again = open_saved(tmp_path / "found.scene.json")
    assert again.objects[0].world_from_model.scale == 0.5
    for view in range(3):
        a, b = (one.pose(0, view).camera_from_model for one in (scene, again))
        np.testing.assert_allclose(a.translation, b.translation, atol=1e-12)
    depth = again.pose(0).camera_from_model.apply(again.objects[0].mesh.centre)[2]
    assert math.isclose(depth, DISTANCE, rel_tol=0.1)
    assert load_scene(tmp_path / "found.scene.json").unit is None


def test_a_start_for_another_size_is_said(tmp_path):
    make_three(tmp_path)
    pose = TRUTH[0].rescale(2.0)
    with pytest.raises(
        PoseViewerError, match=r"a start for photos of 640x480 px, .* pose\.rescale"
    ):
        open_scene(Sources(tmp_path / "three.png", model=tmp_path / "ball.ply", start=pose))


@pytest.mark.parametrize(("value", "said"), [(0, "hides the whole photo"), (255, "hides nothing")])
def test_a_mask_that_hides_nothing_or_all_is_said(tmp_path, value, said):
    make_three(tmp_path)
    cv2.imwrite(str(tmp_path / "m.png"), np.full((240, 320), value, np.uint8))
    sources = Sources(tmp_path / "three.png", model=tmp_path / "ball.ply", start=TRUTH[0])
    notes = open_scene(replace(sources, mask=MaskFile(tmp_path / "m.png"))).notes
    assert f"m.png: the mask {said}" in notes[0]
