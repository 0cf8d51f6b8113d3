"""The five ways from a pose to a loss, and how long each stage of each of them takes.

a: pyrender, read back, NumPy, as the paper did it. b: our OpenGL renderer. c: our rasteriser's
pictures, NumPy. d: rasteriser and sums fused, one thread. e: the same on all cores.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from poseviewer.bench.case import Case
from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.render.moments import moments_of_images
from poseviewer.render.opengl.renderer import OpenGLRenderer
from poseviewer.render.pool import CHUNK, RendererPool
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes, Renderer

NAMES = {
    "a": "plain: pyrender, read back, NumPy",
    "b": "our OpenGL renderer, NumPy",
    "c": "software, plain: pictures, NumPy",
    "d": "software, fused, one thread",
    "e": "software, fused, all cores",
}
STEP = 2
"""From one picture of a run to the next it is so many poses: two runs have all eight."""
P = TypeVar("P")
Seconds = dict[str, float]


class Path(Protocol):
    """One way to a loss, before one case."""

    @property
    def letter(self) -> str:
        """Its name, ``a`` to ``e``."""
        ...

    @property
    def threads(self) -> int:
        """How many it takes."""
        ...

    def run(self, k: int) -> Seconds:
        """Go it once, at the case's pose number ``k`` (any number): seconds of each stage.

        ``total`` is from the pose to the loss; ``evaluation`` is from the chart's numbers to the
        loss, as a search asks for it; ``search`` the same for the search's usual loss. No picture
        is made of the pose of the last one: what a renderer keeps of it helps as in a search.
        """
        ...

    def close(self) -> None:
        """Give back what others may need."""
        ...


@dataclass(frozen=True, slots=True)
class ImagePath(Generic[P]):
    """Pictures ``P`` of the attributes are made, and summed up by NumPy."""

    letter: str
    case: Case
    renderer: Renderer
    draw: Callable[[Pose], P]
    sums: Callable[[P, PhotoAttributes], Moments]
    threads: int = 1

    def run(self, k: int) -> Seconds:
        """See ``Path``."""
        pose = self.case.poses[k % len(self.case.poses)]
        times = [perf_counter()]
        picture = self.draw(pose)
        times.append(perf_counter())
        moments = self.sums(picture, self.case.paper.photo)
        times.append(perf_counter())
        lighting_loss(moments)
        times.append(perf_counter())
        render, sums, loss = _differences(times)
        stages = {"render": render, "moments": sums, "loss": loss, "total": times[-1] - times[0]}
        return stages | _through_chart(self.case, self.renderer, k)

    def close(self) -> None:
        """Free the graphics memory, where there is any."""
        close = getattr(self.renderer, "close", None)
        if close is not None:
            close()


@dataclass(frozen=True, slots=True)
class SummedPictures:
    """A renderer without its own way to the moments: pictures, summed up by NumPy."""

    renderer: Renderer

    def render(self, pose: Pose) -> AttributeImage:
        """The renderer's own picture."""
        return self.renderer.render(pose)

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """The renderer's own coverage."""
        return self.renderer.covers(pose)

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The plain way."""
        return moments_of_images(self.render(pose), photo)


@dataclass(frozen=True, slots=True)
class FusedPath:
    """The kernel rasterises and sums in one go."""

    case: Case
    letter: str = "d"
    threads: int = 1

    def run(self, k: int) -> Seconds:
        """See ``Path``. What ``covers`` takes counts as rasterising, the rest as moments.

        ``covers`` makes a picture besides, of the whole photo: for large photos too much counts as
        rasterising. The total has no part in that.
        """
        renderer, poses = self.case.renderer, self.case.poses
        pose, covered = poses[k % len(poses)], poses[(k + STEP) % len(poses)]
        times = [perf_counter()]
        moments = renderer.moments(pose, self.case.paper.photo)
        times.append(perf_counter())
        lighting_loss(moments)
        times.append(perf_counter())
        renderer.covers(covered)
        times.append(perf_counter())
        both, loss, rasterise = _differences(times)
        stages = {"rasterise": rasterise, "moments": max(both - rasterise, 0.0)}
        stages |= {"loss": loss, "total": both + loss}
        return stages | _through_chart(self.case, renderer, k)

    def close(self) -> None:
        """There is nothing that others need."""


class SpreadPath:
    """The fused path on all cores: seconds are for one evaluation, of a batch taken together."""

    letter = "e"

    def __init__(self, case: Case, threads: int) -> None:
        self._case = case
        self._pool = RendererPool(case.renderer, threads)
        self.threads = self._pool.threads

    def run(self, k: int) -> Seconds:
        """See ``Path``; each core does as many evaluations as the others."""
        case = self._case

        def loss(renderer: Renderer, pose: Pose) -> float:
            return lighting_loss(renderer.moments(pose, case.paper.photo))

        def covers(renderer: Renderer, pose: Pose) -> int:
            return renderer.covers(pose).size

        total, rasterise = self._time(loss, case.poses, k), self._time(covers, case.poses, k)
        stages = {"rasterise": rasterise, "moments and loss": max(total - rasterise, 0.0)}
        stages |= {"total": total}
        for stage, problem in _problems(case).items():

            def evaluate(
                renderer: Renderer, parameters: FloatArray, problem: FitProblem = problem
            ) -> float:
                return pose_loss(problem, renderer, parameters)

            stages[stage] = self._time(evaluate, case.parameters, k)
        return stages

    def _time(self, task: Callable[[Renderer, P], object], items: Sequence[P], k: int) -> float:
        """Seconds of one ``task``, in a chunk for each core, from item number ``k`` on."""
        batch = [items[(k + i) % len(items)] for i in range(CHUNK * self.threads)]
        began = perf_counter()
        list(self._pool.map(task, batch))
        return (perf_counter() - began) / len(batch)

    def close(self) -> None:
        """End the pool."""
        self._pool.close()


def make_paths(case: Case, letters: str, threads: int) -> list[Path]:
    """The paths of these letters; ``a`` and ``b`` need OpenGL."""
    makers: dict[str, Callable[[], Path]] = {
        "a": lambda: _plain_path(case),
        "b": lambda: _picture_path("b", case, OpenGLRenderer(case.mesh)),
        "c": lambda: _picture_path("c", case, SummedPictures(case.renderer.clone())),
        "d": lambda: FusedPath(case),
        "e": lambda: SpreadPath(case, threads),
    }
    return [makers[letter]() for letter in letters]


def _plain_path(case: Case) -> Path:
    # Importing it makes the OpenGL context, which must not happen before it is wanted.
    from poseviewer.bench.plain import PlainRenderer, moments_of_picture

    renderer = PlainRenderer(case.mesh)
    return ImagePath("a", case, renderer, renderer.picture, moments_of_picture)


def _picture_path(letter: str, case: Case, renderer: Renderer) -> Path:
    return ImagePath(letter, case, renderer, renderer.render, moments_of_images)


def _through_chart(case: Case, renderer: Renderer, k: int) -> Seconds:
    seconds = {}
    for step, (stage, problem) in enumerate(_problems(case).items(), 2):
        parameters = case.parameters[(k + STEP * step) % len(case.parameters)]
        began = perf_counter()
        pose_loss(problem, renderer, parameters)
        seconds[stage] = perf_counter() - began
    return seconds


def _problems(case: Case) -> dict[str, FitProblem]:
    return {"evaluation": case.paper, "search": case.usual}


def _differences(times: Sequence[float]) -> list[float]:
    return [after - before for before, after in pairwise(times)]
