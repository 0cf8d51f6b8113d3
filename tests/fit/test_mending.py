"""A mended key leads outwards, until what is found agrees with what was there."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from msgspec import structs

from poseviewer.fit.propagation import mend, propagate
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.sequence import FrameStep, change_poses, mark_stale, store_key, store_poses
from poseviewer.scene.types import FramePose, Scene
from tests.moving import BALL, ball, off, sequence

COUNT = 8
KEY = 4


@cache
def propagated() -> Scene:
    """Poses through eight frames from a key in the first."""
    scene = sequence({0: [ball(0)]}, count=COUNT)
    for step in propagate(scene, {0: SoftwareRenderer(BALL)}, 0, COUNT - 1):
        scene = store_poses(scene, {step.frame_index: step.poses})
    return scene


def moved(scene: Scene, frames: Sequence[int], by: float = 0.3) -> Scene:
    """The sequence with poses that are wrong in some frames, and sure of it."""

    def move(_: str, known: FramePose) -> FramePose:
        assert known.result is not None
        assert known.result.covariance is not None
        pose = view.pose(known.world_from_model)
        motion = pose.camera_from_model
        place = np.add(motion.translation, [by, 0.0, 0.0])
        wrong = Pose(pose.camera, RigidTransform(motion.rotation, place))
        covariance = replace(known.result.covariance, pose=wrong)
        result = replace(known.result, covariance=covariance)
        return replace(known, world_from_model=view.world_from_model(wrong), result=result)

    view = scene.views[0]
    for index in frames:
        scene = change_poses(scene, move, index, index)
    return scene


def keyed(scene: Scene) -> Scene:
    """The sequence after the user has placed the ball where it is in one frame."""
    scene = replace(scene, frame_index=KEY).with_pose(0, ball(KEY).pose)
    return store_key(scene, 0)


def mended(scene: Scene) -> tuple[list[FrameStep], Scene]:
    steps = list(mend(scene, {0: SoftwareRenderer(BALL)}, KEY, 0))
    after = scene
    for step in steps:
        after = store_poses(after, {step.frame_index: step.poses})
    return steps, after


def changed(before: Scene, after: Scene) -> list[int]:
    """Frames whose pose is another."""
    pairs = enumerate(zip(before.frames, after.frames, strict=True))
    return [
        index
        for index, (old, new) in pairs
        if old.poses["a"].world_from_model is not new.poses["a"].world_from_model
    ]


@pytest.mark.slow
@pytest.mark.long
def test_only_wrong_frames_beside_the_key_change():
    before = keyed(moved(propagated(), [2, 3, 4, 5]))
    steps, after = mended(before)
    # Onwards, then backwards, each to the first frame that agrees, which keeps its pose.
    assert [step.frame_index for step in steps] == [5, 6, 3, 2, 1]
    assert changed(before, after) == [2, 3, 5]
    assert all(off(after, index, ball(index)) < 1.0 for index in range(COUNT))
    assert not any(frame.poses["a"].is_stale for frame in after.frames)
    for index in (0, 1, 6, 7):
        assert after.frames[index].poses["a"].result is before.frames[index].poses["a"].result


@pytest.mark.slow
def test_a_key_that_agrees_changes_no_frame():
    before = keyed(propagated())
    assert [index for index in range(COUNT) if before.frames[index].poses["a"].is_stale] == [3, 5]
    steps, after = mended(before)
    assert [step.frame_index for step in steps] == [5, 3]
    assert changed(before, after) == []
    assert not any(frame.poses["a"].is_stale for frame in after.frames)


def without(scene: Scene, index: int) -> Scene:
    return change_poses(scene, lambda *_: None, index, index)


def make_doubtful(scene: Scene) -> Scene:
    """The sequence whose next poses are right, but doubtful."""

    def doubt(_: str, pose: FramePose) -> FramePose:
        assert pose.result is not None
        assert pose.result.verdict is not None
        verdict = structs.replace(pose.result.verdict, label="doubtful")
        return replace(pose, result=replace(pose.result, verdict=verdict))

    return change_poses(scene, doubt, KEY + 1, KEY + 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alter", "wanted"),
    [
        (lambda scene: without(scene, 5), [3]),
        (lambda scene: store_key(replace(scene, frame_index=5), 0), [3]),
        (lambda scene: mark_stale(scene, "a", 5, 6), [5, 6, 3]),
        (make_doubtful, [5, 6, 7, 3]),
    ],
    ids=["a gap", "a key", "stale ones", "doubtful ones"],
)
def test_a_way_ends_before_keys_and_gaps_and_leads_through_stale_and_worse_poses(
    alter: Callable[[Scene], Scene], wanted: list[int]
):
    steps, _ = mended(alter(keyed(propagated())))
    assert [step.frame_index for step in steps] == wanted


@pytest.mark.slow
@pytest.mark.long
def test_poses_stay_where_the_object_is_lost():
    covered = sequence({0: [ball(0)]}, covered=(5,), count=COUNT)
    pairs = zip(propagated().frames, covered.frames, strict=True)
    frames = tuple(replace(known, file=one.file) for known, one in pairs)
    before = keyed(replace(propagated(), frames=frames))
    steps, after = mended(before)
    assert [step.frame_index for step in steps] == [5, 3]
    assert "frame 6 (5.png): a is lost" in steps[0].note
    assert steps[0].lost == ()
    assert changed(before, after) == []
