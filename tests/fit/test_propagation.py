"""Poses go from keys through the frames of a drawn sequence, and end where nothing is seen."""

import threading
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.errors import PhotoFileError
from poseviewer.fit import propagation
from poseviewer.fit.propagation import find_chains, propagate
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import FrameStep, store_poses, with_frames
from poseviewer.scene.types import Frame, FramePose, PlacedModel, Scene, SceneObject, View
from tests.fit.test_point_motion import CAN, moved, photo_of
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
@pytest.mark.long
def test_covered_object_ends_both_ways():
    scene = sequence({0: [ball(0)], 5: [ball(5)]}, covered=(2, 3))
    steps = run(scene)
    notes = {step.frame_index: step.note for step in steps if step.note}
    assert set(notes) == {2, 3}
    assert notes[2].startswith("frame 3 (2.png): a is lost: ")
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


def test_whoever_stops_leaves_no_thread_behind():
    scene, before = sequence({0: [ball(0)]}, count=5), threading.active_count()
    steps = propagate(scene, {0: SoftwareRenderer(BALL)}, 0, 4, threads=2)
    next(steps)
    assert threading.active_count() > before
    steps.close()
    assert threading.active_count() == before


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


def unreadable(scene: Scene, indices: Sequence[int]) -> Scene:
    """Return the sequence with frames whose photos cannot be read."""

    def fail() -> Photo:
        raise PhotoFileError("it is cut off.")

    frames = list(scene.frames)
    for index in indices:
        frames[index] = replace(frames[index], file=replace(frames[index].file, read=fail))
    return replace(scene, frames=tuple(frames))


@pytest.mark.slow
@pytest.mark.parametrize("keys", [(0,), (0, 5)])
def test_unreadable_frames_are_stepped_over_by_the_motion(keys):
    scene = unreadable(sequence({key: [ball(key)] for key in keys}), [2, 3])
    steps = run(scene)
    notes = [step.note for step in steps if step.note]
    assert notes == ["frame 3 (2.png): it is cut off; stepped over."]  # of both
    done = stored(scene, steps)
    assert [bool(frame.poses) for frame in done.frames] == [True, True, False, False, True, True]
    assert all(off(done, index, ball(index)) < 1.0 for index in (1, 4, 5))
    assert done.frames[4].poses["a"].result.verdict.label == "found"


def test_too_many_unreadable_frames_end_the_way(monkeypatch):
    monkeypatch.setattr(propagation, "MAX_UNREAD", 1)
    steps = run(unreadable(sequence({0: [ball(0)]}), [2, 3]))
    assert [step.frame_index for step in steps] == [1, 2, 3]
    said = "it is cut off; too many in a row, the motion is lost."
    assert steps[2].note == f"frame 4 (3.png): {said}"


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
    assert all(": a is lost: " in step.note for step in steps)
    assert not any(step.poses for step in steps)


def printed_sequence(poses: Sequence[Pose]) -> Scene:
    """A printed can, the key in the first frame."""
    photos = [photo_of(pose, seed) for seed, pose in enumerate(poses)]
    view = View(PhotoFile.of(photos[0]), poses[0].camera)
    place = view.world_from_model(poses[0])
    item = SceneObject(id="a", model=ModelFile.of(CAN, name="a"), world_from_model=place)
    files = [PhotoFile.of(photo) for photo in photos]
    frames = [Frame(file=file, poses={}) for file in files]
    frames[0] = replace(frames[0], poses={"a": FramePose(world_from_model=place)})
    return with_frames(Scene(views=(view,), objects=(item,)), frames)


@pytest.mark.slow
@pytest.mark.long
def test_a_printed_thing_that_jumps_is_followed():
    """By no velocity: the first step is far wider than a motion that nothing tells."""
    turns, shifts = [0.0, 14.0, 26.0], [0.0, 0.35, 0.7]
    poses = [moved(turn, (shift, 0.0, 0.0)) for turn, shift in zip(turns, shifts, strict=True)]
    scene = printed_sequence(poses)

    def errors() -> list[float]:
        steps = propagate(scene, {0: SoftwareRenderer(CAN)}, 0, len(poses) - 1)
        tracked = store_poses(scene, {step.frame_index: step.poses for step in steps})
        found = [frame.poses.get("a") for frame in tracked.frames]
        views = [
            None if one is None else scene.views[0].pose(one.world_from_model) for one in found
        ]
        return [
            np.inf if pose is None else pose_error(CAN, pose, truth).percent
            for pose, truth in zip(views, poses, strict=True)
        ]

    assert max(errors()) < 1.0


@pytest.mark.slow
@pytest.mark.long
def test_a_lost_thing_is_looked_for_before_its_track_ends(monkeypatch):
    poses = [moved(turn, (shift, 0.0, 0.0)) for turn, shift in ((0.0, 0.0), (14.0, 0.35))]
    scene = printed_sequence(poses)
    monkeypatch.setattr(propagation, "follow_points", lambda *_: None)
    (step,) = propagate(scene, {0: SoftwareRenderer(CAN)}, 0, 1, threads=2)
    pose = scene.views[0].pose(step.poses["a"].world_from_model)
    assert pose_error(CAN, pose, poses[1]).percent < 1.0
