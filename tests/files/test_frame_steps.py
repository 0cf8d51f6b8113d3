"""Poses by frame, a line each: they are read back as they were, up to one that is not whole."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.files.frame_steps import append_step, load_steps, save_steps
from poseviewer.fit.propagation import propagate
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.sequence import FrameStep
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene
from tests.moving import ball, sequence


@pytest.fixture(scope="module")
def tracked() -> tuple[Scene, list[FrameStep]]:
    scene = sequence({0: [ball(0)]}, count=3)
    # What stood in front is no part of a step: it would be looked for anew.
    scene = scene.with_object(0, settings=FitSettings(in_front="nothing"))
    renderers = {0: SoftwareRenderer(scene.objects[0].mesh)}
    return scene, list(propagate(scene, renderers, 0, 2))


def test_steps_are_read_back_as_they_were(tmp_path, tracked):
    scene, steps = tracked
    path = tmp_path / "steps.jsonl"
    assert load_steps(path, scene) == []
    save_steps(path, steps[:1])
    append_step(path, replace(steps[1], note="It is lost."))
    assert len(path.read_text().splitlines()) == 2
    back = load_steps(path, scene)
    assert [step.frame_index for step in back] == [1, 2]
    assert [step.note for step in back] == ["", "It is lost."]
    for step, known in zip(back, steps, strict=True):
        pose, own = step.poses["a"], known.poses["a"]
        assert pose.source == "propagated"
        assert pose.world_from_model.scale == own.world_from_model.scale
        turn, wanted = (one.world_from_model.rigid.rotation for one in (pose, own))
        np.testing.assert_allclose(turn, wanted, rtol=0.0, atol=1e-14)
        assert pose.result is not None
        assert own.result is not None
        assert (pose.result.loss, pose.result.verdict) == (own.result.loss, own.result.verdict)
        assert pose.result.covariance is not None
        assert own.result.covariance is not None
        np.testing.assert_array_equal(pose.result.covariance.matrix, own.result.covariance.matrix)


@pytest.mark.parametrize("change", ["half", "frame", "object"])
def test_nothing_is_read_from_a_line_that_is_not_whole(tmp_path, tracked, change):
    scene, steps = tracked
    path = tmp_path / "steps.jsonl"
    save_steps(path, steps)
    first, second = path.read_bytes().splitlines(keepends=True)
    broken = {
        "half": second[:200],
        "frame": second.replace(b'"frame_index": 2', b'"frame_index": 3'),
        "object": second.replace(b'{"a": {', b'{"b": {'),
    }[change]
    assert broken != second
    path.write_bytes(first + broken + b"\n" + second)
    assert [step.frame_index for step in load_steps(path, scene)] == [1]


def test_known_steps_are_neither_searched_for_nor_yielded_again(tracked):
    """The way goes on with the same motion, and ends where it had ended."""
    scene, steps = tracked
    renderers = {0: SoftwareRenderer(scene.objects[0].mesh)}
    (last,) = propagate(scene, renderers, 0, 2, known=steps[:1])
    assert last.frame_index == 2
    places = (step.poses["a"].world_from_model.rigid.translation for step in (last, steps[1]))
    np.testing.assert_array_equal([next(places)], [next(places)])
