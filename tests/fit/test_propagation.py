"""Poses go from keys through the frames of a drawn sequence, and end where nothing is seen."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.errors import PhotoFileError
from poseviewer.fit.propagation import FrameStep, find_chains, propagate
from poseviewer.geometry.image import Photo
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.sequence import store_poses
from poseviewer.scene.types import Frame, FramePose, PlacedModel, Scene
from tests.moving import BALL, FRAMES, ball, box, off, sequence


def run(scene: Scene) -> list[FrameStep]:
    renderers = {i: SoftwareRenderer(one.mesh) for i, one in enumerate(scene.objects)}
    return list(propagate(scene, renderers, 0, len(scene.frames) - 1))


def stored(scene: Scene, steps: Sequence[FrameStep]) -> Scene:
    for step in steps:
        scene = store_poses(scene, {step.frame_index: step.poses})
    return scene


def test_one_key_is_followed_both_ways():
    scene = sequence({2: [ball(2)]})
    steps = run(scene)
    assert [step.frame_index for step in steps] == [1, 0, 3, 4, 5]
    assert not any(step.note for step in steps)
    done = stored(scene, steps)
    assert all(off(done, index, ball(index)) < 1.0 for index in range(FRAMES))
    covariance = done.frames[4].poses["a"].result.covariance
    assert covariance is not None
    assert np.linalg.eigvalsh(covariance.matrix).min() > 0.0


@pytest.mark.slow
def test_covered_object_ends_both_ways():
    scene = sequence({0: [ball(0)], 5: [ball(5)]}, covered=(2, 3))
    steps = run(scene)
    notes = {step.frame_index: step.note for step in steps if step.note}
    assert set(notes) == {2, 3}
    assert "lost in 2.png" in notes[2]
    done = stored(scene, steps)
    assert [bool(frame.poses) for frame in done.frames] == [True, True, False, False, True, True]
    assert off(done, 1, ball(1)) < 1.0
    assert off(done, 4, ball(4)) < 1.0


@pytest.mark.slow
def test_both_ways_are_blended_and_keys_stay():
    scene = sequence({0: [ball(0)], 4: [ball(4)]}, count=5)
    steps = run(scene)
    assert [step.frame_index for step in steps] == [1, 2, 3, 3, 2, 1]
    done = stored(scene, steps)
    for key in (0, 4):
        assert done.frames[key].poses["a"] is scene.frames[key].poses["a"]
    ahead, blended = steps[0].poses["a"], steps[5].poses["a"]
    assert ahead.world_from_model is not blended.world_from_model
    assert all(off(done, index, ball(index)) < 1.0 for index in range(5))
    pose = scene.views[0].pose(blended.world_from_model)
    assert np.allclose(blended.result.covariance.deviation(pose), 0.0)


def left_ball(index: float) -> PlacedModel:
    return ball(index, -2.2)


@pytest.mark.slow
def test_jump_between_both_ways_is_said():
    """The second key is on another ball."""
    scene = sequence({0: [ball(0)], 3: [left_ball(3)]}, (ball, left_ball), count=4)
    steps = run(scene)
    notes = [step.note for step in steps if step.note]
    assert len(notes) == 2
    assert "apart" in notes[0]
    done = stored(scene, steps)
    assert off(done, 1, ball(1)) < 1.0
    assert off(done, 2, left_ball(2)) < 1.0


def test_closing_stops_at_once():
    scene, read = sequence({0: [ball(0)]}), []

    def counted(frame: Frame, index: int) -> Frame:
        def load() -> Photo:
            read.append(index)
            return frame.file.photo

        return replace(frame, file=replace(frame.file, read=load))

    frames = tuple(counted(frame, index) for index, frame in enumerate(scene.frames))
    steps = propagate(replace(scene, frames=frames), {0: SoftwareRenderer(BALL)}, 0, 5)
    assert next(steps).frame_index == 1
    steps.close()
    assert set(read) == {1}


def test_unreadable_frame_ends_the_way():
    scene = sequence({0: [ball(0)]})

    def fail() -> Photo:
        raise PhotoFileError("2.png: it is cut off.")

    frames = list(scene.frames)
    frames[2] = replace(frames[2], file=replace(frames[2].file, read=fail))
    steps = run(replace(scene, frames=tuple(frames)))
    assert [step.frame_index for step in steps] == [1, 2]
    assert steps[1].note == "2.png: it is cut off."
    assert not steps[1].poses


@pytest.mark.slow
def test_two_objects_are_followed_behind_one_another():
    scene = sequence({0: [ball(0), box(0)]}, (ball, box), count=4)
    steps = run(scene)
    done = stored(scene, steps)
    for index in range(4):
        assert off(done, index, ball(index), "a") < 1.5
        assert off(done, index, box(index), "b") < 1.5


def test_locked_object_stays():
    scene = sequence({0: [ball(0), box(0)]}, (ball, box), count=2)
    (step,) = run(scene.with_object(1, locked=True))
    assert set(step.poses) == {"a"}


@pytest.mark.parametrize(
    ("first", "last", "wanted"),
    [
        (0, 5, [(0, 2), (2, 5)]),
        (3, 5, [(2, 5)]),
        (4, 5, [(2, 5)]),
        (0, 1, [(0, 2)]),
        (2, 2, []),
    ],
)
def test_chains_meet_at_keys(first, last, wanted):
    scene = sequence({2: [ball(2)]})
    assert find_chains(scene, first, last, [0]) == wanted


def test_nothing_to_propagate_without_keys():
    scene = sequence({2: [ball(2)]})
    frames = tuple(replace(frame, poses={}) for frame in scene.frames)
    assert run(replace(scene, frames=frames)) == []


@pytest.mark.slow
def test_fresh_pose_is_begun_from_and_stale_one_is_not():
    scene = sequence({0: [ball(0)]}, count=4)
    pose = FramePose(
        world_from_model=scene.views[0].world_from_model(ball(2).pose), source="propagated"
    )
    renderers = {0: SoftwareRenderer(BALL)}
    for is_stale, wanted in ((False, [3]), (True, [1, 2, 3])):
        begun = store_poses(scene, {2: {"a": replace(pose, is_stale=is_stale)}})
        steps = list(propagate(begun, renderers, 2, 3))
        assert [step.frame_index for step in steps] == wanted


@pytest.mark.parametrize("times", [(0.0, 0.0, 0.0), (0.0, 1.0, 3.0), (None, None, None)])
def test_times_may_repeat_and_be_uneven(times):
    """Where they are uneven, so is the motion."""
    scene = sequence({0: [ball(0)], 1: [ball(1)]}, count=4)
    last = 3 if times[2] == 3.0 else 2
    chosen = zip((0, 1, last), times, strict=True)
    frames = tuple(replace(scene.frames[index], time_s=time) for index, time in chosen)
    scene = replace(scene, frames=frames)
    (step,) = run(scene)
    assert step.frame_index == 2
    assert off(stored(scene, [step]), 2, ball(last)) < 1.0


@pytest.mark.parametrize("left", [-40.0, 40.0])
def test_a_key_outside_the_photo_ends_both_ways_with_a_sentence(left):
    scene = sequence({1: [ball(1, left)]}, count=3)
    steps = run(scene)
    assert [step.frame_index for step in steps] == [0, 2]
    assert all("is lost in" in step.note for step in steps)
    assert not any(step.poses for step in steps)
