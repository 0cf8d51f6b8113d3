"""poseviewer as a library: load, fit, look, map and save.

::

    case = load("photo.jpg", "car.glb", "start.json")
    found = case.fit(seconds=60)
    print(found.verdict, found.unexplained, found.pose.camera_from_model.rotation)
    found.save("pose.json")
    found.draw("residual.png", look="residual")
    found.landscape(size=21).save("maps.png")

    shelf = load_scene("shelf.scene.json").fit()       # several objects in one photo
    shelf.save("fitted.scene.json")

    rig = load_views("rig.json", "car.glb", "start.json").fit()    # one pose in several photos
    rig.save("pose.json")

Inside poses, pixel centres are at i + 0.5; the files have OpenCV's, at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.model import judge_end
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.figures.loss_maps import LossMaps
from poseviewer.files.cameras import Calibration
from poseviewer.files.masks import save_pose_and_mask
from poseviewer.files.photo import photo_text, save_image
from poseviewer.files.pose import (
    ChartParameters,
    ModelReference,
    PhotoReference,
    PoseRecord,
    RecordedVerdict,
)
from poseviewer.files.scene import SceneRecord, save_scene
from poseviewer.files.scene import load_scene as read_scene
from poseviewer.files.view_set import SetChoice, load_view_set, save_in_set, set_as_json
from poseviewer.fit.landscape import Slice, landscape
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.occlusion import behind, enlarged
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss, shown_attributes
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.registration import LoadedModel, PlacedModel, Registration
from poseviewer.fit.search import search
from poseviewer.fit.settings import FitSettings, Limits, settings_as_json
from poseviewer.fit.stages import make_stages
from poseviewer.fit.together import ModelToPlace, TogetherProgress, search_together
from poseviewer.fit.unexplained import Unexplained
from poseviewer.fit.verdict import Verdict
from poseviewer.fit.view_set import make_set_problem
from poseviewer.fit.visibility import Visibility, hiding, visibility
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_covariance import PoseCovariance
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.geometry.view_set import ViewSet
from poseviewer.render.moments import model_attributes
from poseviewer.render.overlay import LOOKS
from poseviewer.render.overlay.looks import SOLID_OPACITY, ModelInPhoto, Picture, draw_look
from poseviewer.render.pool import RendererPool
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import AttributeImage, Renderer
from poseviewer.starts.automatic import AUTOMATIC, AutoStart
from poseviewer.starts.registration import (
    Start,
    StartCamera,
    StartInputs,
    among_others,
    load_model,
    load_registration,
    load_scene_registrations,
    load_with_start,
)
from poseviewer.starts.view_set import SetRegistration, place_in_views

__all__ = [
    "Case",
    "FitResult",
    "FitSettings",
    "LossMaps",
    "Mask",
    "PoseViewerError",
    "SceneCase",
    "SetCase",
    "SetChoice",
    "SetResult",
    "StartCamera",
    "load",
    "load_scene",
    "load_views",
]

Watch = Callable[[FitProgress], Any]
Find = Callable[[StartInputs], Start]


def load(
    photo: str | Path,
    model: str | Path | LoadedModel,
    start: str | Path | Pose | Find,
    settings: FitSettings | None = None,
    *,
    calibration: Calibration | str | Path | None = None,
    box: tuple[int, int, int, int] | None = None,
    camera: StartCamera | None = None,
    mask: str | Path | Mask | None = None,
    renderer: Renderer | None = None,
    watch: Callable[[], object] = lambda: None,
    **changes: Any,
) -> Case:
    """A photo, a model and a start pose, ready to be fitted.

    Args:
        photo: JPEG, PNG, TIFF, WebP or BMP file.
        model: OBJ, PLY, STL, OFF, GLB, glTF or 3DS file; or a loaded one
            (``starts.registration.load_model``), for many photos of one thing.
        start: a pose file or a pose; ``"auto"``: searched for, which takes some seconds; or a
            function that finds one, such as ``starts.point_pairs.start_from_pairs``.
        settings: what is compared and how.
        calibration: the camera and its lens: a file, or a choice among the cameras of one
            (``files.cameras.Calibration``); a distorted photo is undistorted.
        box: for ``"auto"``: a rectangle (left, top, width, height) about the object, px; default:
            the settings' region.
        camera: for ``"auto"``: what is known of it; default: EXIF's focal length, or a view of 50
            degrees.
        mask: a picture of the photo's size whose white pixels count; or ``Mask.of(weights)``, of
            weights (height, width) from 0, hidden, to 1. Default: that of the pose file.
        watch: for ``"auto"``: called after every evaluation; what it raises ends the search.
        renderer: one of the same model, to be used again; default: a new one.
        **changes: fields of the settings by name (``grey=True``, ``pixels="clip"``).

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    chosen = _chosen(settings, changes)
    if isinstance(calibration, str | Path):
        calibration = Calibration(Path(calibration))
    if box is not None and (start != AUTOMATIC or len(box) != 4):
        raise SettingsError(
            f'box={box}: wanted (left, top, width, height), and start="auto", which it is for.'
        )
    if start == AUTOMATIC:
        rectangle = None if box is None else Rectangle(*box)
        start = AutoStart(rectangle, camera or StartCamera(), chosen, watch).find
    if isinstance(mask, str | Path):
        chosen = replace(chosen, mask=Path(mask).name)
    more = (calibration, mask, chosen.without or ())
    if isinstance(start, str | Path):
        registration = load_registration(photo, model, start, *more)
    else:
        find = (lambda _, pose=start: Start(pose, ())) if isinstance(start, Pose) else start
        opened = model if isinstance(model, LoadedModel) else Path(model)
        registration = load_with_start(Path(photo), opened, find, *more)
    own = model.mesh if isinstance(model, LoadedModel) else None
    if registration.mesh.left_out and registration.mesh is not own:
        renderer = None  # it draws the parts that are left out
    return make_case(registration, chosen, renderer)


def load_scene(path: str | Path, settings: FitSettings | None = None, **changes: Any) -> SceneCase:
    """Several objects in one photo, from a scene file; ``settings`` and ``changes`` as of ``load``,
    but that parts ``without`` are named with their object's id: ``duck:beak``.

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    chosen = _chosen(settings, changes)
    if chosen.free_focal:
        raise SettingsError(
            "a free focal length with a scene, whose objects share one camera; leave it out, and "
            "find it with one of them alone."
        )
    scene, registrations = load_scene_registrations(read_scene(path), chosen.without or ())
    of_mesh: dict[int, Renderer] = {}
    for one in registrations:
        of_mesh.setdefault(id(one.mesh), make_renderer(one.mesh, chosen.renderer))
    renderers = tuple(of_mesh[id(one.mesh)] for one in registrations)
    return SceneCase(scene, registrations, chosen, renderers, (None,) * len(registrations))


def load_views(
    views: str | Path | ViewSet,
    model: str | Path | LoadedModel,
    start: str | Path | Pose,
    settings: FitSettings | None = None,
    *,
    view: str | None = None,
    scale: float | None = None,
    choice: SetChoice | None = None,
    **changes: Any,
) -> SetCase:
    """A model in several photos of one thing, whose cameras know their poses to one another.

    Args:
        views: our own set file, COLMAP's model or project, ``transforms.json``, or the folder of a
            BOP scene; or a set that is loaded.
        model: as of ``load``.
        start: a pose file or a pose, in one of the photos.
        settings: what is compared and how.
        view: the photo that the start is a pose in; default: the one that the pose file names.
        scale: how many lengths of the model's unit one of the set's is, in place of what the set
            says. Where nobody says it, it is searched for.
        choice: which of the set's photos, and what else its file does not say.
        **changes: fields of the settings by name.

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    chosen = _chosen(settings, changes)
    read = views if isinstance(views, ViewSet) else load_view_set(views, choice)
    loaded = model if isinstance(model, LoadedModel) else load_model(model)
    loaded = replace(loaded, mesh=loaded.mesh.without(chosen.without or ()))
    placed = place_in_views(read, loaded, start, view, scale)
    return make_set_case(placed, chosen, make_renderer(loaded.mesh, chosen.renderer))


def make_set_case(placed: SetRegistration, settings: FitSettings, renderer: Renderer) -> SetCase:
    """As ``load_views``, of photos, a model and a start that are open already.

    Raises:
        PoseViewerError: the settings do not go with them.
    """
    problem = make_set_problem(placed.registrations, settings, placed.free_size, placed.scale)
    cases = [
        Case(one, settings, alone, renderer)
        for one, alone in zip(placed.registrations, problem.views, strict=True)
    ]
    return SetCase(placed, replace(cases[0], problem=problem), tuple(cases))


def _chosen(settings: FitSettings | None, changes: dict[str, Any]) -> FitSettings:
    unknown = sorted(set(changes) - set(FitSettings.__slots__))
    if unknown:
        known = ", ".join(FitSettings.__slots__)
        raise SettingsError(f"there is no setting {unknown[0]!r}; there are {known}")
    return replace(settings or FitSettings(), **changes)


def make_case(
    registration: Registration, settings: FitSettings, renderer: Renderer | None = None
) -> Case:
    """As ``load``, of a photo, a model and a start that are open already.

    Raises:
        PoseViewerError: the settings do not go with the photo, the model or the start.
    """
    problem, note = make_problem(registration, settings)
    if renderer is None:
        renderer = make_renderer(registration.mesh, settings.renderer)
    more = (f"the free-body chart is used: {note}.",) if note else ()
    return Case(registration, settings, problem, renderer, (*registration.warnings, *more))


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A photo, a model, a start, and what is to be compared."""

    registration: Registration
    settings: FitSettings
    problem: FitProblem
    renderer: Renderer
    """For one thread at a time."""
    notes: tuple[str, ...] = ()
    """What the user should know about how the files were read."""

    @property
    def start(self) -> FitResult:
        """The start pose, to be drawn, mapped, saved."""
        return self.at(self.registration.start)

    def at(self, pose: Pose) -> FitResult:
        """Any pose, to be drawn, mapped, saved."""
        return FitResult(self, pose)

    def prepare(self) -> None:
        """Make the coarser models that a search begins with, so that the first search of the model
        does not have to: a second or two.
        """
        make_stages(self.problem, self.renderer)

    def search(self, *, threads: int = 1) -> Iterator[FitProgress]:
        """The search from the start as it goes: the best pose so far after every evaluation, and
        at last the end with the verdict. To stop it, stop asking. More ``threads`` give the same
        poses in less time.
        """
        return (progress for _, progress in self._searched(threads))

    def _searched(self, threads: int) -> Iterator[tuple[Case, FitProgress]]:
        """With the case as it is compared by then: what others hide of the model is looked at again
        as it moves.
        """
        mesh, renderer, limits = self.registration.mesh, self.renderer, self.problem.limits
        if not self.registration.others:
            for progress in search(self.problem, mesh, renderer, judge_end, threads):
                yield self, progress
            return
        model = ModelToPlace(self.registration, replace(self.settings, limits=limits), renderer)
        for now in search_together([model], judge_end, threads):
            placing = now.placings[0]
            assert placing is not None  # it is the one under way
            yield replace(self, problem=placing.problem), placing.progress

    def fit(
        self,
        *,
        seconds: float | None = None,
        evaluations: int | None = None,
        watch: Watch | None = None,
        threads: int = 1,
        interruptible: bool = False,
    ) -> FitResult:
        """Search from the start to the end, or to a limit (default: the settings' own).

        ``watch`` is called with a ``FitProgress`` after every evaluation; what it raises ends the
        search. ``interruptible``: Ctrl-C ends it, and the best pose so far is kept.
        """
        limits = self.problem.limits
        limits = Limits(
            limits.evaluations if evaluations is None else evaluations,
            limits.seconds if seconds is None else seconds,
        )
        limited = replace(self, problem=replace(self.problem, limits=limits))
        case, progress = limited._end(watch, threads, interruptible)
        return FitResult(case.behind(progress.hidden), progress.pose, progress)

    def _end(
        self, watch: Watch | None, threads: int, interruptible: bool
    ) -> tuple[Case, FitProgress]:
        now: tuple[Case, FitProgress] | None = None
        try:
            for now in self._searched(threads):
                if watch is not None:
                    watch(now[1])
        except KeyboardInterrupt:
            if now is None or not interruptible:
                raise
            case, progress = now
            return case, _stopped(
                progress, case.problem, self.registration.mesh, self.renderer, threads
            )
        assert now is not None  # a fit yields at least once
        return now

    def behind(self, hidden: NDArray[np.bool_] | None) -> Case:
        """The case in which what a search took for ``hidden`` (``FitProgress.hidden``) does not
        count: it stands in the mask.
        """
        if hidden is None:
            return self
        photo, mask = self.registration.photo, self.registration.mask
        seen = ~enlarged(hidden, self.problem.photo.factor, photo.width, photo.height)
        weights = seen if mask is None else mask.weights * seen
        registration = replace(self.registration, mask=Mask.of(weights))
        return replace(self, registration=registration, problem=behind(self.problem, hidden))

    def slices(
        self,
        pose: Pose,
        *,
        half_width: float = 0.2,
        size: int = 41,
        pool: RendererPool,
    ) -> Iterator[Slice]:
        """The loss about ``pose`` for every two free parameters, coarse to fine: a pair's slice
        after every row of it. To stop, stop asking.

        Raises:
            SettingsError: ``size`` is no odd number from 3 on, ``half_width`` is not above 0, or
                fewer than two parameters are free.
        """
        centre = self.problem.chart.from_pose(pose)
        return landscape(self.problem, pool, centre, half_width=half_width, size=size)

    def maps(self, pose: Pose, slices: Iterable[Slice], half_width: float) -> LossMaps:
        """``slices`` about ``pose`` as maps that can be written to files."""
        return self.maps_at(self.problem.chart.from_pose(pose), slices, half_width)

    def maps_at(self, centre: FloatArray, slices: Iterable[Slice], half_width: float) -> LossMaps:
        """As ``maps``, about numbers (d,) of the chart."""
        photo, chart = self.registration.photo, self.problem.chart
        name = self.settings.method_name
        whose = "loss" if self.settings.method == "default" else f"loss of {name}"
        title = f"{photo.label}: {whose} about the pose, ±{half_width:.0%}"
        slices = tuple(slices)
        error = max((piece.error or 0.0 for piece in slices), default=0.0)
        title += f", good to {error:.1%} of each map's range" if error else ""
        return LossMaps(
            slices,
            chart.names,
            centre,
            chart.scales(centre),
            self.problem.scale,
            title,
            photo_text(photo),
        )


class _Searched:
    """What the end of a search says of a pose."""

    __slots__ = ()
    progress: FitProgress | None

    @property
    def stopped(self) -> bool:
        """Whether it is what an interrupted search had found so far."""
        return self.progress is not None and self.progress.status is Status.STOPPED

    @property
    def verdict(self) -> Verdict | None:
        """Whether the pose is right, and why; None for a pose that was not searched for."""
        return None if self.progress is None else self.progress.verdict

    @property
    def covariance(self) -> PoseCovariance | None:
        """How sure the pose is, if it is right; None for a pose that was not searched for, or is
        lost. Of a set: in the first photo, by all photos.
        """
        return None if self.verdict is None else self.verdict.covariance


@dataclass(frozen=True, slots=True, eq=False)
class FitResult(_Searched):
    """A pose of a case, and how good it is."""

    case: Case
    pose: Pose
    progress: FitProgress | None = None
    """How the search ended; None for a pose that was not searched for."""
    known_loss: float | None = None
    """Its loss, where that is known without a search."""

    @property
    def loss(self) -> float:
        """What the search minimised (see ``unexplained``); takes an evaluation where it is not yet
        known.
        """
        if self.progress is not None:
            return self.progress.loss
        if self.known_loss is not None:
            return self.known_loss
        problem = self.case.problem
        return pose_loss(problem, self.case.renderer, problem.chart.from_pose(self.pose))

    @property
    def unexplained(self) -> float:
        """The loss on the scale from 0, all of the photo is explained, to 1, nothing."""
        return self.case.problem.scale.unexplained(self.loss)

    @property
    def parts(self) -> Unexplained:
        """What light, classes and edges leave unexplained; takes an evaluation."""
        photo = self.case.problem.photo
        moments = self.case.renderer.moments(self.pose, photo)
        return self.case.problem.scale.read(self.loss, moments)

    @property
    def status(self) -> str:
        """How the search ended, in a sentence."""
        return "Not searched." if self.progress is None else self.progress.status.value

    @property
    def hidden(self) -> NDArray[np.bool_] | None:
        """(height, width) of the photo: what the search took for something in front of the model,
        and beside it where its outline is hidden; None where there was nothing.
        """
        photo, hidden = self.case.registration.photo, self.progress and self.progress.hidden
        if hidden is None:
            return None
        return enlarged(hidden, self.case.problem.photo.factor, photo.width, photo.height)

    @property
    def seen(self) -> float:
        """The share of the model's pixels in the photo that count: that nothing else hides."""
        photo = self.case.problem.photo
        covered = self.case.renderer.covers(level_pose(self.pose, photo.factor))
        return float(np.mean(photo.weights[covered] > 0.0)) if covered.any() else 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user of the pose should know: a sentence where its camera is a guess."""
        note = self.case.registration.photo.focal_note(self.pose.camera)
        return (note,) if note else ()

    @property
    def record(self) -> PoseRecord:
        """All that the pose file says."""
        case, loss, verdict = self.case, self.loss, None
        photo, mesh, chart = case.registration.photo, case.registration.mesh, case.problem.chart
        if self.verdict is not None:
            features = {} if self.verdict.features is None else asdict(self.verdict.features)
            verdict = RecordedVerdict(
                self.verdict.word, self.verdict.probability, self.verdict.reasons, features
            )
        channels = case.problem.photo.channels.shape[2]
        return PoseRecord(
            self.pose,
            PhotoReference(photo.name, photo.width, photo.height, photo.sha256),
            ModelReference(case.registration.mesh_name, case.registration.mesh_sha256, mesh.unit),
            ChartParameters(chart.name, chart.names, tuple(chart.from_pose(self.pose).tolist())),
            loss,
            {**settings_as_json(case.settings), "photo_channels": channels},
            {"name": "poseviewer", "version": version("poseviewer")},
            photo.undistortion,
            verdict,
            self.notes,
            case.problem.scale.unexplained(loss),
            without=mesh.left_out,
            seen=None if self.progress is None else self.seen,
            covariance=self.covariance,
            symmetry=case.registration.symmetry,
        )

    def save(self, path: str | Path) -> None:
        """Write the pose file, and the mask beside it (``car.mask.png`` for ``car.pose.json``),
        whole or not at all.

        Raises:
            PoseViewerError: the folder is missing or cannot be written to.
        """
        save_pose_and_mask(path, self.record, self.case.registration.mask)

    def picture(self, look: str = "outline", *, opacity: float = SOLID_OPACITY) -> Picture:
        """(height, width, 3) RGB: the model over the photo, in one of ``overlay.LOOKS``; what is
        behind other objects is not drawn.

        ``opacity`` is that of the look ``solid``, in [0, 1].

        Raises:
            SettingsError: there is no such look.
        """
        _require_look(look)
        photo = self.case.registration.photo
        return self.drawn_over(photo.as_rgb8(photo.width, photo.height), look, opacity)

    def drawn_over(self, picture: Picture, look: str, opacity: float) -> Picture:
        """As ``picture``, over another picture (height, width, 3) than the photo."""
        registration, renderer = self.case.registration, self.case.renderer
        view = ModelInPhoto(picture, registration.mesh, renderer, self.pose, self._relit, opacity)
        drawn = draw_look(look, view)
        if not registration.others:
            return drawn
        found = hiding(PlacedModel(registration.mesh, self.pose), registration.others)
        return np.where(found.hidden[..., None], picture, drawn)

    def _relit(self, image: AttributeImage) -> FloatArray:
        attributes = shown_attributes(self.case.problem.photo)
        lighting = recover_lighting(self.case.renderer.moments(self.pose, attributes))
        return lighting.apply(model_attributes(image, attributes))

    def draw(self, path: str | Path, look: str = "outline") -> tuple[Path, ...]:
        """Write ``picture(look)`` in the format of the file's ending; which file is written.

        Raises:
            PoseViewerError: there is no such look or format, or the file cannot be written.
        """
        return _drawn(path, self.picture(look))

    def landscape(
        self,
        *,
        half_width: float = 0.2,
        size: int = 41,
        watch: Callable[[int, int], object] | None = None,
    ) -> LossMaps:
        """The loss about the pose for every two free parameters, on all cores.

        ``watch`` is called with how many points are done, and of how many.

        Raises:
            SettingsError: ``size`` is no odd number from 3 on, or ``half_width`` not above 0.
        """
        newest: dict[tuple[int, int], Slice] = {}
        free = len(self.case.problem.free_indices)
        total = free * (free - 1) // 2 * size**2
        with RendererPool(self.case.renderer) as pool:
            for piece in self.case.slices(self.pose, half_width=half_width, size=size, pool=pool):
                newest[piece.first, piece.second] = piece
                if watch is not None:
                    watch(sum(int(np.isfinite(s.losses).sum()) for s in newest.values()), total)
        return self.case.maps(self.pose, newest.values(), half_width)


def _stopped(
    progress: FitProgress, problem: FitProblem, mesh: Mesh, renderer: Renderer, threads: int
) -> FitProgress:
    """What an interrupted search had found, with its verdict."""
    stopped = replace(progress, status=Status.STOPPED)
    return replace(stopped, verdict=judge_end(stopped, problem, mesh, renderer, threads))


@dataclass(frozen=True, slots=True, eq=False)
class SceneCase:
    """Several objects in one photo, at the poses of a scene file or where a fit has found them."""

    scene: SceneRecord
    """As it was read; its objects' order is that of all else."""
    registrations: tuple[Registration, ...]
    """Where each object is, among the others."""
    settings: FitSettings
    renderers: tuple[Renderer, ...]
    """For one thread at a time."""
    results: tuple[FitResult | None, ...]
    """How each was found; None for one that was not searched for, or stands wholly behind
    others."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about how the files were read."""
        of_objects = [note for one in self.registrations for note in one.warnings]
        return tuple(dict.fromkeys([*self.scene.warnings, *of_objects]))

    @property
    def stopped(self) -> bool:
        """Whether an interrupted search found some of it."""
        return any(result is not None and result.stopped for result in self.results)

    @property
    def visibility(self) -> Visibility:
        """Which pixels show which object, and how much of each is seen."""
        return visibility([PlacedModel(one.mesh, one.start) for one in self.registrations])

    def case(self, object_id: str) -> Case:
        """One object, to be fitted, drawn, mapped with the others where they are.

        Raises:
            PoseViewerError: there is no such object; it stands wholly behind others; the settings
                do not go with it.
        """
        index = self.scene.index(object_id)
        return make_case(self.registrations[index], self.settings, self.renderers[index])

    def search(
        self, object_id: str | None = None, *, threads: int = 1
    ) -> Iterator[TogetherProgress]:
        """The search for all objects as it goes: one after the other, the one seen most first,
        until none changes what is seen of another. Or for one among the others, until what these
        hide of it no longer changes. To stop it, stop asking.

        Raises:
            PoseViewerError: there is no such object; the settings do not go with one.
        """
        chosen = self._chosen(object_id)
        placed = [PlacedModel(one.mesh, one.start) for one in self.registrations]
        fixed = tuple(one for index, one in enumerate(placed) if index not in chosen)
        models = [
            ModelToPlace(
                replace(self.registrations[index], others=fixed),
                self.settings,
                self.renderers[index],
            )
            for index in chosen
        ]
        return search_together(models, judge_end, threads)

    def _chosen(self, object_id: str | None) -> list[int]:
        every = range(len(self.registrations))
        return [*every] if object_id is None else [self.scene.index(object_id)]

    def fit(
        self,
        object_id: str | None = None,
        *,
        watch: Callable[[FitProgress], Any] | None = None,
        threads: int = 1,
        interruptible: bool = False,
    ) -> SceneCase:
        """The same scene with all objects, or one of them, searched for from where they are.

        ``watch`` and ``interruptible`` as of ``Case.fit``; the limits of the settings are those of
        each search.

        Raises:
            PoseViewerError: as of ``case``; or nothing of the scene is to be seen.
        """
        together: TogetherProgress | None = None
        try:
            for together in self.search(object_id, threads=threads):
                if watch is not None:
                    watch(together.progress)
        except KeyboardInterrupt:
            if together is None or not interruptible:
                raise
        if together is None and object_id is not None:
            self.case(object_id)  # says why it cannot be compared
        if together is None:
            raise SettingsError(
                "no object of the scene is to be seen where it starts: bring them onto the photo."
            )
        found = {}
        for index, placing in zip(self._chosen(object_id), together.placings, strict=True):
            if placing is None:
                continue
            renderer, mesh = self.renderers[index], placing.registration.mesh
            case = Case(placing.registration, self.settings, placing.problem, renderer)
            progress = placing.progress
            if progress.status is Status.RUNNING:
                progress = _stopped(progress, placing.problem, mesh, renderer, threads)
            found[index] = FitResult(case.behind(progress.hidden), progress.pose, progress)
        return self._with(found)

    def _with(self, found: Mapping[int, FitResult]) -> SceneCase:
        registrations, results = list(self.registrations), list(self.results)
        for index, result in found.items():
            mask = result.case.registration.mask
            registrations[index] = replace(registrations[index], start=result.pose, mask=mask)
            results[index] = result
        return replace(self, registrations=among_others(registrations), results=tuple(results))

    def save(self, path: str | Path) -> None:
        """Write the scene file with the poses as they are now, and beside it the masks of objects
        in front of which a search found something; each file whole or not at all.

        Raises:
            PoseViewerError: the folder is missing or cannot be written to.
        """
        pairs = zip(self.scene.objects, self.results, strict=True)
        records, masks = [], {}
        for one, result in pairs:
            records.append(one.record if result is None else result.record)
            mask = None if result is None else result.case.registration.mask
            if mask is not None and result is not None and result.hidden is not None:
                masks[one.id] = mask
        save_scene(path, self.scene.with_records(records), masks)

    def picture(self, look: str = "outline", *, opacity: float = SOLID_OPACITY) -> Picture:
        """(height, width, 3) RGB: all objects over the photo as ``FitResult.picture`` draws one.

        Raises:
            SettingsError: there is no such look.
        """
        objects = zip(self.registrations, self.renderers, strict=True)
        return picture_of_all([(one, self.settings, made) for one, made in objects], look, opacity)

    def draw(self, path: str | Path, look: str = "outline") -> tuple[Path, ...]:
        """As ``FitResult.draw``."""
        return _drawn(path, self.picture(look))


def picture_of_all(
    objects: Sequence[tuple[Registration, FitSettings, Renderer]],
    look: str = "outline",
    opacity: float = SOLID_OPACITY,
) -> Picture:
    """(height, width, 3) RGB: objects of one photo over it, each where it starts among its others,
    as ``FitResult.picture`` draws one.

    Raises:
        PoseViewerError: there is no such look; the settings do not go with an object.
    """
    _require_look(look)
    photo = objects[0][0].photo
    picture = photo.as_rgb8(photo.width, photo.height)
    for one, settings, renderer in objects:
        if not hiding(PlacedModel(one.mesh, one.start), one.others).is_whole:
            shown = make_case(one, settings, renderer).start
            picture = shown.drawn_over(picture, look, opacity)
    return picture


@dataclass(frozen=True, slots=True, eq=False)
class SetCase:
    """A model in several photos whose cameras know their poses to one another."""

    registration: SetRegistration
    """The model in each photo that sees it; the first is the one that the start is a pose in."""
    whole: Case
    """The first photo, with the problem of all: its search is the set's."""
    views: tuple[Case, ...]
    """Each photo alone, the first one first; their problems' parameters are the set's."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about how the files were read."""
        return self.registration.notes

    @property
    def names(self) -> tuple[str, ...]:
        """Of the photos, the first one first."""
        return tuple(view.name for view in self.registration.views.views)

    @property
    def start(self) -> SetResult:
        """The start pose, to be drawn, mapped, saved."""
        return SetResult(self, self.whole.problem.start)

    def fit(
        self,
        *,
        watch: Watch | None = None,
        threads: int = 1,
        interruptible: bool = False,
    ) -> SetResult:
        """Search for the one pose from the start to the end; as of ``Case.fit``. The search as it
        goes: ``whole.search()``.
        """
        _, progress = self.whole._end(watch, threads, interruptible)
        return SetResult(self, progress.parameters, progress)


@dataclass(frozen=True, slots=True, eq=False)
class SetResult(_Searched):
    """A pose in all photos of a set, and how good it is."""

    case: SetCase
    parameters: FloatArray
    """Of the set's chart."""
    progress: FitProgress | None = None
    """How the search ended; None for a pose that was not searched for."""

    @property
    def pose(self) -> Pose:
        """In the first photo."""
        return self.case.whole.problem.chart.to_pose(self.parameters)

    @property
    def views(self) -> tuple[FitResult, ...]:
        """In each photo, with what that alone says of it; takes an evaluation for each."""
        progress, found = self.progress, []
        for index, case in enumerate(self.case.views):
            pose = case.problem.chart.to_pose(self.parameters)
            if progress is None:
                found.append(FitResult(case, pose))
                continue
            hidden = (progress.hidden, *progress.hidden_beside)
            hidden = hidden[index] if index < len(hidden) else None
            case = case.behind(hidden)
            loss = pose_loss(case.problem, case.renderer, self.parameters)
            verdicts = () if progress.verdict is None else progress.verdict.views
            verdict = verdicts[index] if verdicts else None
            own = replace(progress, pose=pose, loss=loss, verdict=verdict, hidden=hidden)
            found.append(FitResult(case, pose, own))
        return tuple(found)

    @property
    def whole(self) -> FitResult:
        """The pose in the first photo, by the loss of all: its landscape is the set's."""
        found = [replace(view.case.registration, start=view.pose) for view in self.views]
        case, free_size = self.case.whole, self.case.registration.free_size
        problem = make_set_problem(found, case.settings, free_size, 1.0 / self.size)
        case = replace(case, registration=found[0], problem=problem)
        return FitResult(case, self.pose, self.progress)

    @property
    def loss(self) -> float:
        """The mean over the photos."""
        if self.progress is not None:
            return self.progress.loss
        return pose_loss(self.case.whole.problem, self.case.whole.renderer, self.parameters)

    @property
    def unexplained(self) -> float:
        """The loss on the scale from 0, all of the photos is explained, to 1, nothing."""
        return self.case.whole.problem.scale.unexplained(self.loss)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user of the pose should know: which photo goes least with the others, where
        they do not all say that it is right.
        """
        verdicts = () if self.verdict is None else self.verdict.views
        if all(one.word == "found" for one in verdicts):
            return ()
        worst = min(range(len(verdicts)), key=lambda index: verdicts[index].probability)
        return (
            f"{self.case.names[worst]} goes least with the others: something may hide the model "
            "there, or its camera contradict theirs.",
        )

    @property
    def size(self) -> float:
        """How many lengths of the set's unit one of the model's is."""
        chart = self.case.whole.problem.chart
        assert isinstance(chart, ViewChart)  # that of every set
        return 1.0 / chart.scale_at(self.parameters)

    @property
    def set_from_model(self) -> RigidTransform:
        """The model in the set's frame, where all of it is to be made ``size`` times larger first:
        ``x_in_set = rotation @ (size x_in_model) + translation``.
        """
        place = self.pose.camera_from_model
        camera_from_set = self.case.registration.views.views[0].camera_from_set
        scaled = RigidTransform(place.rotation, self.size * place.translation)
        return camera_from_set.inverse() @ scaled

    @property
    def record(self) -> PoseRecord:
        """All that the pose file says: that of the first photo, with the set's verdict, and the
        pose in the set's frame and in each photo.
        """
        own, chart = self.case.registration, self.case.whole.problem.chart
        records = [view.record for view in self.views]
        symmetry = own.registrations[0].symmetry
        in_set = set_as_json(own.views, records, 1.0 / self.size, own.free_size, symmetry)
        verdict = None
        if self.verdict is not None:
            said = self.verdict
            verdict = RecordedVerdict(said.word, said.probability, (*said.reasons, *self.notes))
        return replace(
            records[0],
            chart=ChartParameters(chart.name, chart.names, tuple(self.parameters.tolist())),
            loss=self.loss,
            unexplained=self.unexplained,
            verdict=verdict,
            covariance=self.covariance,
            in_set=in_set,
        )

    def save(self, path: str | Path) -> None:
        """Write the pose file, and beside it the masks of its photos (``car.b.mask.png`` for photo
        ``b.jpg`` and ``car.pose.json``), each whole or not at all.

        Raises:
            PoseViewerError: the folder is missing or cannot be written to.
        """
        of_views = zip(self.case.names, self.views, strict=True)
        masks = {name: view.case.registration.mask for name, view in of_views}
        known = {name: mask for name, mask in masks.items() if mask is not None}
        save_in_set(Path(path), self.record, known)

    def draw(self, path: str | Path, look: str = "outline") -> tuple[Path, ...]:
        """Write a picture of each photo, ``found.NAME.png`` for a ``path`` ``found.png``.

        Raises:
            PoseViewerError: there is no such look or format, or a file cannot be written.
        """
        path, paths = Path(path), []
        for name, view in zip(self.case.names, self.views, strict=True):
            stem = Path(name).with_suffix("").as_posix().replace("/", "-")
            paths.append(path.with_name(f"{path.stem}.{stem}{path.suffix}"))
            view.draw(paths[-1], look)
        return tuple(paths)


def _drawn(path: str | Path, picture: Picture) -> tuple[Path, ...]:
    save_image(path, picture)
    return (Path(path),)


def _require_look(look: str) -> None:
    if look not in LOOKS:
        raise SettingsError(f"there is no look {look!r}; choose one of {', '.join(LOOKS)}")
