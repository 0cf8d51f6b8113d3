"""The six ways from a pose to a loss, and how long each stage of each takes.

a: pyrender, read back, NumPy, as the paper did it. b: our OpenGL renderer. c: our rasteriser's
images, NumPy. d: rasteriser and sums fused, one thread. e: the same on all cores. f: on a GPU, many
poses in one submission.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from poseviewer.bench.workload import POSES, Workload
from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.geometry.camera import Pose
from poseviewer.render.moments import moments_of_images
from poseviewer.render.opengl.renderer import OpenGLRenderer
from poseviewer.render.pool import CHUNK, RendererPool
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.render.types import Moments, PhotoAttributes, Renderer

if TYPE_CHECKING:  # wgpu is an extra
    from poseviewer.render.gpu.renderer import GpuRenderer

NAMES = {
    "a": "plain: pyrender, read back, NumPy",
    "b": "our OpenGL renderer, NumPy",
    "c": "software, plain: pictures, NumPy",
    "d": "software, fused, one thread",
    "e": "software, fused, all cores",
    "f": "GPU, many poses at once",
}
BATCHES = (1, 32, 512)
"""Poses that path f judges at once; its other stages are of the last. On a software adapter, which
no batch makes quicker, the last is left out, and other stages are of the first."""
BATCH_STAGE = "batch of {}"
STEP = 2
"""Poses from one image of a run to the next: no image is of the pose before it, and two runs have
all eight."""
SLOW_S = 3.0
"""A path whose first run took longer is warm after it."""
LEAST_ROUNDS = 3
BURST_S, LONGEST_BURST = 0.15, 8
"""About how long a path's turn lasts, s, and the most runs in it."""
QUICK_S = 0.25
"""A path whose run takes less begins each turn with one that does not count."""
Item = TypeVar("Item")
Seconds = dict[str, float]


@dataclass(frozen=True, slots=True)
class Path:
    """One way to a loss, before one workload."""

    letter: str
    renderer: Renderer
    run: Callable[[int], Seconds]
    """Go it once, at the workload's pose of this number (any): seconds of each stage.

    ``total`` is from the pose to the loss; ``evaluation`` is from the chart's parameters to the
    loss, as a search asks for it; ``search`` the same for the loss ``usual``.
    """
    threads: int = 1
    close: Callable[[], None] = lambda: None


@dataclass(frozen=True, slots=True)
class StageTime:
    """The time of one stage of one path, ms."""

    path: str
    """A letter, ``a`` to ``f``."""
    triangles: int
    """As asked for."""
    width: int
    height: int
    threads: int
    stage: str
    ms_median: float
    ms_min: float
    ms_max: float
    runs: int
    faces: int
    """As the model really has."""
    covered_px: int
    """Pixels of the photo that show the model at its true pose."""


class SummedImages(SoftwareRenderer):
    """Our rasteriser's images, summed up by NumPy."""

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The plain way."""
        return moments_of_images(self.render(pose), photo)


def make_path(work: Workload, letter: str, threads: int) -> Path:
    """The path of this letter; ``a`` and ``b`` need OpenGL, ``f`` a GPU, ``threads`` are those of
    ``e``.
    """
    software = work.model.renderer
    if letter == "e":
        pool = RendererPool(software, threads)
        return Path("e", software, partial(_run_batch, work, pool), pool.threads, pool.close)
    if letter == "f":
        from poseviewer.render.gpu.renderer import GpuRenderer

        renderer = GpuRenderer(work.model.mesh)
        return Path("f", renderer, partial(_run_on_gpu, work, renderer))
    if letter == "d":
        return Path("d", software, partial(_run_fused, work))
    sums: Callable[[Any, PhotoAttributes], Moments] = moments_of_images
    if letter == "c":
        renderer = SummedImages(work.model.mesh)
        return Path("c", renderer, partial(_run_images, work, renderer, renderer.render, sums))
    if letter == "b":
        renderer = OpenGLRenderer(work.model.mesh)
        draw = renderer.draw
        sums = lambda drawn, photo: moments_of_images(drawn[0], photo, drawn[1])  # noqa: E731
    else:
        # Importing it makes the OpenGL context, which must not happen before it is wanted.
        from poseviewer.bench.plain import PlainRenderer, moments_of_picture

        renderer = PlainRenderer(work.model.mesh)
        draw, sums = renderer.picture, moments_of_picture
    run = partial(_run_images, work, renderer, draw, sums)
    return Path(letter, renderer, run, close=renderer.close)


def _run_images(
    work: Workload,
    renderer: Renderer,
    draw: Callable[[Pose], Any],
    sums: Callable[[Any, PhotoAttributes], Moments],
    k: int,
) -> Seconds:
    began = perf_counter()
    image = draw(work.poses[k % POSES])
    drawn = perf_counter()
    moments = sums(image, work.paper.photo)
    summed = perf_counter()
    lighting_loss(moments)
    end = perf_counter()
    stages = {"render": drawn - began, "moments": summed - drawn, "loss": end - summed}
    return stages | {"total": end - began} | _through_chart(work, renderer, k)


def _run_fused(work: Workload, k: int) -> Seconds:
    """What ``covers`` takes counts as rasterising, the rest as moments.

    ``covers`` makes an image besides, of the whole photo: for large photos too much counts as
    rasterising. The total has no part in that.
    """
    renderer = work.model.renderer
    began = perf_counter()
    moments = renderer.moments(work.poses[k % POSES], work.paper.photo)
    summed = perf_counter()
    lighting_loss(moments)
    end = perf_counter()
    renderer.covers(work.poses[(k + STEP) % POSES])
    rasterise = perf_counter() - end
    return {
        "rasterise": rasterise,
        "moments": max(summed - began - rasterise, 0.0),
        "loss": end - summed,
        "total": end - began,
    } | _through_chart(work, renderer, k)


def _through_chart(work: Workload, renderer: Renderer, k: int) -> Seconds:
    seconds = {}
    for step, stage, problem in ((2, "evaluation", work.paper), (3, "search", work.usual)):
        parameters = work.parameters[(k + STEP * step) % POSES]
        began = perf_counter()
        pose_loss(problem, renderer, parameters)
        seconds[stage] = perf_counter() - began
    return seconds


def _run_on_gpu(work: Workload, renderer: GpuRenderer, k: int) -> Seconds:
    """Seconds for one evaluation in batches of several sizes."""
    photo, pool = work.paper.photo, RendererPool(renderer)
    batches = BATCHES[:-1] if renderer.device.is_software else BATCHES
    usual = BATCHES[0 if renderer.device.is_software else -1]
    seconds = {}
    for count in batches:
        seconds[BATCH_STAGE.format(count)] = _time_batch(
            pool, lambda one, pose: lighting_loss(one.moments(pose, photo)), work.poses, k, count
        )
    return seconds | {
        "total": seconds[BATCH_STAGE.format(usual)],
        "evaluation": _time_loss(work, work.paper, pool, k, usual),
        "search": _time_loss(work, work.usual, pool, k, usual),
    }


def _time_loss(
    work: Workload, problem: FitProblem, pool: RendererPool, k: int, count: int
) -> float:
    return _time_batch(pool, lambda one, at: pose_loss(problem, one, at), work.parameters, k, count)


def _time_batch(
    pool: RendererPool,
    task: Callable[[Renderer, Item], object],
    items: Sequence[Item],
    k: int,
    count: int,
) -> float:
    """Seconds for one of a batch."""
    batch = [items[(k + i) % POSES] for i in range(count)]
    began = perf_counter()
    list(pool.map(task, batch))
    return (perf_counter() - began) / count


def _run_batch(work: Workload, pool: RendererPool, k: int) -> Seconds:
    """Seconds for one evaluation, of a batch in which each core does as many as the others."""
    photo, count = work.paper.photo, CHUNK * pool.threads
    total = _time_batch(
        pool, lambda one, pose: lighting_loss(one.moments(pose, photo)), work.poses, k, count
    )
    rasterise = _time_batch(pool, lambda one, pose: one.covers(pose).size, work.poses, k, count)
    return {
        "rasterise": rasterise,
        "moments and loss": max(total - rasterise, 0.0),
        "total": total,
        "evaluation": _time_loss(work, work.paper, pool, k, count),
        "search": _time_loss(work, work.usual, pool, k, count),
    }


def measure(
    work: Workload, letters: str, threads: int, rounds: int, limit_s: float = math.inf
) -> list[StageTime]:
    """The times of each stage of the paths, taken in turn: what disturbs the machine hits all.

    After ``limit_s`` seconds no further of the ``rounds`` is begun, once there were
    ``LEAST_ROUNDS``; after twice as many, once there was one. The turn of a quick path begins with
    a run that does not count: it brings back into the processor's caches what the other paths have
    pushed out, as it is in a search.
    """
    samples: dict[tuple[int, str], list[float]] = defaultdict(list)
    paths = [make_path(work, letter, threads) for letter in letters]
    warm_s = [_warm(path) for path in paths]
    began = perf_counter()
    for turn in range(rounds):
        limit = limit_s if turn >= LEAST_ROUNDS else 2.0 * limit_s
        if turn and perf_counter() - began > limit:
            break
        for i, (path, took) in enumerate(zip(paths, warm_s, strict=True)):
            burst = int(np.clip(BURST_S / max(took, 1e-9), 1, LONGEST_BURST))
            if took < QUICK_S:
                path.run(turn * burst)
            for k in range(burst):
                for stage, seconds in path.run(turn * burst + k + 1).items():
                    samples[i, stage].append(1e3 * seconds)
    for path in paths:
        path.close()
    return [
        StageTime(
            paths[i].letter,
            work.model.triangles,
            work.width,
            work.height,
            paths[i].threads,
            stage,
            float(np.median(times)),
            min(times),
            max(times),
            len(times),
            len(work.model.mesh.faces),
            work.covered_px,
        )
        for (i, stage), times in samples.items()
    ]


def _warm(path: Path) -> float:
    """Warm the path up; seconds that a run takes, once its buffers are there."""

    def time(k: int) -> float:
        began = perf_counter()
        path.run(k)
        return perf_counter() - began

    took = time(0)
    if took > SLOW_S:
        return took
    took = time(1)
    return min(took, time(2)) if took < QUICK_S else took
