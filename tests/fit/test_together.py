"""Several objects in one photo: each is found among the others, and all of them together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.model import judge_end
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.registration import PlacedModel, Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.together import (
    CHANGED,
    MOST_ROUNDS,
    ModelToPlace,
    TogetherProgress,
    search_together,
)
from poseviewer.fit.verdict import Verdict
from poseviewer.fit.visibility import hiding, visibility
from poseviewer.geometry.camera import Pose
from poseviewer.render.software.renderer import SoftwareRenderer
from tests.meshes import make_box
from tests.several import MESHES, STARTS, TRUTH, make_photo

PHOTO = make_photo()
SETTINGS = FitSettings()


def registration(index: int, *others: PlacedModel) -> Registration:
    start = STARTS[index]
    named = (PHOTO, start.mesh, "m.ply", "0" * 64, None, start.pose, ())
    return Registration(*named, others=others)


def share_off(index: int, pose: Pose) -> float:
    """The mean distance of the model's vertices in the photo, in shares of its size there."""
    truth = TRUTH[index].pose.project(MESHES[index].vertices)
    apart = np.linalg.norm(pose.project(MESHES[index].vertices) - truth, axis=1)
    return float(apart.mean() / np.linalg.norm(np.ptp(truth, axis=0)))


def fitted(one: Registration) -> Pose:
    model = ModelToPlace(one, SETTINGS, SoftwareRenderer(one.mesh))
    *_, last = search_together([model], judge_end)
    return last.poses[0]


@pytest.mark.slow
def test_what_another_hides_is_found_right_with_it_and_not_without():
    assert 0.3 < visibility(TRUTH).shares[0] < 0.5
    alone = share_off(0, fitted(registration(0)))
    among = share_off(0, fitted(registration(0, TRUTH[1], TRUTH[2])))
    assert among < 0.01 < alone


@pytest.fixture(scope="module")
def together() -> list[TogetherProgress]:
    models = [
        ModelToPlace(registration(index), SETTINGS, SoftwareRenderer(MESHES[index]))
        for index in range(3)
    ]
    return list(search_together(models, judge_end))


@pytest.mark.slow
def test_all_are_found_together(together):
    ends = [share_off(index, pose) for index, pose in enumerate(together[-1].poses)]
    starts = [share_off(index, one.pose) for index, one in enumerate(STARTS)]
    assert all(end < 0.3 * start for end, start in zip(ends, starts, strict=True))
    assert max(ends) < 0.01
    for placing in together[-1].placings:
        assert placing is not None
        assert placing.progress.verdict is not None


@pytest.mark.slow
def test_the_one_seen_most_goes_first_and_none_is_searched_for_for_ever(together):
    order = [together[0].index]
    for progress in together:
        if progress.index != order[-1]:
            order.append(progress.index)
    assert sorted(order[:3]) == [0, 1, 2]
    assert order[2] == 0  # the one behind
    assert len(order) <= 3 * MOST_ROUNDS


def first_weights(one: Registration, *more: Registration) -> np.ndarray:
    """How much each pixel of the photo counts when the search for ``one`` begins."""
    models = [ModelToPlace(r, SETTINGS, SoftwareRenderer(r.mesh)) for r in (one, *more)]
    placing = next(search_together(models, judge_end)).placings[0]
    assert placing is not None
    photo = placing.problem.photo
    return photo.weights.repeat(photo.factor, axis=0).repeat(photo.factor, axis=1)


def test_others_that_stay_are_in_front_at_first():
    ball = TRUTH[0]
    box = registration(1, ball)
    behind = hiding(STARTS[1], (ball,))
    assert behind.others.any()
    assert not np.any(behind.hidden & behind.drawn)
    seen = first_weights(box) > 0.0
    assert not np.any(seen & behind.others)
    assert np.any(seen & behind.drawn)
    # With one that is searched for, too, it is not known where that is.
    with_it = first_weights(registration(1), registration(0))
    assert np.any((with_it > 0.0) & hiding(STARTS[1], (STARTS[0],)).others)


def test_what_stands_before_a_wall_is_compared_with_it():
    start = STARTS[1]
    place = start.pose.camera_from_model
    far = replace(place, translation=3.0 * place.translation)
    wall = PlacedModel(make_box((40.0, 40.0, 0.1)), replace(start.pose, camera_from_model=far))
    own = hiding(start, (wall,))
    assert np.all(own.others[own.drawn])
    assert np.any((first_weights(registration(1, wall)) > 0.0) & own.drawn)


@pytest.mark.slow
def test_one_verdict_is_asked_for_where_what_others_hide_has_settled():
    # At the start the ball is as near as the box: most of that is not in front of it.
    place = STARTS[0].pose.camera_from_model
    near = replace(place, translation=0.76 * place.translation)
    start = replace(STARTS[0].pose, camera_from_model=near)
    own = replace(registration(0, TRUTH[1]), start=start)
    model = ModelToPlace(own, SETTINGS, SoftwareRenderer(MESHES[0]))
    asked = []

    def trust(progress: FitProgress, *_: object) -> Verdict:
        asked.append(progress.pose)
        return Verdict("found", 1.0, (), None)

    *_, end = search_together([model], trust)
    (placing,) = end.placings
    assert placing is not None
    first, last = (
        hiding(PlacedModel(MESHES[0], pose), (TRUTH[1],)) for pose in (start, end.poses[0])
    )
    changed = np.count_nonzero((first.hidden ^ last.hidden) & last.drawn)
    assert changed > CHANGED * np.count_nonzero(last.drawn)
    assert len(asked) == 1
    assert asked[0] is end.poses[0]
    assert share_off(0, end.poses[0]) < 0.05  # a verdict that trusts anything ends the search
    assert placing.registration.start is start
    few = replace(
        SETTINGS, limits=replace(SETTINGS.limits, evaluations=placing.progress.evaluations - 300)
    )
    *_, end = search_together([replace(model, settings=few)], trust)
    assert end.progress.status is Status.EVALUATIONS_SPENT
    assert end.progress.evaluations <= few.limits.evaluations + 2
    assert end.progress.verdict is not None


def test_an_estimate_that_is_kept_hides_nothing():
    few = replace(SETTINGS, keep_start=True, limits=replace(SETTINGS.limits, evaluations=100))
    models = [
        ModelToPlace(registration(index), few, SoftwareRenderer(MESHES[index]))
        for index in range(3)
    ]
    box = models[1].renderer

    def judge(*asked: object) -> Verdict:
        return Verdict("lost", 0.1, (), None) if box in asked else Verdict("found", 1.0, (), None)

    *_, end = search_together(models, judge)
    statuses = [placing and placing.progress.status for placing in end.placings]
    assert statuses == [Status.EVALUATIONS_SPENT, Status.KEPT, Status.EVALUATIONS_SPENT]
    kept, start = (pose.project(MESHES[1].vertices) for pose in (end.poses[1], STARTS[1].pose))
    np.testing.assert_allclose(kept, start, atol=1e-9)
    ball, _, apart = (placing and placing.registration.others for placing in end.placings)
    assert [one.mesh for one in ball or ()] == [MESHES[2]]
    assert [one.mesh for one in apart or ()] in ([], [MESHES[0]])


def test_what_stands_wholly_behind_another_is_left_where_it_is():
    few = replace(SETTINGS, limits=replace(SETTINGS.limits, evaluations=5))
    wall = PlacedModel(make_box((9.0, 9.0, 0.2)), TRUTH[1].pose)
    model = ModelToPlace(registration(0, wall), few, SoftwareRenderer(MESHES[0]))
    assert list(search_together([model], judge_end)) == []
    beside = ModelToPlace(registration(2), few, SoftwareRenderer(MESHES[2]))
    hidden = replace(model, registration=registration(0))
    at_wall = replace(registration(1), mesh=wall.mesh, start=wall.pose)
    front = ModelToPlace(at_wall, few, SoftwareRenderer(wall.mesh))
    *_, end = search_together([hidden, front, beside], judge_end)
    assert end.placings[0] is None
    assert end.poses[0] is hidden.registration.start
