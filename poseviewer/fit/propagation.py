"""Propagation of poses from the keys of a sequence to its other frames.

An object moves from frame to frame by nearly constant velocity, so a short search about the pose
that the last ones predict finds it again. The motion so far says how far from there it may be. A
track ends at the first frame whose pose is lost. Between two keys, one track leads forwards and
one backwards, and both are blended where they hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import PoseViewerError
from poseviewer.fit.judge import judge_end
from poseviewer.fit.occlusion import find_occluded
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.search import with_end
from poseviewer.fit.stages import (
    LAST_MODELS,
    MIN_STRUCTURE_PIXELS,
    Stage,
    fit_pose,
    make_stages,
)
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.optimise import cma_es, quadratic
from poseviewer.optimise.cma_es import CmaOptions
from poseviewer.render.attributes import Renderer
from poseviewer.render.pyramid.levels import coarsest_level, lighter_level
from poseviewer.scene.frames import key_indices, show_frame
from poseviewer.scene.types import FramePose, Scene

FIRST_DEVIATION = 0.06
"""Standard deviation of a step at unknown velocity, in radians and in radii of the model."""
MIN_DEVIATION = 0.006
"""Least standard deviation of a step about the predicted one, in the same units."""
MAX_DOUBTFUL = 5
"""Doubtful frames in a row that a track survives."""
JUMP_DEVIATIONS = 6.0
"""Distance from the predicted pose, in standard deviations, from which a pose is not found."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameStep:
    """Poses that the propagation has found in a frame."""

    frame_index: int
    poses: Mapping[str, FramePose]
    """Propagated poses, by the objects' ids."""
    note: str = ""
    """Why a track ends here, or how far both ways are apart; "": it goes on."""


def propagate(
    scene: Scene,
    renderers: Mapping[int, Renderer],
    first: int,
    last: int,
    object_indices: Sequence[int] | None = None,
    threads: int = 1,
) -> Iterator[FrameStep]:
    """Propagate poses from all keys to the frames ``first`` to ``last``; keys stay.

    Poses go forwards after a key, and backwards before the first key. Between two keys both ways
    are blended, so a frame may come twice. Close the iterator to stop.

    Args:
        scene: sequence with keys.
        renderers: renderer of each object, for one thread at a time.
        first: index of the first frame.
        last: index of the last frame.
        object_indices: indices of the objects; None: all that are not locked.
        threads: number of threads; more give the same poses in less time.
    """
    chosen = range(len(scene.objects)) if object_indices is None else object_indices
    chosen = [index for index in chosen if not scene.objects[index].locked]
    for begin, end in split_at_keys(scene, first, last, chosen):
        chain = _Chain(scene, renderers, chosen, threads)
        yield from chain.sweep(range(begin, end + 1))
        yield from chain.sweep(range(end, begin - 1, -1))


def split_at_keys(
    scene: Scene, first: int, last: int, object_indices: Sequence[int]
) -> list[tuple[int, int]]:
    """Return the first and last frame of each chain: chains meet where all objects have keys."""
    keys = [set(key_indices(scene, scene.objects[index].id)) for index in object_indices]
    if not keys or not any(keys):
        return []
    first, last = max(first, 0), min(last, len(scene.frames) - 1)
    ends = sorted({first, last, *(k for k in set.intersection(*keys) if first < k < last)})
    return list(pairwise(ends)) if len(ends) > 1 else [(first, last)]


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    """Motion of an object along one way."""

    mesh: Mesh
    pose: Pose
    time: float
    """Of the pose: seconds, or frames where times are not known."""
    velocity: FloatArray | None = None
    """(6,): deviation of the pose in a unit of time; None: not known."""
    variance: FloatArray | None = None
    """(6,): of a pose about the predicted one."""
    doubtful: int = 0
    """Doubtful poses in a row."""

    def predict(self, time: float) -> PoseCovariance:
        """Return the distribution of the pose at a time."""
        radius = self.mesh.diameter / 2.0
        units = np.array([1.0, 1.0, 1.0, radius, radius, radius])
        variance, pose = (FIRST_DEVIATION * units) ** 2, self.pose
        if self.velocity is not None and self.variance is not None:
            pose = _deviations_about(self.mesh, pose).pose_at((time - self.time) * self.velocity)
            variance = np.clip(self.variance, (MIN_DEVIATION * units) ** 2, variance)
        return replace(_deviations_about(self.mesh, pose), matrix=np.diag(variance))

    def follow(self, pose: Pose, time: float, is_doubtful: bool = False) -> _Track:
        """Go on to the pose at a time."""
        velocity = _deviations_about(self.mesh, self.pose).deviation(pose) / (time - self.time)
        prior = self.predict(time)
        off, before = prior.deviation(pose) ** 2, np.diag(prior.matrix)
        variance = off if self.velocity is None else 0.7 * before + 0.3 * off
        doubtful = self.doubtful + 1 if is_doubtful else 0
        return _Track(self.mesh, pose, time, velocity, variance, doubtful)


def _deviations_about(mesh: Mesh, pose: Pose) -> PoseCovariance:
    return PoseCovariance(pose, mesh.centre, np.zeros((6, 6)))


class _Chain:
    """Tracks of some objects through the frames from one key to the next."""

    def __init__(
        self, scene: Scene, renderers: Mapping[int, Renderer], chosen: Sequence[int], threads: int
    ) -> None:
        self._scene, self._renderers, self._threads = scene, renderers, threads
        self._chosen = chosen
        self._forwards: dict[tuple[int, int], FramePose] = {}
        """Poses of the way forwards, by object and frame."""

    def sweep(self, frames: range) -> Iterator[FrameStep]:
        """Follow the objects through the frames, in the order of these."""
        tracks: dict[int, _Track] = {}
        for frame_index in frames:
            poses = self._scene.frames[frame_index].poses
            is_outside = frame_index == frames[0]
            due = []
            for index in self._chosen:
                known = poses.get(self._scene.objects[index].id)
                if known is not None and (known.source == "key" or is_outside):
                    tracks[index] = self._continue(tracks.get(index), index, frame_index, known)
                elif index in tracks:
                    due.append(index)
            if due:
                yield self._step(frame_index, due, tracks, frames.step)

    def _time(self, frame_index: int) -> float:
        time = self._scene.frames[frame_index].time_s
        return float(frame_index) if time is None else time

    def _continue(
        self, track: _Track | None, index: int, frame_index: int, known: FramePose
    ) -> _Track:
        pose, time = self._scene.views[0].pose(known.world_from_model), self._time(frame_index)
        mesh = self._scene.objects[index].mesh
        return _Track(mesh, pose, time) if track is None else track.follow(pose, time)

    def _step(
        self, frame_index: int, due: list[int], tracks: dict[int, _Track], direction: int
    ) -> FrameStep:
        """Search for the objects that are ``due`` in a frame, the nearest first."""
        scene, time = show_frame(self._scene, frame_index), self._time(frame_index)
        priors = {index: tracks[index].predict(time) for index in due}
        for index, prior in priors.items():
            scene = scene.with_pose(index, prior.pose)
        poses, notes = dict[str, FramePose](), list[str]()
        for index in sorted(due, key=lambda index: scene.model_at(index).depth):
            try:
                scene = self._search(scene, index, priors[index])
            except PoseViewerError as error:
                notes.append(str(error))
                del tracks[index]
                continue
            item = scene.objects[index]
            assert item.result is not None
            assert item.result.verdict is not None
            label = item.result.verdict.label
            pose = scene.pose(index)
            tracks[index] = tracks[index].follow(pose, time, label != "found")
            if label == "lost" or tracks[index].doubtful > MAX_DOUBTFUL:
                notes.append(f"{item.label} is lost: {item.result.verdict.reasons[0]}")
                del tracks[index]
                continue
            result = replace(item.result, hidden=())
            place = item.world_from_model
            new = FramePose(world_from_model=place, source="propagated", result=result)
            if direction > 0:
                self._forwards[index, frame_index] = new
            elif (index, frame_index) in self._forwards:
                new = self._forwards[index, frame_index]
            poses[item.id] = new
        return FrameStep(frame_index, poses, " ".join(notes))

    def _search(self, scene: Scene, index: int, prior: PoseCovariance) -> Scene:
        """Search for an object about its predicted pose."""
        settings = replace(
            scene.objects[index].settings,
            free_focal=False,
            free_principal_point=False,
        )
        problem, _ = make_problem(scene.with_object(index, settings=settings), index)
        renderer = self._renderers[index]
        if problem.is_structured and settings.in_front == "find":
            view = problem.views[0]
            mask = find_occluded(view.photo, renderer, prior.pose)
            problem = replace(problem, views=(view.without(mask),))
        *_, end = fit_pose(problem, renderer, self._threads, make=_stages)
        return with_end(scene, index, judge_end(end, renderer, self._threads), renderer)


def _stages(problem: FitProblem, renderer: Renderer, start: FloatArray) -> tuple[Stage, ...]:
    if not problem.is_structured:
        return make_stages(problem, renderer, start)
    pose = problem.chart.to_pose(start)
    coarse = coarsest_level(problem.photo, renderer, pose, MIN_STRUCTURE_PIXELS)
    light = lighter_level(problem.photo, renderer, pose)
    first = CmaOptions(sigma=0.03, population=16, generations=12, prior_weight=0.5, min_sigma=4e-3)
    last = replace(LAST_MODELS, rounds=3)
    return (
        Stage((coarse,), cma_es.minimise, first, rescore_every=np.inf),
        Stage((light,), quadratic.minimise, last, along_axes=True),
    )
