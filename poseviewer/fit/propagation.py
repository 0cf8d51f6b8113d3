"""Propagation of poses from the keys of a sequence to its other frames.

An object moves from frame to frame by nearly constant velocity, so a short search about the pose
that the last ones predict finds it again. The motion so far says how far from there it may be. A
track ends at the first frame whose pose is lost. Between two keys, one track leads forwards and
one backwards, and both are blended where they hold.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, takewhile
from typing import Any

import cv2
import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from poseviewer.confidence.pose_covariance import PoseCovariance, region_reach
from poseviewer.confidence.verdict import (
    LABELS,
    MIN_VISIBLE_FRACTION,
    Features,
    Verdict,
    reason_against,
    reasons_for,
)
from poseviewer.errors import PoseViewerError, percent
from poseviewer.fit.covariance import SPREAD, VISIBLE_POWER
from poseviewer.fit.judge import bare_renderer, judge_end
from poseviewer.fit.occlusion import OcclusionMask, find_occluded
from poseviewer.fit.outline import outline_support
from poseviewer.fit.point_motion import Grey, follow_points, grey_of
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss, with_min_coverage
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.search import Search, with_end
from poseviewer.fit.stages import MIN_STRUCTURE_PIXELS
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.losses.default_loss import PARTS
from poseviewer.optimise import cma_es, quadratic
from poseviewer.optimise.cma_es import CmaOptions
from poseviewer.optimise.protocol import Minimiser, State
from poseviewer.optimise.quadratic import QuadraticOptions
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import (
    Level,
    coarsest_level,
    lighter_level,
    model_mask,
    visible_fraction,
)
from poseviewer.scene.sequence import FrameStep, key_indices, neighbouring_keys, show_frame
from poseviewer.scene.settings import Limits
from poseviewer.scene.types import FramePose, PlacedModel, Scene, SceneObject, SearchResult

FIRST_DEVIATION = 0.06
"""Standard deviation of a step at unknown velocity, in radians and in radii of the model."""
MIN_DEVIATION = 0.006
"""Least standard deviation of a step about the predicted one, in the same units."""
SMOOTHING = 0.5
"""Weight of the last step in the velocity: one step alone has the errors of two poses."""
JUMP_DEVIATIONS = 5.0
"""Root mean square distance from the predicted pose from which a pose is not found."""
PRIOR_WEIGHT = 0.0002
"""Loss at one deviation of the prior where the model is visible wholly: little, as the velocity
lags behind where it changes."""
WIDE = CmaOptions(sigma=0.6, population=16, generations=16, prior_weight=0.0, min_sigma=0.1)
"""CMA-ES on the coarsest level at unknown velocity, in deviations of the prior."""
COARSE = QuadraticOptions(sampling_radius=2.0, contour_level=0.6, rounds=2)
"""Quadratic models on the coarsest level, in deviations of the prior."""
FINE = QuadraticOptions(sampling_radius=1.0, contour_level=0.3, rounds=3, growth=2.0)
"""Quadratic models on the photo, about the coarse minimum."""
STEP_LEVEL = 0.1
"""Loss above the minimum of the contour about which a single step is taken: nearer, jumps of the
loss count, and farther it is not quadratic."""
OCCLUDER_MARGIN = np.ones((9, 9), np.uint8)
"""Dilation of what stands in front: its log odds are smoothed over as many px."""
PROBE_EVERY = 5
"""Frames from one full search and verdict to the next, if the pose stays as good as it was there:
points drift where light moves over a thing without print."""
DOUBT = 0.1
"""Change of visible fraction, of edge support and of the loss's third that asks for a full one."""
NO_POSE = OutsideChartError, np.linalg.LinAlgError
"""Errors of numbers that stand for no pose."""
OF_KEY = SearchResult(verdict=Verdict("found", 1.0))
"""Result of a key that was not searched for: its user vouches for it, so it hides others."""
MIN_PROBABILITY = 0.2
"""Probability of the verdict, which knows of no motion, from which a pose where the motion led is
doubtful instead of lost."""
PLACE_ANEW = "Place it there, or later, as another key."
MAX_OPEN_RISE = 0.04
"""Unexplained share above that at the key up to which nothing stands in front."""
MAX_RISE = 0.06
"""Unexplained share above that at the key from which a pose is not found: seen from the same sides,
right tracks stay within it."""
MAX_DROP = 0.25
"""Edge support below that at the key from which a pose is not found: in blurred frames of right
tracks it falls by 0.2, and 5 % off by more."""
MAX_WRONG_RISE = 0.15
"""Unexplained share above that at the key from which a pose is lost that points do not tell, or
that is beyond ``MAX_DROP``, too."""
SURE_WITHOUT_KEY = 0.95
"""Probability by the photo alone from which its unexplained share need not be the key's, as other
sides may be explained less; a mirrored print has less."""
LIKELY = 0.5
"""Probability by the photo alone from which a pose is not lost for being unlike the key."""
LOOK_AGAIN_S = 30.0
"""Time of a search for a lost object, s: a user would wait as long before placing it anew."""
MAX_UNREAD = 5
"""Photos in a row that cannot be read, over which the motion so far leads."""
JUMP_PERCENT = 1.0
"""Distance of both ways, in % of the model's size, up to which nobody sees a jump."""


def propagate(
    scene: Scene,
    renderers: Mapping[int, Renderer],
    first: int,
    last: int,
    object_indices: Sequence[int] | None = None,
    threads: int = 1,
    known: Sequence[FrameStep] = (),
) -> Generator[FrameStep, None, None]:
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
        known: first steps, in order, of the same propagation, which was stopped after them: they
            are not searched for nor yielded again.
    """
    known_steps = iter([*known])  # the list may grow by what is yielded
    chosen = range(len(scene.objects)) if object_indices is None else object_indices
    chosen = [index for index in chosen if not scene.objects[index].locked]
    for ends in find_chains(scene, first, last, chosen):
        with closing(_Chain(scene, renderers, chosen, threads, ends, known_steps)) as chain:
            yield from chain.sweep(range(ends[0], ends[1] + 1))
            yield from chain.sweep(range(ends[1], ends[0] - 1, -1))


def mend(
    scene: Scene,
    renderers: Mapping[int, Renderer],
    key: int,
    object_index: int,
    threads: int = 1,
) -> Generator[FrameStep, None, None]:
    """Propagate an object's pose from a key outwards, in both directions, until what is found
    agrees with what was there.

    The frame in which both agree keeps its pose, which is not stale any more. A way also ends
    before the next key, before a frame without a pose, and where the object is lost.

    Args:
        scene: sequence with the key.
        renderers: renderer of the object, for one thread at a time.
        key: index of the frame with the key.
        object_index: index of the object.
        threads: number of threads; more give the same poses in less time.
    """
    item, frames = scene.objects[object_index], scene.frames
    before, after = neighbouring_keys(scene, item.id, key)
    for way in (range(key + 1, after), range(key - 1, before, -1)):
        due = [*takewhile(lambda index: item.id in frames[index].poses, way)]
        if not due:
            continue
        ends = min(key, due[-1]), max(key, due[-1])
        stale = {index for index in due if frames[index].poses[item.id].is_stale}
        with closing(_Chain(scene, renderers, [object_index], threads, ends, iter(()))) as chain:
            for step in chain.sweep(range(key, due[-1] + way.step, way.step)):
                was, now = frames[step.frame_index].poses[item.id], step.poses.get(item.id)
                is_kept = now is not None and _agrees(scene, item, was, now)
                poses = {item.id: replace(was, is_stale=False)} if is_kept else step.poses
                yield replace(step, poses=poses, lost=())
                if is_kept and step.frame_index + way.step not in stale:
                    break


def find_chains(
    scene: Scene, first: int, last: int, object_indices: Sequence[int]
) -> list[tuple[int, int]]:
    """Return the first and last frame of each chain; chains meet where all objects have keys.

    They begin beside ``first`` and end beside ``last`` where poses there are known, or else at the
    nearest key if there is none between.

    Args:
        scene: sequence with keys.
        first: index of the first frame.
        last: index of the last frame.
        object_indices: indices of the objects.
    """
    ids = [scene.objects[index].id for index in object_indices]
    keys = [set(key_indices(scene, name)) for name in ids]
    known = set[int]().union(*keys)
    first, last = max(first, 0), min(last, len(scene.frames) - 1)
    has_keys = any(first <= key <= last for key in known)
    before = [key for key in known if key < first]
    is_begun = _has_poses(scene, first, ids)
    if first not in known and _has_poses(scene, first - 1, ids):
        first -= 1
    elif not has_keys and not is_begun and before:
        first = max(before)
    if last not in known and _has_poses(scene, last + 1, ids):
        last += 1
    elif not has_keys and not is_begun and not before:
        last = min(known, default=last)
    cuts = {key for key in known.intersection(*keys) if first < key < last}
    return list(pairwise(sorted({first, last, *cuts}))) if known else []


def chain_steps(scene: Scene, ends: tuple[int, int], object_indices: Sequence[int]) -> list[int]:
    """Return the frames that a chain steps through if nothing is lost: forwards, then backwards.

    Args:
        scene: sequence with keys.
        ends: indices of the chain's first and last frame.
        object_indices: indices of the objects.
    """
    ids, begun, due = [scene.objects[index].id for index in object_indices], set[int](), list[int]()
    for index in range(ends[0], ends[1] + 1):
        known = [scene.frames[index].poses.get(name) for name in ids]
        poses = [pose for pose in known if pose is not None]
        if any(p.source == "key" or (index in ends and not p.is_stale) for p in poses):
            begun.add(index)
        if sum(pose.source == "key" for pose in poses) < len(ids):
            due.append(index)
    forwards = [index for index in due if index > min(begun, default=ends[1])]
    return forwards + [index for index in due if index < max(begun, default=ends[0])]


def _has_poses(scene: Scene, frame_index: int, ids: Sequence[str]) -> bool:
    """Tell whether a frame has poses that are not stale."""
    is_there = 0 <= frame_index < len(scene.frames)
    poses = scene.frames[frame_index].poses if is_there else {}
    return any(name in poses and not poses[name].is_stale for name in ids)


def _agrees(scene: Scene, item: SceneObject, was: FramePose, now: FramePose) -> bool:
    """Tell whether a pose that was there and one that is found are the same, within both
    accuracies; one with a worse verdict, whose accuracy is as poor, does not stay.
    """
    one, other = (pose.result or SearchResult() for pose in (was, now))
    if one.verdict and other.verdict:
        labels = one.verdict.label, other.verdict.label
        if LABELS.index(labels[0]) < LABELS.index(labels[1]):
            return False
    if one.covariance and other.covariance:
        return _compare(item, one.covariance, other.covariance)[1] is None
    old_pose, pose = (scene.views[0].pose(own.world_from_model) for own in (was, now))
    equal = item.symmetry.nearest_pose(pose, old_pose)
    return pose_error(item.mesh, equal, old_pose).percent <= JUMP_PERCENT


def _compare(
    item: SceneObject, one: PoseCovariance, other: PoseCovariance
) -> tuple[FloatArray, float | None]:
    """Return the deviation of the other pose, and their distance, in % of the model's size; None:
    within both accuracies, or nobody sees it.
    """
    equal = item.symmetry.nearest_pose(other.pose, one.pose)
    deviation = one.deviation(equal)
    spread = one.matrix + other.matrix
    apart = float(deviation @ np.linalg.lstsq(spread, deviation, rcond=None)[0]) ** 0.5
    percent = pose_error(item.mesh, equal, one.pose).percent
    is_jump = apart > region_reach(len(deviation)) and percent > JUMP_PERCENT
    return deviation, percent if is_jump else None


@dataclass(frozen=True, slots=True)
class _AtKey:
    """Looks of an object where its user has placed it: along a right track it keeps them."""

    unexplained: float
    outline: float
    """Edge support."""


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    """Motion of an object along one way."""

    mesh: Mesh
    pose: Pose
    time: float
    """Of the pose: seconds, or frames where times are not known."""
    frame_index: int
    """Index of the frame of the pose."""
    velocity: FloatArray | None = None
    """(6,): deviation of the pose in a unit of time; None: not known."""
    variance: FloatArray | None = None
    """(6,): of a pose about the predicted one."""
    at_key: _AtKey | None = None
    """Looks at the last key; None: not known."""
    probed: Features | None = None
    """Features of the last found pose with a full verdict."""
    probed_loss: float = 0.0
    """Loss of that pose."""
    age: int = 0
    """Poses since then."""
    covariance: FloatArray | None = None
    """(6, 6): of the pose; None: not known, as that of a key."""
    occluded: OcclusionMask = None
    """Pixels of the last photo on which something stood in front."""
    ignored: OcclusionMask = None
    """Pixels of the last photo that did not count."""
    unread: int = 0
    """Photos since then that could not be read."""

    @property
    def spread(self) -> float:
        """Factor of the variance: the prediction of a velocity errs in proportion to the steps."""
        return (1.0 + self.unread) ** 2

    @property
    def units(self) -> FloatArray:
        """(6,): of deviations: radians, and radii of the model."""
        radius = self.mesh.diameter / 2.0
        return np.array([1.0, 1.0, 1.0, radius, radius, radius])

    def predict(self, time: float) -> PoseCovariance:
        """Return the distribution of the pose at a time."""
        units = self.units
        variance, pose = (FIRST_DEVIATION * units) ** 2, self.pose
        if self.velocity is not None and self.variance is not None:
            pose = _deviations_about(self.mesh, pose).pose_at((time - self.time) * self.velocity)
            variance = np.clip(self.variance, (MIN_DEVIATION * units) ** 2, variance)
        return replace(_deviations_about(self.mesh, pose), matrix=np.diag(self.spread * variance))

    def prior(self, time: float, motion: PoseCovariance | None) -> _Prior:
        """Return what is known of the pose at a time, with a ``motion`` that points tell."""
        if motion is None:
            return _Prior(self.predict(time), self.velocity is None)
        least = np.diag((MIN_DEVIATION * self.units) ** 2)
        own = least if self.covariance is None else self.covariance
        told = replace(motion, matrix=own + motion.matrix)
        last = None if self.covariance is None else replace(motion, matrix=own)
        return _Prior(replace(told, matrix=told.matrix + least), told=told, last=last)

    def follow(self, pose: Pose, time: float, frame_index: int) -> _Track:
        """Go on to the pose at a time, in a frame."""
        prior = self.predict(time)
        velocity = _deviations_about(self.mesh, self.pose).deviation(pose) / (time - self.time)
        variance = prior.deviation(pose) ** 2
        if self.velocity is not None:
            velocity = SMOOTHING * velocity + (1.0 - SMOOTHING) * self.velocity
            variance = SMOOTHING * variance + (1.0 - SMOOTHING) * np.diag(prior.matrix)
        variance /= self.spread
        now = {"pose": pose, "time": time, "frame_index": frame_index}
        return replace(self, **now, velocity=velocity, variance=variance, unread=0)


@dataclass(frozen=True, slots=True, eq=False)
class _Prior:
    """Knowledge of a pose before its photo is compared."""

    poses: PoseCovariance
    """Distribution about which the search looks."""
    is_wide: bool = False
    """Whether only the last pose is known, and no motion."""
    told: PoseCovariance | None = None
    """Distribution that the last pose and points tell, whose squares are minimised with the loss:
    each says what the other does not. None: too few points."""
    last: PoseCovariance | None = None
    """Distribution that the last pose alone tells, whose axes are those of the loss's minimum;
    None: not known, or not relied on."""


_End = tuple[FitProgress, PoseCovariance | None]
"""End of a search, and the covariance of its pose."""


def _name(scene: Scene, index: int) -> str:
    """Return the name of an object, as its user knows it: its own, else its model's."""
    names = [item.name.strip() or item.model.name for item in scene.objects]
    return names[index] if names.count(names[index]) == 1 else scene.objects[index].label


def _deviations_about(mesh: Mesh, pose: Pose) -> PoseCovariance:
    return PoseCovariance(pose, mesh.centre, np.zeros((6, 6)))


class _Chain:
    """Tracks of some objects through the frames from one key to the next."""

    def __init__(
        self,
        scene: Scene,
        renderers: Mapping[int, Renderer],
        chosen: Sequence[int],
        threads: int,
        ends: tuple[int, int],
        known: Iterator[FrameStep],
    ) -> None:
        self._scene, self._ends, self._known = scene, ends, known
        self._renderers, self._threads = renderers, threads
        items = scene.objects
        self._judges = {
            index: bare_renderer(items[index].mesh, renderers[index]) for index in chosen
        }
        self._chosen = chosen
        times = [frame.time_s for frame in scene.frames]
        is_known = all(b is not None and a is not None and a < b for a, b in pairwise(times))
        self._times = (
            [float(t or 0.0) for t in times] if is_known else [*map(float, range(len(times)))]
        )
        self._tracks: dict[int, _Track] = {}
        self._forwards: dict[tuple[int, int], FramePose] = {}
        """Poses of the way forwards, by object and frame."""
        self._greys: dict[int, Grey] = {}
        """Brightness of the last photos that were followed, by frame."""
        self._reader = ThreadPoolExecutor(1, "reader")
        self._ahead = dict[int, Future[Scene]]()
        """The frame after the present one, by its index."""
        self._looks = dict[tuple[int, int], _AtKey | None]()
        """Looks at keys, by object and frame."""
        self._pools = dict[Mesh, RendererPool]()
        """Threads by what they draw, kept from frame to frame."""
        self._said = set[str]()
        """Sentences on photos that cannot be read, which both ways come to."""

    def sweep(self, frames: range) -> Iterator[FrameStep]:
        """Follow the objects through the frames, in the order of these."""
        self._tracks = {}
        for frame_index in frames:
            # A propagated pose is begun from, but for the one at which another way has ended.
            is_begin = frame_index == frames[0] and 0 < frame_index < len(self._scene.frames) - 1
            due = []
            for index in self._chosen:
                item, track = self._scene.objects[index], self._tracks.get(index)
                known = self._scene.frames[frame_index].poses.get(item.id)
                if known and (known.source == "key" or (is_begin and not known.is_stale)):
                    pose = self._scene.views[0].pose(known.world_from_model)
                    at = pose, self._times[frame_index], frame_index
                    track = track.follow(*at) if track else _Track(item.mesh, *at)
                    if (index, frame_index) not in self._looks:  # the same both ways
                        self._looks[index, frame_index] = self._look(frame_index, index)
                    track = replace(track, at_key=self._looks[index, frame_index])
                    self._tracks[index] = _at_pose(track, known.result)
                elif track is not None:
                    due.append(index)
            if not due:
                continue
            step = next(self._known, None)
            if step is not None and step.frame_index == frame_index:
                self._repeat(step, due, frames.step > 0)
            else:
                if self._threads > 1 and frame_index != frames[-1]:
                    self._read_ahead(frame_index + frames.step)
                yield self._step(frame_index, due, frames.step > 0)

    def _repeat(self, step: FrameStep, due: Sequence[int], is_forwards: bool) -> None:
        """Follow the objects that are ``due`` through a step that is known."""
        for index in due:
            track, pose = self._tracks.pop(index), step.poses.get(self._scene.objects[index].id)
            if pose is None or pose.result is None:  # lost
                continue
            if is_forwards:
                self._forwards[index, step.frame_index] = pose
            in_view = self._scene.views[0].pose(pose.world_from_model)
            track = _judged(track, pose.result)
            track = track.follow(in_view, self._times[step.frame_index], step.frame_index)
            self._tracks[index] = _at_pose(track, pose.result)

    def _step(self, frame_index: int, due: Sequence[int], is_forwards: bool) -> FrameStep:
        """Search for the objects that are ``due`` in a frame, the nearest first."""
        ahead = self._ahead.pop(frame_index, None)
        scene = show_frame(self._scene, frame_index) if ahead is None else ahead.result()
        time = self._times[frame_index]
        where = f"frame {frame_index + 1} ({self._scene.frames[frame_index].file.name}): "
        try:
            self._greys[frame_index] = grey_of(scene.views[0].photo)
        except PoseViewerError as error:
            said = self._step_over(due, str(error))
            return FrameStep(frame_index, {}, said and where + said)
        priors = dict[int, _Prior]()
        for index in due:
            motion = self._follow_points(self._tracks[index], frame_index)
            priors[index] = self._tracks[index].prior(time, motion)
            scene = scene.with_pose(index, priors[index].poses.pose)
        self._greys = {frame_index: self._greys[frame_index]}
        for index, item in enumerate(scene.objects):
            known = self._scene.frames[frame_index].poses.get(item.id)
            if known and known.source == "key" and known.result is None:
                scene = scene.with_object(index, result=OF_KEY)
        poses, notes = dict[str, FramePose](), list[str]()
        for index in sorted(due, key=lambda index: scene.model_at(index).depth):
            track, label = self._tracks.pop(index), _name(scene, index)
            if not scene.model_at(index).is_seen:
                notes.append(f"{label} is lost: its motion leads out of the photo.")
                continue
            try:
                end = self._search(scene, index, track, priors[index], time)
                scene = with_end(scene, index, end, self._renderers[index])
            except PoseViewerError as error:
                notes.append(str(error))
                continue
            except NO_POSE:
                notes.append(f"{label} is lost: it leaves the photo.")
                continue
            item, verdict = scene.objects[index], end.verdict
            assert verdict is not None
            assert item.result is not None
            if verdict.label == "lost":
                again = self._look_again(scene, index, track, priors[index])
                if again is None:
                    notes.append(f"{label} is lost: {_reason_against(verdict)} {PLACE_ANEW}")
                    continue
                (scene, end), track = again, replace(track, velocity=None, variance=None)
                item = scene.objects[index]
                assert item.result is not None
            after = _judged(track, item.result).follow(end.pose, time, frame_index)
            track = _at_pose(after, item.result)
            occluded, weights = end.problem.views[0].occluded, end.problem.photo.weights
            self._tracks[index] = replace(track, occluded=occluded, ignored=weights <= 0.0)
            # Masks of all frames would fill the memory.
            pose = FramePose(
                world_from_model=item.world_from_model,
                source="propagated",
                result=replace(item.result, hidden=()),
            )
            if is_forwards:
                self._forwards[index, frame_index] = pose
            elif (index, frame_index) in self._forwards:
                ahead = self._forwards[index, frame_index]
                pose, note = self._blend(index, frame_index, ahead, pose)
                notes += [note] if note else []
            poses[item.id] = pose
        lost = tuple(scene.objects[i].id for i in due if scene.objects[i].id not in poses)
        said = " ".join(dict.fromkeys(notes))
        return FrameStep(frame_index, poses, said and where + said, lost)

    def close(self) -> None:
        """End the threads."""
        self._reader.shutdown(cancel_futures=True)
        for pool in self._pools.values():
            pool.close()

    def _pool(self, renderer: Renderer) -> RendererPool:
        """Return threads for a renderer, the same for all of its mesh."""
        if renderer.mesh not in self._pools:
            self._pools[renderer.mesh] = RendererPool(renderer, self._threads)
        return self._pools[renderer.mesh]

    def _read_ahead(self, frame_index: int) -> None:
        """Begin to read the photo of a frame in a thread."""

        def read() -> Scene:
            scene = show_frame(self._scene, frame_index)
            with suppress(PoseViewerError):  # raised again where the photo is asked for
                _ = scene.views[0].photo
            return scene

        self._ahead = {frame_index: self._reader.submit(read)}

    def _grey(self, frame_index: int) -> Grey:
        known = self._greys.get(frame_index)
        if known is None:
            known = grey_of(show_frame(self._scene, frame_index).views[0].photo)
            self._greys[frame_index] = known
        return known

    def _follow_points(self, track: _Track, frame_index: int) -> PoseCovariance | None:
        """Return the distribution of an object's pose in a frame by its points since its last."""
        with suppress(PoseViewerError):  # the last photo may have vanished
            greys = self._grey(track.frame_index), self._grey(frame_index)
            return follow_points(*greys, PlacedModel(track.mesh, track.pose), track.ignored)
        return None

    def _step_over(self, due: Sequence[int], error: str) -> str:
        """Leave the objects to their motion in a frame whose photo cannot be read; say so."""
        for index in due:
            track = self._tracks.pop(index)
            if track.unread < MAX_UNREAD:
                self._tracks[index] = replace(track, unread=track.unread + 1)
        kept = any(index in self._tracks for index in due)
        end = "stepped over" if kept else "too many in a row, the motion is lost"
        sentence = f"{error.rstrip('.')}; {end}."
        is_new = sentence not in self._said
        self._said.add(sentence)
        return sentence if is_new else ""

    def _look_again(
        self, scene: Scene, index: int, track: _Track, prior: _Prior
    ) -> tuple[Scene, FitProgress] | None:
        """Search for a lost object as in a single photo, from its prediction and its last pose.

        Returns:
            The scene where it is found, and the end of the search; None where it is not.
        """
        own = scene.objects[index].settings
        fixed = {"free_focal": False, "free_principal_point": False}
        settings = replace(own, **fixed, limits=Limits(seconds=LOOK_AGAIN_S))
        for pose in (prior.poses.pose, track.pose):
            start = scene.with_object(index, settings=settings, result=None).with_pose(index, pose)
            search = Search(start, self._renderers, (index,), self._threads)
            with suppress(PoseViewerError, *NO_POSE):
                for now in deque(search.run(), maxlen=1):
                    end = _judge_in_film(now.progress, track.at_key)
                    if end.verdict is not None and end.verdict.label == "found":
                        found = search.scene.with_object(index, settings=own)
                        return with_end(found, index, end, self._renderers[index]), end
        return None

    def _make_problem(self, scene: Scene, index: int) -> FitProblem:
        settings = scene.objects[index].settings
        settings = replace(settings, free_focal=False, free_principal_point=False)
        return make_problem(scene.with_object(index, settings=settings), index)[0]

    def _look(self, frame_index: int, index: int) -> _AtKey | None:
        """Return the looks of an object at its pose in a frame; None where they are not told."""
        with suppress(PoseViewerError, *NO_POSE):
            problem = self._make_problem(show_frame(self._scene, frame_index), index)
            renderer, view = self._renderers[index], problem.views[0]
            if problem.loss.has_structure:
                pose = problem.chart.to_pose(problem.start)
                if problem.settings.in_front == "find":
                    view = view.without(find_occluded(view.photo, renderer, pose, is_known=True))
                photo, drawn = view.photo, model_mask(view.photo, renderer, pose)
                loss = pose_loss(replace(problem, views=(view,)), renderer, problem.start)
                outline = outline_support(photo.channels, photo.weights, drawn)
                return _AtKey(problem.scale.as_unexplained(loss), outline)
        return None

    def _search(
        self, scene: Scene, index: int, track: _Track, prior: _Prior, time: float
    ) -> FitProgress:
        """Search for an object about its predicted pose, and judge the end."""
        problem, renderer = self._make_problem(scene, index), self._renderers[index]
        view, key = problem.views[0], track.at_key
        if prior.told is not None:  # highlights and shades are followed, too, and stand still
            by_motion = track.prior(time, None)
            with suppress(PoseViewerError, *NO_POSE):  # it may lead out of the photo
                other, led = problem.chart.from_pose(by_motion.poses.pose), problem.start
                if pose_loss(problem, renderer, other) < pose_loss(problem, renderer, led):
                    prior, problem = by_motion, replace(problem, start=other)
        judge = self._judges[index]
        is_fresh = track.probed is not None and track.age < PROBE_EVERY
        if is_fresh and prior.last is not None:
            end, covariance = _search_near(problem, renderer, prior, self._pool)
            judged = self._judge(end, judge, track, prior, covariance, track.probed)
            if _stays(track, judged):
                return judged
        prior = replace(prior, last=None)
        ends = [_search_near(problem, renderer, prior, self._pool)]
        by_loss = replace(prior, told=None)
        if prior.told is not None:  # points drift, and may have led beside the minimum
            alone = _search_near(problem, renderer, by_loss, self._pool)
            ends = [_better(ends[0], alone, STEP_LEVEL)]
        is_looked_for = problem.loss.has_structure and problem.settings.in_front == "find"
        is_as_at_key = key and ends[0][0].unexplained <= key.unexplained + MAX_OPEN_RISE
        if is_looked_for and not is_as_at_key:
            mask = find_occluded(view.photo, renderer, prior.poses.pose, is_known=True)
            before, shape = track.occluded, view.photo.weights.shape
            if mask is None and before is not None and before.shape == shape:
                mask = before  # it may still be there, and only not be told
            if mask is not None:
                ends.append(self._search_behind(problem, renderer, mask, by_loss))
        # What is in front leaves a photo that is explained far better without it.
        end, covariance = _better(ends[0], ends[-1], PARTS * DOUBT)
        judging = end, judge, track, prior, covariance
        judged = self._judge(*judging, track.probed)
        is_full = track.probed is None or _stays(track, judged)
        return judged if is_full else self._judge(*judging, None)

    def _judge(
        self,
        end: FitProgress,
        renderer: Renderer,
        track: _Track,
        prior: _Prior,
        covariance: PoseCovariance | None,
        probed: Features | None,
    ) -> FitProgress:
        """Add the verdict by the photo, by the last pose with a full verdict if it is ``probed``,
        and by the film.
        """
        known_outline = 1.0 if track.at_key is None else track.at_key.outline
        how = {"is_followed": True, "known_outline": known_outline}
        judged = judge_end(end, renderer, self._threads, probed, covariance, **how)
        off = prior.poses.deviation(end.pose) / np.sqrt(np.diag(prior.poses.matrix))
        is_jump = bool(np.mean(off**2) > JUMP_DEVIATIONS**2)
        judged = _judge_in_film(judged, track.at_key, prior.told is not None, is_jump)
        is_lost = judged.verdict is not None and judged.verdict.label == "lost"
        return judged if is_lost else replace(judged, covariance=judged.covariance or covariance)

    def _search_behind(
        self, problem: FitProblem, renderer: Renderer, mask: NDArray[np.bool_], prior: _Prior
    ) -> _End:
        """Search without the pixels of a mask; return the end, and the covariance of its pose."""
        # Found to a few px: what is left of an occluder would draw the model.
        wider = np.asarray(cv2.dilate(mask.astype(np.uint8), OCCLUDER_MARGIN), bool)
        (view,) = problem.views
        around = replace(problem, views=(view.without(wider),))
        end, covariance = _search_near(around, renderer, prior, self._pool)
        return replace(end, problem=replace(problem, views=(view.without(mask),))), covariance

    def _blend(
        self, index: int, frame_index: int, ahead: FramePose, back: FramePose
    ) -> tuple[FramePose, str]:
        """Blend the poses of both ways by the nearness of their keys; note a jump between them."""
        item, view = self._scene.objects[index], self._scene.views[0]
        keys = neighbouring_keys(self._scene, item.id, frame_index)
        before, after = max(keys[0], self._ends[0]), min(keys[1], self._ends[1])
        share = (frame_index - before) / (after - before)
        nearer = ahead if share < 0.5 else back
        one, other = (way.result and way.result.covariance for way in (ahead, back))
        if nearer.result is None or one is None or other is None:
            return nearer, ""
        deviation, percent = _compare(item, one, other)
        if percent is not None:
            apart = f"both ways end {percent:.1f} % of its size apart here."
            return nearer, f"{_name(self._scene, index)}: {apart}"
        pose = one.pose_at(share * deviation)
        place = view.world_from_model(pose, ahead.world_from_model.scale)
        own = one if nearer is ahead else other
        result = replace(nearer.result, covariance=replace(own, pose=pose), chart=None)
        return replace(nearer, world_from_model=place, result=result), ""


def _judge_in_film(
    end: FitProgress, key: _AtKey | None, is_told: bool = False, is_jump: bool = False
) -> FitProgress:
    """Judge a pose by its film, too.

    Args:
        end: end of the search, with the verdict by the photo.
        key: looks at the key; None: not known.
        is_told: whether points tell the motion.
        is_jump: whether the pose is far from where its motion led.
    """
    verdict = end.verdict
    if verdict is None or not verdict.features:  # nothing of it is seen
        return end
    doubts, rise, drop, outline = list[str](), 0.0, 0.0, verdict.features["outline"]
    if is_jump:
        doubts.append("It jumped away from where its motion led.")
    if key is not None:
        rise, drop = end.unexplained - key.unexplained, key.outline - outline
        # Where it turns, other sides may be explained less.
        rise = 0.0 if verdict.probability >= SURE_WITHOUT_KEY else rise
        if drop > MAX_DROP:
            shares = f"{percent(outline)}, {percent(key.outline)} there"
            doubts.append(f"Fewer edges lie along its outline than at its key: {shares}.")
        if rise > MAX_RISE:
            shares = f"{end.unexplained:.2f} is unexplained, {key.unexplained:.2f} there"
            doubts.append(f"It explains the photo less than at its key: {shares}.")
    is_as_at_key = key is not None and not doubts
    is_likely = is_as_at_key or (verdict.probability >= MIN_PROBABILITY and not is_jump)
    is_seen = verdict.features["seen"] >= MIN_VISIBLE_FRACTION
    label = verdict.label
    is_off = rise > MAX_WRONG_RISE and (drop > MAX_DROP or not is_told)
    is_off &= verdict.probability < LIKELY
    if is_off or (rise > MAX_RISE and is_jump):
        label = "lost"
    elif label == "lost":
        label = "doubtful" if is_likely and is_seen else "lost"
    elif doubts:
        label = "doubtful"
    reasons = (*doubts, *verdict.reasons)
    return replace(end, verdict=structs.replace(verdict, label=label, reasons=reasons))


def _reason_against(verdict: Verdict) -> str:
    """Return the sentence on why a pose is lost that counted."""
    if not verdict.features:
        return verdict.reasons[0]
    features = Features(**verdict.features)
    by_photo = reasons_for(features)
    return reason_against(features) if verdict.reasons[0] in by_photo else verdict.reasons[0]


def _judged(track: _Track, result: SearchResult) -> _Track:
    """Keep the features of a found pose with a full verdict."""
    verdict = result.verdict
    if verdict is None or verdict.label != "found":
        return replace(track, probed=None)
    features, probed = Features(**verdict.features), track.probed
    if probed is not None and features.rival_margin == probed.rival_margin:
        return replace(track, age=track.age + 1)
    loss = 0.0 if result.loss is None else result.loss
    return replace(track, probed=features, probed_loss=loss, age=0)


def _at_pose(track: _Track, result: SearchResult | None) -> _Track:
    """The track with the covariance of its pose; all pixels count."""
    sure = result and result.covariance
    covariance = sure.matrix[:6, :6] if sure else None
    return replace(track, covariance=covariance, occluded=None, ignored=None)


def _stays(track: _Track, end: FitProgress) -> bool:
    """Tell whether a pose is as good as the last one with a full verdict, so that this holds."""
    probed, verdict = track.probed, end.verdict
    if probed is None or verdict is None or verdict.label != "found":
        return False
    now = verdict.features
    drop = max(probed.outline - now["outline"], probed.seen - now["seen"])
    rise = (end.loss - track.probed_loss) / (PARTS * end.problem.loss.unit)
    return track.age < PROBE_EVERY and drop < DOUBT and rise < DOUBT


def _better(one: _End, other: _End, level: float) -> _End:
    """Return the other end if its loss is lower by more than a level, else the one."""
    gain = one[0].loss - other[0].loss
    return other if gain > level * one[0].problem.loss.unit else one


def _search_near(
    problem: FitProblem,
    renderer: Renderer,
    prior: _Prior,
    pool_of: Callable[[Renderer], RendererPool],
) -> _End:
    """Search about a predicted pose; return the end, and the covariance of its pose.

    Where the axes of the last pose's minimum are known, a step along these does if it reaches one.

    Args:
        problem: problem of the object, its start where the prior is.
        renderer: renderer of the object.
        prior: knowledge of the pose.
        pool_of: gives the threads for a renderer.
    """
    photo, chart = problem.photo, problem.chart
    free = problem.free_indices
    unit = problem.loss.unit
    if photo.clipped:
        problem = with_min_coverage(problem, renderer)
    near = prior.poses.pose
    start = best = problem.start[free]
    visible = max(visible_fraction(photo, renderer, near), MIN_VISIBLE_FRACTION)

    jacobian = prior.poses.jacobian_in(chart)[free]

    def axes_of(poses: PoseCovariance) -> tuple[FloatArray, FloatArray]:
        """Deviations along the principal axes of a distribution, and these as columns."""
        variances, directions = np.linalg.eigh(jacobian @ poses.matrix @ jacobian.T)
        return np.sqrt(variances), directions

    def curvature_factor(unexplained: float, visible: float) -> float:
        """Deviation of the pose at curvature 1."""
        return SPREAD / (unexplained * visible**VISIBLE_POWER)

    deviations, directions = axes_of(prior.poses)
    axes, narrow = directions * deviations, None
    if prior.told is None:
        weight = unit * PRIOR_WEIGHT / visible ** (2.0 * VISIBLE_POWER)
    else:  # as the covariance below: the loss is a log likelihood times that
        unexplained = problem.scale.as_unexplained(pose_loss(problem, renderer, problem.start))
        factor = curvature_factor(unexplained, visible)
        weight = 0.5 * unit * factor**2
        deviations, directions = axes_of(prior.told)
        if prior.last is not None:
            lengths, last = axes_of(prior.last)
            narrow = last * lengths * (np.sqrt(2.0 * STEP_LEVEL) / factor)
    whitening = (directions / deviations).T
    evaluations, value = 0, np.inf

    def penalty(point: FloatArray) -> float:
        off = whitening @ (point - start)
        return weight * float(off @ off)

    def search(level: Level, minimise: Callable[..., State | None], scale: FloatArray) -> bool:
        """Go to the end of a minimisation on a level; tell whether it has one."""
        nonlocal best, axes, value, evaluations
        on_level = problem.on([level.photo])

        def loss(own: Renderer, point: FloatArray) -> float:
            nonlocal evaluations
            evaluations += 1
            return pose_loss(on_level, own, problem.complete(point)) + penalty(point)

        state = minimise(partial(pool_of(level.renderer).map, loss), best, scale)
        if state is None:
            return False
        best, value = state.best, state.value - penalty(state.best)
        axes = scale if state.axes is None else state.axes
        return True

    def whole(minimise: Minimiser[Any], options: Any) -> Callable[..., State]:
        return lambda *at: deque(minimise(*at, options=options.in_unit(unit)), maxlen=1)[0]

    if prior.told is None:
        coarse = coarsest_level(photo, renderer, near, MIN_STRUCTURE_PIXELS)
        wide = whole(cma_es.minimise, WIDE), whole(quadratic.minimise, COARSE)
        search(coarse, wide[not prior.is_wide], axes)
    lighter = lighter_level(photo, renderer, near)
    level = STEP_LEVEL
    step = partial(quadratic.step_along, level=unit * level)
    if narrow is None or not search(lighter, step, narrow):
        level = FINE.contour_level
        search(lighter, whole(quadratic.minimise, FINE), axes)
    parameters = problem.complete(best)
    pose = chart.to_pose(parameters)
    end = replace(
        FitProgress.at_start(problem),
        parameters=parameters,
        pose=pose,
        loss=value,
        evaluations=evaluations,
        status=Status.CONVERGED,
    )
    if not problem.loss.has_structure:
        return end, None
    visible = max(visible_fraction(photo, renderer, pose), MIN_VISIBLE_FRACTION)
    inverse = np.zeros((len(parameters),) * 2)
    inverse[np.ix_(free, free)] = axes @ axes.T / (2.0 * level)
    factor = curvature_factor(end.unexplained, visible)
    return end, PoseCovariance.from_chart(problem.mesh, pose, chart, factor**2 * inverse)
