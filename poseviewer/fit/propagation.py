"""Propagation of poses from the keys of a sequence to its other frames.

An object moves from frame to frame by nearly constant velocity, so a short search about the pose
that the last ones predict finds it again. The motion so far says how far from there it may be. A
track ends at the first frame whose pose is lost. Between two keys, one track leads forwards and
one backwards, and both are blended where they hold.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from msgspec import structs

from poseviewer.confidence.pose_covariance import PoseCovariance, region_reach
from poseviewer.confidence.verdict import MIN_VISIBLE_FRACTION, Features, Verdict
from poseviewer.errors import PoseViewerError
from poseviewer.fit.covariance import SPREAD, VISIBLE_POWER
from poseviewer.fit.judge import judge_end
from poseviewer.fit.occlusion import OcclusionMask, find_occluded
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss, with_min_coverage
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.search import with_end
from poseviewer.fit.stages import MIN_STRUCTURE_PIXELS
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.losses.default_loss import PARTS
from poseviewer.optimise import cma_es, quadratic
from poseviewer.optimise.cma_es import CmaOptions
from poseviewer.optimise.protocol import Minimiser
from poseviewer.optimise.quadratic import QuadraticOptions
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, coarsest_level, lighter_level, visible_fraction
from poseviewer.scene.sequence import key_indices, neighbouring_keys, show_frame
from poseviewer.scene.types import FramePose, Scene, SearchResult

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
OCCLUDER_MARGIN = np.ones((9, 9), np.uint8)
"""Dilation of what stands in front: its log odds are smoothed over as many px."""
PROBE_EVERY = 6
"""Frames from one full verdict to the next, if the pose stays as good as it was there."""
DOUBT = 0.1
"""Change of visible fraction, of edge support and of the loss's third that asks for a full one."""
OF_KEY = SearchResult(verdict=Verdict("found", 1.0))
"""Result of a key that was not searched for: its user vouches for it, so it hides others."""
MIN_PROBABILITY = 0.2
"""Probability of the verdict, which knows of no motion, from which a pose where the motion led is
doubtful instead of lost."""
MAX_DOUBTFUL = 5
"""Doubtful poses in a row that a track survives."""
JUMP_PERCENT = 1.0
"""Distance of both ways, in % of the model's size, up to which nobody sees a jump."""


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
    """
    chosen = range(len(scene.objects)) if object_indices is None else object_indices
    chosen = [index for index in chosen if not scene.objects[index].locked]
    for ends in find_chains(scene, first, last, chosen):
        chain = _Chain(scene, renderers, chosen, threads, ends)
        yield from chain.sweep(range(ends[0], ends[1] + 1))
        yield from chain.sweep(range(ends[1], ends[0] - 1, -1))


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


def _has_poses(scene: Scene, frame_index: int, ids: Sequence[str]) -> bool:
    """Tell whether a frame has poses that are not stale."""
    is_there = 0 <= frame_index < len(scene.frames)
    poses = scene.frames[frame_index].poses if is_there else {}
    return any(name in poses and not poses[name].is_stale for name in ids)


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
    probed: Features | None = None
    """Features of the last found pose with a full verdict."""
    probed_loss: float = 0.0
    """Loss of that pose."""
    age: int = 0
    """Poses since then."""
    occluded: OcclusionMask = None
    """Pixels of the last photo on which something stood in front."""

    def predict(self, time: float) -> PoseCovariance:
        """Return the distribution of the pose at a time."""
        radius = self.mesh.diameter / 2.0
        units = np.array([1.0, 1.0, 1.0, radius, radius, radius])
        variance, pose = (FIRST_DEVIATION * units) ** 2, self.pose
        if self.velocity is not None and self.variance is not None:
            pose = _deviations_about(self.mesh, pose).pose_at((time - self.time) * self.velocity)
            variance = np.clip(self.variance, (MIN_DEVIATION * units) ** 2, variance)
        return replace(_deviations_about(self.mesh, pose), matrix=np.diag(variance))

    def follow(self, pose: Pose, time: float) -> _Track:
        """Go on to the pose at a time."""
        prior = self.predict(time)
        velocity = _deviations_about(self.mesh, self.pose).deviation(pose) / (time - self.time)
        variance = prior.deviation(pose) ** 2
        if self.velocity is not None:
            velocity = SMOOTHING * velocity + (1.0 - SMOOTHING) * self.velocity
            variance = SMOOTHING * variance + (1.0 - SMOOTHING) * np.diag(prior.matrix)
        return replace(self, pose=pose, time=time, velocity=velocity, variance=variance)


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
    ) -> None:
        self._scene, self._ends = scene, ends
        self._renderers, self._threads = renderers, threads
        self._chosen = chosen
        times = [frame.time_s for frame in scene.frames]
        is_known = all(b is not None and a is not None and a < b for a, b in pairwise(times))
        self._times = (
            [float(t or 0.0) for t in times] if is_known else [*map(float, range(len(times)))]
        )
        self._tracks: dict[int, _Track] = {}
        self._forwards: dict[tuple[int, int], FramePose] = {}
        """Poses of the way forwards, by object and frame."""

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
                    at = self._scene.views[0].pose(known.world_from_model), self._times[frame_index]
                    self._tracks[index] = track.follow(*at) if track else _Track(item.mesh, *at)
                elif track is not None:
                    due.append(index)
            if due:
                yield self._step(frame_index, due, frames.step > 0)

    def _step(self, frame_index: int, due: Sequence[int], is_forwards: bool) -> FrameStep:
        """Search for the objects that are ``due`` in a frame, the nearest first."""
        scene, time = show_frame(self._scene, frame_index), self._times[frame_index]
        priors = {index: self._tracks[index].predict(time) for index in due}
        for index, prior in priors.items():
            scene = scene.with_pose(index, prior.pose)
        for index, item in enumerate(scene.objects):
            known = self._scene.frames[frame_index].poses.get(item.id)
            if known and known.source == "key" and known.result is None:
                scene = scene.with_object(index, result=OF_KEY)
        poses, notes = dict[str, FramePose](), list[str]()
        name = self._scene.frames[frame_index].file.name
        for index in sorted(due, key=lambda index: scene.model_at(index).depth):
            track, label = self._tracks.pop(index), scene.objects[index].label
            if not scene.model_at(index).is_seen:
                notes.append(f"{label} is lost in {name}: its motion leads out of the photo.")
                continue
            try:
                end = self._search(scene, index, track, priors[index])
                scene = with_end(scene, index, end, self._renderers[index])
            except PoseViewerError as error:
                notes.append(str(error))
                continue
            except (OutsideChartError, np.linalg.LinAlgError):
                notes.append(f"{label} is lost in {name}: it leaves the photo.")
                continue
            item, verdict = scene.objects[index], end.verdict
            assert verdict is not None
            assert item.result is not None
            doubtful = 0 if verdict.label == "found" else track.doubtful + 1
            if verdict.label == "lost" or doubtful > MAX_DOUBTFUL:
                notes.append(f"{item.label} is lost in {name}: {verdict.share_right}.")
                continue
            track = replace(_keep_features(track, end), doubtful=doubtful)
            track = replace(track, occluded=end.problem.views[0].occluded)
            self._tracks[index] = track.follow(end.pose, time)
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
        return FrameStep(frame_index, poses, " ".join(dict.fromkeys(notes)))

    def _search(
        self, scene: Scene, index: int, track: _Track, prior: PoseCovariance
    ) -> FitProgress:
        """Search for an object about its predicted pose, and judge the end."""
        settings = scene.objects[index].settings
        settings = replace(settings, free_focal=False, free_principal_point=False)
        problem, _ = make_problem(scene.with_object(index, settings=settings), index)
        renderer, view = self._renderers[index], problem.views[0]
        masks: list[OcclusionMask] = [None]
        if problem.loss.has_structure and settings.in_front == "find":
            mask = find_occluded(view.photo, renderer, prior.pose)
            masks = [mask]
            before, shape = track.occluded, view.photo.weights.shape
            if mask is None and before is not None and before.shape == shape:
                masks.append(before)  # it may still be there, and only not be told
        ends = [self._search_behind(problem, renderer, mask, track, prior) for mask in masks]
        # An occluder that is gone leaves a photo that is explained as well without its mask.
        return (
            ends[0]
            if ends[0].loss <= ends[-1].loss + PARTS * problem.loss.unit * DOUBT
            else ends[-1]
        )

    def _search_behind(
        self,
        problem: FitProblem,
        renderer: Renderer,
        mask: OcclusionMask,
        track: _Track,
        prior: PoseCovariance,
    ) -> FitProgress:
        """Search without the pixels of a mask, and judge the end."""
        view, how = problem.views[0], (prior, self._threads, track.velocity is None)
        problem = replace(problem, views=(view.without(mask),))
        if mask is None:
            end, covariance = _search_near(problem, renderer, *how)
        else:  # found to a few px: what is left of an occluder would draw the model
            wider = np.asarray(cv2.dilate(mask.astype(np.uint8), OCCLUDER_MARGIN), bool)
            around = replace(problem, views=(view.without(wider),))
            end, covariance = _search_near(around, renderer, *how)
            end = replace(end, problem=problem)
        judging = renderer, self._threads
        judged = judge_end(end, *judging, track.probed, covariance)
        if track.probed is not None and not _stays(track, judged):
            judged = judge_end(end, *judging, None, covariance)
        off, verdict = prior.deviation(end.pose) / np.sqrt(np.diag(prior.matrix)), judged.verdict
        is_jump = np.mean(off**2) > JUMP_DEVIATIONS**2
        if verdict is not None and verdict.label == "found" and is_jump:
            reason = "It jumped away from where its motion led."
            verdict = structs.replace(verdict, label="doubtful", reasons=(reason, *verdict.reasons))
        is_likely = verdict is not None and verdict.probability >= MIN_PROBABILITY and not is_jump
        if verdict is not None and verdict.label == "lost" and is_likely:
            verdict = structs.replace(verdict, label="doubtful")
            judged = replace(judged, covariance=covariance)
        return replace(judged, verdict=verdict)

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
        equal = item.symmetry.nearest_pose(other.pose, one.pose)
        deviation = one.deviation(equal)
        spread = one.matrix + other.matrix
        apart = float(deviation @ np.linalg.lstsq(spread, deviation, rcond=None)[0]) ** 0.5
        percent = pose_error(item.mesh, equal, one.pose).percent
        if apart > region_reach(len(deviation)) and percent > JUMP_PERCENT:
            note = f"{item.label}: both ways end {percent:.1f} % of its size apart here."
            return nearer, note
        pose = one.pose_at(share * deviation)
        place = view.world_from_model(pose, ahead.world_from_model.scale)
        own = one if nearer is ahead else other
        result = replace(nearer.result, covariance=replace(own, pose=pose), chart=None)
        return replace(nearer, world_from_model=place, result=result), ""


def _keep_features(track: _Track, end: FitProgress) -> _Track:
    """Keep the features of a found pose with a full verdict."""
    assert end.verdict is not None
    if end.verdict.label != "found":
        return replace(track, probed=None)
    features = Features(**end.verdict.features)
    probed = track.probed
    if probed is not None and features.turn_margin == probed.turn_margin:
        return replace(track, age=track.age + 1)
    return replace(track, probed=features, probed_loss=end.loss, age=0)


def _stays(track: _Track, end: FitProgress) -> bool:
    """Tell whether a pose is as good as the last one with a full verdict, so that this holds."""
    probed, verdict = track.probed, end.verdict
    if probed is None or verdict is None or verdict.label != "found":
        return False
    now = verdict.features
    drop = max(probed.outline - now["outline"], probed.seen - now["seen"])
    rise = (end.loss - track.probed_loss) / (PARTS * end.problem.loss.unit)
    return track.age < PROBE_EVERY and drop < DOUBT and rise < DOUBT


def _search_near(
    problem: FitProblem, renderer: Renderer, prior: PoseCovariance, threads: int, is_wide: bool
) -> tuple[FitProgress, PoseCovariance | None]:
    """Search about a predicted pose; return the end, and the covariance of its pose."""
    photo, chart = problem.photo, problem.chart
    free = problem.free_indices
    unit = problem.loss.unit
    if photo.clipped:
        problem = with_min_coverage(problem, renderer)
    variances, directions = np.linalg.eigh(prior.in_chart(chart)[np.ix_(free, free)])
    start = best = problem.start[free]
    visible = max(visible_fraction(photo, renderer, prior.pose), MIN_VISIBLE_FRACTION)
    weight = unit * PRIOR_WEIGHT / visible ** (2.0 * VISIBLE_POWER)
    scale = axes = directions * np.sqrt(variances)
    whitening = np.linalg.inv(scale)
    evaluations, value = 0, np.inf

    def search(level: Level, minimise: Minimiser[Any], options: Any) -> None:
        nonlocal best, axes, value, evaluations
        on_level = problem.on([level.photo])

        def loss(own: Renderer, point: FloatArray) -> float:
            nonlocal evaluations
            evaluations += 1
            off = whitening @ (point - start)
            own_loss = pose_loss(on_level, own, problem.complete(point))
            return own_loss + weight * float(off @ off)

        with RendererPool(level.renderer, threads) as pool:
            *_, state = minimise(partial(pool.map, loss), best, axes, options.in_unit(unit))
        best, value = state.best, state.value
        axes = axes if state.axes is None else state.axes

    coarse = coarsest_level(photo, renderer, prior.pose, MIN_STRUCTURE_PIXELS)
    search(coarse, *((cma_es.minimise, WIDE) if is_wide else (quadratic.minimise, COARSE)))
    search(lighter_level(photo, renderer, prior.pose), quadratic.minimise, FINE)
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
    factor = SPREAD / (end.unexplained * visible**VISIBLE_POWER)
    whole = np.zeros((len(parameters),) * 2)
    whole[np.ix_(free, free)] = factor**2 * axes @ axes.T / (2.0 * FINE.contour_level)
    return end, PoseCovariance.from_chart(problem.mesh, pose, chart, whole)
