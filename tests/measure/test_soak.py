"""Work leaves nothing behind. The long run is ``python -m tests.measure.soak``."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator

import pytest

from poseviewer.bench.workload import load_demo, make_model, make_workload
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.software.renderer import SoftwareRenderer
from tests.measure.soak import evaluations, fits, growth, searches

pytestmark = pytest.mark.slow
MOST_BYTES = 30_000
"""What caches of the interpreter may come to; a ``Moments`` kept has a thousand bytes."""
EVALUATIONS = 300


@pytest.fixture(scope="module")
def case():
    demo = load_demo()
    return make_workload(demo, make_model(demo, 5_000), (160, 120))


@pytest.fixture
def traced() -> Iterator[None]:
    gc.freeze()  # what other tests left need not be looked through again and again
    tracemalloc.start()
    yield
    tracemalloc.stop()
    gc.unfreeze()


def traced_bytes() -> float:
    return float(tracemalloc.get_traced_memory()[0])


def grown(work: Iterator[float], count: int) -> float:
    return growth(work, count, traced_bytes, lambda *_: None)


@pytest.mark.usefixtures("traced")
def test_evaluations_leave_nothing_behind(case):
    assert grown(evaluations(case.usual, case.model.renderer), EVALUATIONS) < MOST_BYTES


@pytest.mark.usefixtures("traced")
def test_fits_leave_nothing_behind(case):
    assert grown(fits(case, 10), 20) < MOST_BYTES


def test_models_that_are_opened_and_closed_leave_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr("poseviewer.geometry.mesh.MOST_FACES_KEPT", 0)  # the last one alone

    def opened(count: int) -> int:
        for _ in range(count):
            next(work)
        gc.collect()
        return sum(isinstance(one, Mesh | Photo) for one in gc.get_objects())

    work = searches(tmp_path, 3)
    assert opened(4) == opened(4)


class Hoarder(SoftwareRenderer):
    """Keeps all it ever found."""

    def __init__(self, mesh):
        super().__init__(mesh)
        self.kept = []

    def moments(self, pose, photo):
        self.kept.append(super().moments(pose, photo))
        return self.kept[-1]


@pytest.mark.usefixtures("traced")
def test_what_is_left_behind_is_seen(case):
    assert grown(evaluations(case.usual, Hoarder(case.model.mesh)), EVALUATIONS) > 5 * MOST_BYTES
