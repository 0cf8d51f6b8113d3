"""Things in front of the model are seen without being told; nothing else is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.api import load, make_scene
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.compared import enlarged
from poseviewer.fit.occlusion import find_hidden
from poseviewer.geometry.pose_error import pose_error

SLAB = (350, 520)
"""Columns of the demo's photo."""


@pytest.fixture(scope="module")
def demo():
    """The demo's case, and the true pose."""
    files = demo_case()
    case = load(files.photo, files.model, files.start)
    return case, load_pose(files.truth, case.photo.width, case.photo.height).pose


@pytest.fixture(scope="module")
def behind_slab(demo):
    """The demo's case with a post in front of the car."""
    case, _ = demo
    pixels = case.photo.pixels.copy()
    left, right = SLAB
    noise = np.random.default_rng(0).normal(0.0, 6.0, (*pixels[:, left:right].shape[:2], 3))
    pixels[:, left:right] = np.clip(np.array([70, 110, 60]) + noise, 0, 255)
    view = replace(case.views[0], photo=replace(case.photo, pixels=pixels))
    return make_scene(replace(case.data, views=(view,)), case.renderer)


def test_nothing_is_in_front_of_a_car_that_is_seen_whole(demo):
    case, truth = demo
    assert find_hidden(case.problem.photo, case.renderer, truth) is None


def test_a_post_is_told_from_the_car_behind_it(demo, behind_slab):
    case, truth = demo
    hidden = find_hidden(behind_slab.problem.photo, case.renderer, truth)
    assert hidden is not None
    photo = case.photo
    full = enlarged(hidden, case.problem.photo.factor, photo.width, photo.height)
    covered = case.renderer.covers(truth)
    post = np.zeros_like(covered)
    post[:, slice(*SLAB)] = True
    assert np.mean(full[covered & post]) > 0.95
    assert np.mean(full[covered & ~post]) < 0.03


def test_what_is_hidden_does_not_count_on_any_level(demo, behind_slab):
    _, truth = demo
    problem = behind_slab.problem
    hidden = find_hidden(problem.photo, behind_slab.renderer, truth)
    assert hidden is not None
    rest = problem.views[0].without(hidden)
    assert not np.any(rest.photo.weights[hidden])
    assert np.array_equal(rest.photo.weights[~hidden], problem.photo.weights[~hidden])
    fine = rest.fine_photo
    assert fine is not None
    height, width = fine.weights.shape
    larger = enlarged(hidden, problem.photo.factor / fine.factor, width, height)
    assert larger.any()
    assert not np.any(fine.weights[larger])


@pytest.mark.slow
def test_a_fit_leaves_out_what_it_sees_in_front(demo, behind_slab, tmp_path):
    _, truth = demo
    found = behind_slab.fit()
    assert pose_error(behind_slab.mesh, found.pose, truth).percent < 0.3
    assert found.hidden is not None
    assert 0.6 < found.seen < 0.8
    mask = found.data.mask(0)
    assert mask is not None
    assert not np.any(mask.weights[found.hidden])
    found.save(tmp_path / "car.pose.json")
    photo = found.photo
    record = load_pose(tmp_path / "car.pose.json", photo.width, photo.height)
    assert record.seen == found.seen
    assert record.mask == "car.mask.png"
