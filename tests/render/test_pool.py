"""Many poses at once give what one after another gives, and end when nobody asks any more."""

import threading

import numpy as np
import pytest

from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.pool import ITEMS_PER_CHUNK, RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_bumpy

CAMERA = Perspective(120.0, 120.0, 48.0, 36.0, 96, 72)
RENDERER = SoftwareRenderer(make_bumpy(3))


def make_poses(count: int) -> list[Pose]:
    random = np.random.default_rng(0)
    return [
        Pose(CAMERA, RigidTransform.from_rotation_vector(random.normal(size=3), [0.0, 0.0, z]))
        for z in random.uniform(3.0, 8.0, count)
    ]


def make_photo() -> PhotoAttributes:
    channels = np.random.default_rng(1).uniform(size=(72, 96, 3)).astype(np.float32)
    return PhotoAttributes(channels, np.ones((72, 96), np.float32), clipped=False)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, ITEMS_PER_CHUNK, 61])
def test_moments_are_those_of_one_renderer_in_order(threads, count):
    poses, photo = make_poses(count), make_photo()
    with RendererPool(RENDERER, threads) as pool:
        found = list(pool.map(lambda own, pose: own.moments(pose, photo), poses))
    wanted = [RENDERER.moments(pose, photo) for pose in poses]
    assert len(found) == count
    for ours, theirs in zip(found, wanted, strict=True):
        assert ours.pixels == theirs.pixels
        assert np.array_equal(ours.mean, theirs.mean)
        assert np.array_equal(ours.covariance, theirs.covariance)


def test_no_renderer_is_used_twice_at_once():
    busy: set[int] = set()

    def use(renderer, item):
        assert id(renderer) not in busy
        busy.add(id(renderer))
        renderer.render_mask(item)  # lets go of the interpreter
        busy.remove(id(renderer))
        return id(renderer)

    with RendererPool(RENDERER, 4) as pool:
        assert len(set(pool.map(use, make_poses(200)))) <= 4


@pytest.mark.parametrize("threads", [1, 3])
def test_the_first_failure_is_raised_and_the_pool_goes_on(threads):
    def fail_at_20(_, item):
        if item >= 20:
            raise ZeroDivisionError(str(item))
        return item

    with RendererPool(RENDERER, threads) as pool:
        results = pool.map(fail_at_20, range(100))
        got = []
        with pytest.raises(ZeroDivisionError, match="20"):
            got.extend(results)
        assert got == list(range(len(got)))
        assert list(pool.map(lambda _, item: item, range(50))) == list(range(50))


def test_who_stops_asking_stops_the_work():
    done = []
    with RendererPool(RENDERER, 2) as pool:
        results = pool.map(lambda _, item: done.append(item), range(10_000))
        next(results)
        results.close()  # pyright: ignore[reportAttributeAccessIssue] - it is a generator
    assert len(done) <= 5 * ITEMS_PER_CHUNK


def test_each_thread_begins_as_told():
    begun = []
    with RendererPool(RENDERER, 2, begin=lambda: begun.append(True)) as pool:
        list(pool.map(lambda own, pose: own.render_mask(pose), make_poses(40)))
    assert 1 <= len(begun) <= 2


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_begun_is_done_once_and_beside_a_map(threads):
    done = []
    with RendererPool(RENDERER, threads) as pool:
        result = pool.start(lambda: done.append(threading.get_ident()) or "made")
        assert list(pool.map(lambda _, item: item, range(20))) == list(range(20))
        assert result() == "made"
    assert len(done) == 1
    assert (done[0] == threading.get_ident()) is (threads == 1)
