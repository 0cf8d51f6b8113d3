"""A pose in all views of a set that is too large to search in all of them."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from poseviewer.confidence.verdict import Features
from poseviewer.errors import PhotoFileError
from poseviewer.fit import judge as judging
from poseviewer.fit import search as searching
from poseviewer.fit import view_choice
from poseviewer.fit.judge import MAX_PROBED
from poseviewer.fit.problem import make_problem, views_that_show
from poseviewer.fit.progress import SearchProgress, Status
from poseviewer.fit.search import Search
from poseviewer.fit.stages import Stage, make_stages
from poseviewer.fit.survey import SurveyedView, join, survey, with_residuals
from poseviewer.fit.view_choice import MAX_SEARCHED, choose_views, directions_in_model
from poseviewer.fit.view_results import results_by_view
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.optimise.protocol import State
from poseviewer.render.gpu.gpu_renderer import GpuRenderer
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.types import InView, PlacedModel, Scene, SceneObject, View
from tests.renderers import require_gpu
from tests.several import lit_models
from tests.view_sets import CAMERA, DISTANCE, LIGHTS, MESH, SET_FROM_MODEL, camera_from_set

COUNT = 9
PLACES = tuple(
    camera_from_set(turn, 8.0 * (-1) ** i, 0.0)
    for i, turn in enumerate(np.arange(-60.0, 61.0, 15.0))
)
WRONG = 4
"""Index of the view whose camera is said to stand elsewhere."""
ASIDE = 0.15
"""How far, which shows the shape 7 px beside."""
PROBED = Features(1.0, 1.0, 0.9, 1.0)


@cache
def pixels(index: int):
    """The photo of a view."""
    placed = [PlacedModel(MESH, Pose(CAMERA, PLACES[index] @ SET_FROM_MODEL))]
    return lit_models(placed, LIGHTS[index % 3], np.random.default_rng(index))


def make_scene(off: float = 0.0, unit: float = 1.0, is_wrong: bool = False) -> Scene:
    """The shape at a pose that is ``off`` in all directions, in a world of lengths of ``unit``."""
    views = []
    for index, place in enumerate(PLACES):
        aside = RigidTransform(np.eye(3), np.array([ASIDE, 0.0, 0.0]))
        place = aside @ place if is_wrong and index == WRONG else place
        place = replace(place, translation=place.translation / unit)
        name, size = f"{index}.png", (CAMERA.width, CAMERA.height)

        def read(index: int = index, name: str = name) -> Photo:
            return Photo(pixels(index), name, f"{index}" * 64)

        views.append(View(PhotoFile(None, name, *size, f"{index}" * 64, read=read), CAMERA, place))
    truth = SET_FROM_MODEL
    moved = RigidTransform.from_rotation_vector([off, -off, off], [off, off, -off]) @ truth
    centre = moved.apply(MESH.centre) - truth.apply(MESH.centre)
    moved = replace(moved, translation=(moved.translation - centre + off) / unit)
    item = SceneObject(
        id="1", model=ModelFile.of(MESH, None), world_from_model=Similarity(moved, 1.0 / unit)
    )
    return Scene(views=tuple(views), objects=(item,), free_scale=unit != 1.0)


def errors_px(scene: Scene) -> list[float]:
    """Largest distance of a vertex from the truth in each view."""
    truths = (Pose(CAMERA, place @ SET_FROM_MODEL).project(MESH.vertices) for place in PLACES)
    shown = (scene.pose(0, index).project(MESH.vertices) for index in range(COUNT))
    return [float(np.abs(a - b).max()) for a, b in zip(truths, shown, strict=True)]


def look(scene: Scene) -> list[SurveyedView]:
    return [*survey(scene, 0, range(COUNT), PROBED, SoftwareRenderer(MESH))]


@pytest.mark.slow
@pytest.mark.long
def test_a_gpu_looks_at_one_photo_after_the_other(monkeypatch):
    require_gpu(monkeypatch)
    scene, read = make_scene(), list[int]()

    def counting(index: int, file: PhotoFile) -> PhotoFile:
        def load() -> Photo:
            read.append(index)
            return file.read()

        return replace(file, read=load)

    views = [replace(v, file=counting(i, v.file)) for i, v in enumerate(scene.views)]
    looks = survey(replace(scene, views=tuple(views)), 0, range(2), PROBED, GpuRenderer(MESH))
    for number, one in enumerate(looks):
        assert one.view_index == number
        assert {*read} == {*range(number + 1)}


def test_a_photo_that_cannot_be_read_is_passed_over():
    def fail() -> Photo:
        raise PhotoFileError("gone.png: no such file")

    scene = make_scene()
    views = list(scene.views)
    views[1] = replace(views[1], file=replace(views[1].file, read=fail))
    scene = replace(scene, views=tuple(views))
    looks = survey(scene, 0, range(3), PROBED, SoftwareRenderer(MESH), 2)
    assert [one.view_index for one in looks] == [0, 2]


def test_views_are_chosen_from_all_sides():
    scene = make_scene()
    chosen = choose_views(scene, 0, [3, *(i for i in range(COUNT) if i != 3)])
    assert len(chosen) == MAX_SEARCHED < COUNT
    assert chosen[0] == 3
    assert {0, COUNT - 1} < set(chosen)
    facing = directions_in_model(scene, 0, chosen)
    gaps = np.degrees(np.arccos(np.sort(facing @ facing.T, axis=1)[:, -2]))
    assert gaps.min() > 14.0
    # One in which it is small, far away, tells less.
    far = RigidTransform(PLACES[0].rotation, PLACES[0].translation + np.array([0.0, 0.0, 40.0]))
    views = (replace(scene.views[0], camera_from_world=far), *scene.views[1:])
    assert 0 not in choose_views(replace(scene, views=views), 0, [3, 0, *range(4, COUNT), 1, 2])


def test_a_problem_is_of_the_chosen_views_and_names_those_that_do_not_show_it():
    scene = make_scene()
    problem, notes = make_problem(scene)
    assert not notes
    assert len(problem.views) == MAX_SEARCHED
    assert all(
        "photo" not in scene.views[i].file.__dict__
        for i in range(COUNT)
        if i not in {v.view_index for v in problem.views}
    )
    away = RigidTransform(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    views = [
        replace(v, camera_from_world=away @ v.camera_from_world) if i in (2, 5) else v
        for i, v in enumerate(scene.views)
    ]
    notes = make_problem(replace(scene, views=tuple(views)))[1]
    assert notes == (
        "2 photos do not see the model where it starts, and are left out: 2.png, 5.png.",
    )


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 2.5])
def test_all_views_together_give_the_pose_and_none_is_kept(unit):
    scene = make_scene(0.01, unit)
    assert max(errors_px(scene)) > 1.5
    looks = look(scene)
    assert all("photo" not in view.file.__dict__ for view in scene.views)
    pose, scale = join(scene, 0, looks, 0)
    joined = scene.with_pose(0, pose, 0, scale)
    assert max(errors_px(joined)) < 0.4
    assert 1.0 / scale == pytest.approx(unit, rel=0.002)
    after = with_residuals(joined, 0, looks)
    assert all(view.residual_px is not None and view.residual_px < 1.0 for view in after)
    assert {view.verdict.label for view in after} == {"found"}


@pytest.mark.slow
@pytest.mark.long
def test_a_wrong_camera_is_named_and_moves_nothing():
    scene = make_scene(0.01, is_wrong=True)
    search = Search(scene, {0: SoftwareRenderer(MESH)}, view_index=1)
    *_, now = search.run()
    end, result = now.progress, now.scene.objects[0].result
    assert end.verdict is not None
    assert end.verdict.label == "found"
    assert len(end.problem.views) == MAX_SEARCHED > MAX_PROBED
    right = [px for index, px in enumerate(errors_px(search.scene)) if index != WRONG]
    assert max(right) < 0.5
    assert result is not None
    labels = dict(
        zip((1, 0, *range(2, COUNT)), (one.label for one in end.verdict.views), strict=True)
    )
    assert {index for index, label in labels.items() if label != "found"} == {WRONG}
    assert result.residuals_px[WRONG] == pytest.approx(ASIDE / DISTANCE * CAMERA.fx, rel=0.3)
    assert None not in result.seen
    (note,) = [note for note in result.notes if "photos" in note]
    assert note.startswith(f"1 of {COUNT} photos does not go with the others: {WRONG}.png (")
    each = [*results_by_view(now.scene, 0, end, SoftwareRenderer(MESH))]
    assert [one.view.name for one in each] == [
        "1.png",
        "0.png",
        *(f"{i}.png" for i in range(2, COUNT)),
    ]
    # Left out, it is not looked at.
    in_views = tuple(InView(is_compared=index != WRONG) for index in range(COUNT))
    assert WRONG not in views_that_show(now.scene.with_object(0, in_views=in_views), 0)


AWAY = 0.05
"""By how much the model starts too far away in the first photo."""
SEARCHED = 3


def stay(objective, x0, _scale, _options, _seed=0):
    """Minimise by the start alone."""
    (value,) = objective([x0])
    yield State(x0, value, x0[None], np.array([value]), converged=True)


def at_start(*about) -> tuple[Stage, ...]:
    return (replace(make_stages(*about)[-1], minimise=stay),)


@pytest.fixture
def end_of(monkeypatch):
    """Ends a search that stays at its start in three of four photos, after a look at all of them,
    or at those before which the time was over.
    """
    monkeypatch.setattr(searching, "MAX_SEARCHED", SEARCHED)
    monkeypatch.setattr(view_choice, "MAX_SEARCHED", SEARCHED)
    monkeypatch.setattr(judging, "MAX_PROBED", 1)

    def end_of(looks: int = COUNT, **changes: Any) -> SearchProgress:
        scene = make_scene()
        start = scene.pose(0).camera_from_model
        away = np.array([0.0, 0.0, AWAY])
        start = replace(start, translation=start.translation + away)
        scene = replace(scene, views=scene.views[:8:2]).with_pose(0, Pose(CAMERA, start), 0)
        settings = replace(scene.objects[0].settings, **changes)
        renderers = {0: SoftwareRenderer(MESH)}
        search = Search(scene.with_object(0, settings=settings), renderers, stages=at_start)
        for now in search.run():
            is_look = now.progress.status is Status.RUNNING and now.progress.verdict is not None
            looks -= is_look
            if looks == 1:  # the time is over at the next look
                search._began -= now.settings.limits.seconds
        return now

    return end_of


@pytest.mark.slow
@pytest.mark.long
def test_the_pose_by_all_views_has_their_depth(end_of):
    end = end_of().progress
    assert [view.view_index for view in end.surveyed] == [0, 1, 2, 3]
    assert end.parameters[5] == pytest.approx(-AWAY / DISTANCE, rel=0.2)
    joined = end.covariance.pose.project(MESH.vertices)
    assert end.pose.project(MESH.vertices) == pytest.approx(joined, abs=1e-6)


@pytest.mark.slow
@pytest.mark.long
def test_locked_parameters_stay_after_the_look_at_all_views(end_of):
    end = end_of(lock=("shift_x", "rotation_y")).progress
    assert len(end.surveyed) == 4
    assert end.parameters[[1, 3]] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("looks", [2, 3])
def test_the_time_limit_ends_the_look_at_further_views(end_of, looks):
    now = end_of(looks)
    end = now.progress
    assert end.status is Status.SECONDS_SPENT
    if looks < SEARCHED:  # they tell less than the search
        assert end.surveyed == ()
        assert np.array_equal(end.parameters, end.problem.start)
        assert len(end.verdict.views) == SEARCHED
    else:
        seen = [view.view_index for view in end.surveyed]
        assert seen == [view.view_index for view in end.problem.views]
        assert not np.array_equal(end.parameters, end.problem.start)
        assert now.scene.objects[0].result.notes[-1].startswith("3 of 4 photos were looked at")
