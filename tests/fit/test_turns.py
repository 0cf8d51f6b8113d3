"""Several objects in one photo: each is found among the others, and all of them in turn."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state.document import Document
from poseviewer.app.state.results import SearchRequest
from poseviewer.app.workers.jobs import run_search
from poseviewer.confidence.verdict import Verdict
from poseviewer.fit import search as searching
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import Status
from poseviewer.fit.search import Search
from poseviewer.fit.visibility import make_occlusion
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import PlacedModel, Scene, SceneObject, View
from tests.meshes import make_box, make_sphere
from tests.several import CAMERA, LIGHT, MESHES, STARTS, TRUTH, coloured, lit_models, make_photo

SETTINGS = FitSettings()
VIEW = View(PhotoFile.of(make_photo()), CAMERA)


def scene_of(
    *placed: PlacedModel, locked: tuple[int, ...] = (), settings=SETTINGS, view=VIEW
) -> Scene:
    objects = tuple(
        SceneObject(
            id=str(index),
            model=ModelFile.of(one.mesh, None, "0" * 64, name="m.ply"),
            world_from_model=view.world_from_model(one.pose),
            settings=settings,
            locked=index in locked,
        )
        for index, one in enumerate(placed)
    )
    return Scene(views=(view,), objects=objects)


def searched(scene: Scene, *indices: int) -> Search:
    renderers = {index: SoftwareRenderer(scene.objects[index].mesh) for index in indices}
    return Search(scene, renderers, indices)


def share_off(index: int, pose: Pose) -> float:
    """The mean distance of the model's vertices in the photo, in shares of its size there."""
    truth = TRUTH[index].pose.project(MESHES[index].vertices)
    apart = np.linalg.norm(pose.project(MESHES[index].vertices) - truth, axis=1)
    return float(apart.mean() / np.linalg.norm(np.ptp(truth, axis=0)))


@pytest.mark.slow
@pytest.mark.long
def test_all_are_found_in_turn_the_one_seen_most_first():
    search = searched(scene_of(*STARTS), 0, 1, 2)
    steps = list(search.run())
    ends = [share_off(index, search.scene.pose(index)) for index in range(3)]
    starts = [share_off(index, one.pose) for index, one in enumerate(STARTS)]
    assert all(end < 0.3 * start for end, start in zip(ends, starts, strict=True))
    assert max(ends) < 0.01
    assert all(one.is_occluder for one in search.scene.objects[1:])  # the first is half hidden
    order = [steps[0].object_index]
    for step in steps:
        if step.object_index != order[-1]:
            order.append(step.object_index)
    assert sorted(order[:3]) == [0, 1, 2]
    assert order[2] == 0  # the one behind


def first_seen(scene: Scene, *indices: int) -> np.ndarray:
    """Which pixels of the photo count when the search for the first of ``indices`` begins."""
    photo = next(searched(scene, *indices).run()).problem.photo
    return photo.weights.repeat(photo.factor, axis=0).repeat(photo.factor, axis=1) > 0.0


def test_others_that_stay_are_in_front_at_first():
    scene = scene_of(TRUTH[0], STARTS[1], locked=(0,))
    behind = make_occlusion(STARTS[1], (TRUTH[0],))
    assert behind.occluders.any()
    assert not np.any(behind.occluded & behind.silhouette)
    seen = first_seen(scene, 1)
    assert not np.any(seen & behind.occluders)
    assert np.any(seen & behind.silhouette)


def test_what_does_not_stand_firm_hides_nothing():
    counted = []
    for locked in ((1,), ()):
        scene = scene_of(STARTS[0], TRUTH[1], locked=locked)
        counted.append(np.count_nonzero(make_problem(scene)[0].photo.weights))
    assert counted[0] < counted[1]


def test_what_stands_before_a_wall_is_compared_with_it():
    place = STARTS[1].pose.camera_from_model
    far = replace(place, translation=3.0 * place.translation)
    wall = PlacedModel(make_box((40.0, 40.0, 0.1)), replace(STARTS[1].pose, camera_from_model=far))
    own = make_occlusion(STARTS[1], (wall,))
    assert np.all(own.occluders[own.silhouette])
    assert np.any(first_seen(scene_of(STARTS[1], wall, locked=(1,)), 0) & own.silhouette)


@pytest.mark.slow
@pytest.mark.long
def test_one_verdict_is_asked_for_where_what_others_hide_has_settled(monkeypatch):
    # At the start the ball is as near as the box: most of that is not in front of it.
    place = STARTS[0].pose.camera_from_model
    near = replace(place, translation=0.76 * place.translation)
    start = replace(STARTS[0].pose, camera_from_model=near)
    asked = []

    def trust(progress, *_: object):
        asked.append(progress.pose)
        return replace(progress, verdict=Verdict("found", 1.0))

    monkeypatch.setattr(searching, "judge_end", trust)
    scene = scene_of(PlacedModel(MESHES[0], start), TRUTH[1], locked=(1,))
    *_, end = searched(scene, 0).run()
    pose = end.progress.pose
    assert asked == [pose]
    assert share_off(0, pose) < 0.05  # a verdict that trusts anything ends the search
    few = replace(SETTINGS, limits=Limits(end.progress.evaluations - 300))
    *_, end = searched(scene.with_object(0, settings=few), 0).run()
    assert end.progress.status is Status.EVALUATIONS_SPENT
    assert end.progress.evaluations <= few.limits.evaluations + 2
    assert end.progress.verdict is not None


def test_what_is_lost_or_stands_wholly_behind_another_is_left_and_hides_nothing(monkeypatch):
    lost = Verdict("lost", 0.1)
    monkeypatch.setattr(searching, "judge_end", lambda end, *_: replace(end, verdict=lost))
    few = replace(SETTINGS, keep_start=True, limits=Limits(20))
    wall = PlacedModel(make_box((9.0, 9.0, 0.2)), TRUTH[1].pose)
    assert list(searched(scene_of(STARTS[0], wall, locked=(1,), settings=few), 0).run()) == []
    search = searched(scene_of(STARTS[0], wall, STARTS[2], settings=few), 0, 1, 2)
    *_, end = search.run()
    assert [end.progress_by_object[index].status for index in range(3)] == [Status.KEPT] * 3
    assert not any(one.is_occluder for one in search.scene.objects)
    kept = search.scene.pose(0).project(MESHES[0].vertices)
    np.testing.assert_allclose(kept, STARTS[0].pose.project(MESHES[0].vertices), atol=1e-9)


@pytest.mark.slow
@pytest.mark.long
def test_what_is_taken_for_found_on_top_of_a_found_object_does_not_spoil_it(monkeypatch):
    place = RigidTransform.from_rotation_vector([0.5, 0.2, 0.1], [-0.8, -0.5, 7.3])
    sphere = coloured(make_sphere(3, 0.5), (0.9, 0.6, 0.4))
    other = PlacedModel(sphere, replace(TRUTH[0].pose, camera_from_model=place))
    verdicts, judge_end = [], searching.judge_end

    def misjudging(progress, *more):
        end = judge_end(progress, *more)
        if progress.problem.mesh is other.mesh:  # which the photo does not show
            return replace(end, verdict=Verdict("found", 0.99))
        verdicts.append("" if end.verdict is None else end.verdict.label)
        return end

    monkeypatch.setattr(searching, "judge_end", misjudging)
    monkeypatch.setattr(searching, "other_proportions", lambda *_: None)  # which would doubt it
    photo = lit_models((TRUTH[0], TRUTH[2]), LIGHT, np.random.default_rng(0))
    view = replace(VIEW, file=PhotoFile.of(replace(VIEW.photo, pixels=photo)))
    scene = scene_of(STARTS[0], other, STARTS[2], view=view)
    *_, last = run_search(SearchRequest(Document.of(scene), (SETTINGS,), (0, 1, 2)))
    assert "lost" in verdicts  # the other hides most of the ball in its second round
    for index in (0, 2):
        result, verdict = last.best.objects[index].result, last.progress_by_object[index].verdict
        assert result is not None
        assert result.verdict is verdict
        assert verdict is not None
        assert verdict.label == "found"
        assert share_off(index, last.progress_by_object[index].pose) < 0.0025
