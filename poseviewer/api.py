"""Library: load, fit, draw, map and save scenes.

::

    end = load("photo.jpg", "car.glb", "start.json").fit(seconds=60)
    print(end.verdict, end.unexplained, end.pose.camera_from_model.rotation)
    end.save("pose.json")
    end.draw("residual.png", look="residual")
    end.landscape(size=21).save("maps.png")

    shelf = load("shelf.scene.json").fit()                                    # several objects
    rig = load(views="rig.json", model="car.glb", start="start.json").fit()   # several photos

Inside poses, pixel centres are at i + 0.5; the files have OpenCV's, at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.figures.map_archive import LossMaps
from poseviewer.files.cameras import Calibration
from poseviewer.files.masks import save_pose_and_mask
from poseviewer.files.photo import photo_text, save_image
from poseviewer.files.photo_sets import LoadedViews, SetChoice
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import save_scene
from poseviewer.fit.lighting import relit
from poseviewer.fit.loss import LossScale, Unexplained
from poseviewer.fit.problem import FitProblem, make_problem, numbers_of, pose_loss
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.search import Search, SearchProgress, result_of
from poseviewer.fit.slices import Slice, landscape
from poseviewer.fit.visibility import Visibility, hiding, visibility
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.world_pose import View
from poseviewer.render.overlay import RENDER_STYLES
from poseviewer.render.overlay.styles import SOLID_OPACITY, ModelInPhoto, Picture, draw_style
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import visible_fraction
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import AttributeImage, Renderer
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import LoadedModel, SceneObject
from poseviewer.scene.types import Scene as SceneData
from poseviewer.starts.automatic import AUTOMATIC, StartQuery
from poseviewer.starts.instances import find_instances, with_instances
from poseviewer.starts.loading import (
    Start,
    StartCamera,
    StartInputs,
    open_photo,
    open_scene,
    open_views,
    pose_record,
    record_of,
)

__all__ = [
    "FitSettings",
    "LossMaps",
    "Mask",
    "PoseViewerError",
    "Scene",
    "SetChoice",
    "StartCamera",
    "load",
]

Watch = Callable[[FitProgress], Any]
Find = Callable[[StartInputs], Start]


def load(
    photo: str | Path | None = None,
    model: str | Path | LoadedModel | None = None,
    start: str | Path | Pose | Find | None = None,
    settings: FitSettings | None = None,
    *,
    views: str | Path | LoadedViews | None = None,
    view: str | None = None,
    scale: float | None = None,
    choice: SetChoice | None = None,
    calibration: Calibration | str | Path | None = None,
    box: tuple[int, int, int, int] | None = None,
    camera: StartCamera | None = None,
    instances: int = 1,
    mask: str | Path | Mask | None = None,
    renderer: Renderer | None = None,
    watch: Callable[[], object] = lambda: None,
    **changes: Any,
) -> Scene:
    """Load a scene: a photo, a model and a start; a scene file; or several photos of one thing, a
    model and a start.

    Args:
        photo: JPEG, PNG, TIFF, WebP or BMP file; or, alone, a scene file.
        model: OBJ, PLY, STL, OFF, GLB, glTF or 3DS file; or a loaded one
            (``starts.loading.load_model``), for many photos of one thing.
        start: a pose file or a pose; ``"auto"``: searched for in some seconds; or a function that
            finds one, such as ``starts.point_pairs.start_from_pairs``.
        settings: what is compared and how; parts ``without`` of a scene's objects are named with
            their ids: ``duck:beak``.
        views: photos whose cameras know their poses to one another, in place of ``photo``: our own
            set file, COLMAP's model or project, ``transforms.json``, the folder of a BOP scene; or
            a loaded set.
        view: the photo of ``views`` that the start is a pose in; default: the pose file's.
        scale: lengths of the model's unit to one of the set's; default: the set's own, else it is
            searched for.
        choice: which of the set's photos, and what else its file does not say.
        calibration: the camera and its lens: a file, or a choice among the cameras of one
            (``files.cameras.Calibration``); a distorted photo is undistorted.
        box: for ``"auto"``: a rectangle (left, top, width, height) about the object, px; default:
            the settings' region, else the whole photo.
        camera: for ``"auto"``: what is known of it; default: EXIF's focal length, or a view of 50
            degrees.
        instances: for ``"auto"``: how many of the model the photo shows; each becomes an object of
            the scene, as far as places are found.
        mask: a picture of the photo's size whose white pixels count; or ``Mask.of(weights)``, of
            weights (height, width) from 0, hidden, to 1. Default: that of the pose file.
        renderer: one of the same model, to be used again; default: a new one.
        watch: for ``"auto"``: called after every evaluation; what it raises ends the search.
        **changes: fields of the settings by name (``grey=True``, ``pixels="clip"``).

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    chosen = _chosen(settings, changes)
    if views is not None and model is not None and start is not None and not callable(start):
        return make_scene(open_views(views, model, start, chosen, view, scale, choice), renderer)
    if photo is not None and model is None and start is None:
        if chosen.free_focal:
            raise SettingsError(
                "a free focal length with a scene, whose objects share one camera; leave it out, "
                "and find it with one of them alone."
            )
        return make_scene(open_scene(photo, chosen), renderer)
    if photo is None or model is None or start is None:
        raise SettingsError(
            "wanted a photo, a model and a start; a scene file; or views, a model and a start."
        )
    if box is not None and (start != AUTOMATIC or len(box) != 4):
        raise SettingsError(
            f'box={box}: wanted (left, top, width, height), and start="auto", which it is for.'
        )
    if isinstance(calibration, str | Path):
        calibration = Calibration(Path(calibration))
    if instances < 1 or (instances > 1 and (start != AUTOMATIC or chosen.free_focal)):
        raise SettingsError(
            f"instances={instances}: wanted one, or more with "
            'start="auto" and no free focal length, as one camera shows them all.'
        )
    starts: list[Start] = []
    if start == AUTOMATIC:
        rectangle = chosen.region if box is None else Rectangle(*box)

        def likeliest(inputs: StartInputs) -> Start:
            query = StartQuery(
                inputs, (camera or StartCamera()).of(inputs.photo), rectangle, chosen
            )
            starts.extend(find_instances(query, instances, make_renderer(inputs.mesh), watch))
            return starts[0]

        start = likeliest
    if isinstance(mask, str | Path):
        chosen = replace(chosen, mask=Path(mask).name)
    data = with_instances(open_photo(photo, model, start, chosen, calibration, mask), starts[1:])
    if 0 < len(starts) < instances:
        said = f"{len(starts)} of {instances} instances: nothing else looks like one."
        data = replace(data, notes=(*data.notes, said))
    own, mesh = model.mesh if isinstance(model, LoadedModel) else None, data.objects[0].mesh
    return make_scene(data, None if mesh.left_out and mesh is not own else renderer)


def _chosen(settings: FitSettings | None, changes: dict[str, Any]) -> FitSettings:
    unknown = sorted(set(changes) - set(FitSettings.__slots__))
    if unknown:
        known = ", ".join(FitSettings.__slots__)
        raise SettingsError(f"there is no setting {unknown[0]!r}; there are {known}")
    return replace(settings or FitSettings(), **changes)


def make_scene(
    data: SceneData, renderer: Renderer | None = None, index: int | None = None, view: int = 0
) -> Scene:
    """The scene with a renderer for each mesh; ``renderer``: of the only one, or that of ``index``.

    Raises:
        PoseViewerError: the settings of its only object, or ``index``, do not go with the photos.
    """
    of_mesh = {} if renderer is None else {data.objects[index or 0].mesh: renderer}
    if index is None and len(data.objects) == 1:
        index = 0
    scene = Scene(data, of_mesh, index, view)
    for item in (data.objects[i] for i in scene.indices):
        if item.mesh not in of_mesh:
            of_mesh[item.mesh] = make_renderer(item.mesh, item.settings.renderer)
    notes = [*data.notes, *(note for i in scene.indices for note in data.objects[i].notes)]
    notes += () if index is None else scene._made[1]
    return replace(scene, notes=tuple(notes))


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Views times objects; ``scene["id"]`` is the scene about one of its objects, which pose, loss,
    verdict and maps are of.
    """

    data: SceneData
    """Views and objects, frozen."""
    renderers: Mapping[Mesh, Renderer]
    """For one thread at a time."""
    index: int | None = None
    """The object that it is about; None: all."""
    view: int = 0
    """The view whose chart is used."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how the files were read."""
    placings: Mapping[int, FitProgress] = field(default_factory=dict)
    """The end of the last search for each object that was searched for."""
    before: Scene | None = field(default=None, repr=False)
    """The scene that was searched; None: it was not."""
    _problems: dict[int, tuple[FitProblem, tuple[str, ...]]] = field(
        default_factory=dict, repr=False
    )

    @property
    def start(self) -> Scene:
        """The scene before the search."""
        return self if self.before is None else self.before

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """The models and where they are."""
        return self.data.objects

    @property
    def views(self) -> tuple[View, ...]:
        """The photos and their cameras."""
        return self.data.views

    def __getitem__(self, object_id: str) -> Scene:
        """The scene about one of its objects; raises ``SettingsError``: it has none."""
        return replace(self, index=self.data.index(object_id))

    @property
    def whole(self) -> Scene:
        """The scene about all of its objects."""
        return replace(self, index=0 if len(self.objects) == 1 else None)

    @property
    def object(self) -> SceneObject:
        """The object that it is about; raises ``SettingsError``: it is about several."""
        if self.index is None:
            ids = ", ".join(repr(item.id) for item in self.objects)
            raise SettingsError(f"the scene has several objects; say which, one of {ids}.")
        return self.objects[self.index]

    @property
    def indices(self) -> Sequence[int]:
        """Indices of the objects that it is about."""
        return range(len(self.objects)) if self.index is None else [self.index]

    @property
    def _at(self) -> int:
        return self.data.index(self.object.id)

    @property
    def settings(self) -> FitSettings:
        """The settings of the object's fits."""
        return self.object.settings

    @property
    def mesh(self) -> Mesh:
        """The object's surface."""
        return self.object.model.mesh

    @property
    def renderer(self) -> Renderer:
        """The object's, for one thread at a time."""
        return self.renderers[self.mesh]

    @property
    def photo(self) -> Photo:
        """The photo of the view whose chart is used."""
        return self.views[self.view].photo

    @property
    def pose(self) -> Pose:
        """The object's pose in the view whose chart is used."""
        return self.data.pose(self._at, self.view)

    @property
    def progress(self) -> FitProgress | None:
        """The end of the search for the object; None for a pose that was not searched for."""
        return self.placings.get(self._at)

    @property
    def _made(self) -> tuple[FitProblem, tuple[str, ...]]:
        at = self._at
        if at not in self._problems and self.progress is not None:
            self._problems[at] = self.progress.problem, ()
        elif at not in self._problems:
            self._problems[at] = make_problem(self.data, at, self.view)
        return self._problems[at]

    @property
    def problem(self) -> FitProblem:
        """The problem of fitting the object, without what a search took for something in front.

        Raises:
            PoseViewerError: the settings do not go with the photos, the model or the start.
        """
        return self._made[0]

    @property
    def parameters(self) -> FloatArray:
        """(d,): the pose in the problem's chart."""
        if self.progress is not None:
            return self.progress.parameters
        problem, scale = self.problem, self.object.world_from_model.scale
        return numbers_of(problem.chart, self.data.pose(self._at, problem.views[0].index), scale)

    def at(self, pose: Pose) -> Scene:
        """The object at another pose in the chart's view, compared with the same pixels."""
        data = self.data.with_pose(self._at, pose, self.view)
        return replace(self, data=data, placings={}, _problems={self._at: self._made})

    def comparing(self, problem: FitProblem, renderer: Renderer) -> Scene:
        """The scene whose object is compared as a ``problem`` has it, by another renderer."""
        renderers, problems = {**self.renderers, self.mesh: renderer}, {self._at: (problem, ())}
        return replace(self, renderers=renderers, placings={}, _problems=problems)

    def _search(self, threads: int) -> Search:
        renderers = {i: self.renderers[self.objects[i].mesh] for i in self.indices}
        return Search(self.data, renderers, tuple(self.indices), threads, self.view)

    def search(self, *, threads: int = 1) -> Iterator[SearchProgress]:
        """The search after every evaluation, with an object's verdict at its end; to stop, stop
        asking. More ``threads`` give the same poses in less time.
        """
        return self._search(threads).run()

    def fit(
        self,
        *,
        seconds: float | None = None,
        evaluations: int | None = None,
        watch: Watch | None = None,
        threads: int = 1,
        interruptible: bool = False,
    ) -> Scene:
        """Search to the end, or to a limit of each search, for the scene's object, or for all.

        ``watch`` is called with a ``FitProgress`` after every evaluation; what it raises ends the
        search. ``interruptible``: Ctrl-C ends it, and the best pose so far is kept.

        Raises:
            PoseViewerError: the settings do not go with an object, or nothing of it is to be seen.
        """
        search = self._limited(seconds, evaluations)._search(threads)
        now: SearchProgress | None = None
        try:
            for now in search.run():
                if watch is not None:
                    watch(now.progress)
        except KeyboardInterrupt:
            if now is None or not interruptible:
                raise
            now = search.stopped(now)
        if now is None:
            _ = self.index is None or self.problem  # says why it cannot be compared
            raise SettingsError(
                "no object of the scene is to be seen where it starts: bring them onto the photo."
            )
        pairs = zip(search.scene.objects, self.objects, strict=True)
        objects = tuple(replace(end, settings=own.settings) for end, own in pairs)
        data = replace(search.scene, objects=objects)
        return replace(self, data=data, placings=now.placings, before=self, _problems={})

    def _limited(self, seconds: float | None, evaluations: int | None) -> Scene:
        given = {"seconds": seconds, "evaluations": evaluations}
        given = {name: limit for name, limit in given.items() if limit is not None}
        data = self.data
        for index, settings in enumerate(item.settings for item in self.objects):
            limits = replace(settings.limits, **given)
            data = data.with_object(index, settings=replace(settings, limits=limits))
        return replace(self, data=data)

    @property
    def stopped(self) -> bool:
        """Whether it is what an interrupted search had found so far."""
        return any(end.status is Status.STOPPED for end in self.placings.values())

    @property
    def verdict(self) -> Verdict | None:
        """Whether the pose is right, and why; None for a pose that was not searched for."""
        return None if self.progress is None else self.progress.verdict

    @property
    def covariance(self) -> PoseCovariance | None:
        """Covariance of the pose, if it is right; None: not searched for, or lost."""
        return None if self.progress is None else self.progress.covariance

    @property
    def status(self) -> str:
        """The end of the search in a sentence."""
        return "Not searched." if self.progress is None else self.progress.status.value

    @property
    def loss(self) -> float:
        """The loss that a search minimises, the mean over the views; may take an evaluation."""
        if self.progress is not None:
            return self.progress.loss
        return pose_loss(self.problem, self.renderer, self.parameters)

    @property
    def unexplained(self) -> float:
        """The loss on the scale from 0, all of the photo is explained, to 1, nothing."""
        return self.problem.scale.unexplained(self.loss)

    @property
    def parts(self) -> Unexplained:
        """Shares that light, classes and edges leave unexplained; takes an evaluation."""
        problem = self.problem
        return problem.scale.read(self.loss, self.renderer.moments(self.pose, problem.photo))

    @property
    def hidden(self) -> NDArray[np.bool_] | None:
        """(height, width): what the search took for something in front of it; None: nothing."""
        result = self.object.result
        return result.hidden[self.view] if result is not None and result.hidden else None

    @property
    def seen(self) -> float:
        """The share of the object's pixels in the photo that count: that nothing else hides."""
        return visible_fraction(self.problem.photo, self.renderer, self.pose)

    @property
    def view_results(self) -> tuple[ViewResult, ...]:
        """The result by each compared view alone; takes an evaluation for each."""
        problems, result, at = self.problem.alone, self.object.result, self.parameters
        verdicts = () if self.verdict is None else self.verdict.views
        results = []
        verdicts = verdicts or [self.verdict] * len(problems)
        for problem, verdict in zip(problems, verdicts, strict=True):
            index, pose = problem.views[0].index, problem.chart.to_pose(at)
            loss = pose_loss(problem, self.renderer, at)
            share = result.seen[index] if result is not None and result.seen else None
            view = self.views[index]
            results.append(ViewResult(view, pose, loss, problem.scale, verdict, share))
        return tuple(results)

    @property
    def visibility(self) -> Visibility:
        """Which pixels of the chart's view show which object, and how much of each is seen."""
        return visibility([self.data.placed(i, self.view) for i in range(len(self.objects))])

    @property
    def record(self) -> PoseRecord:
        """All that a pose file says of the object in the view whose chart is used."""
        return pose_record(self._told, self._at, self.view)

    @property
    def _told(self) -> SceneData:
        """The scene with the loss, by an evaluation, of an object that was not searched for."""
        if self.index is None or self.object.result is not None:
            return self.data
        at, start = self._at, FitProgress.at_start(self.problem)
        known = replace(start, parameters=self.parameters, loss=self.loss)
        return self.data.with_object(at, result=result_of(self.data, at, known))

    def save(self, path: str | Path) -> None:
        """Write the pose file of one object in one view, else the scene file, and beside it the
        masks of what counts; each whole or not at all.

        Raises:
            PoseViewerError: the folder is missing or cannot be written to.
        """
        if self.index is not None and len(self.views) == 1:
            save_pose_and_mask(path, self.record, self.data.mask(self._at))
        else:
            save_scene(path, record_of(self._told))

    def picture(
        self, look: str = "outline", *, opacity: float = SOLID_OPACITY, view: int | None = None
    ) -> Picture:
        """(height, width, 3) RGB: the objects over a photo, by default that of the view whose chart
        is used, in one of ``overlay.RENDER_STYLES``; what is behind other objects is not drawn.

        ``opacity`` is that of the look ``solid``, in [0, 1].

        Raises:
            PoseViewerError: there is no such look; the settings do not go with an object.
        """
        if look not in RENDER_STYLES:
            raise SettingsError(
                f"there is no look {look!r}; choose one of {', '.join(RENDER_STYLES)}"
            )
        view = self.view if view is None else view
        photo = self.views[view].photo
        picture = photo.as_rgb8(photo.width, photo.height)
        for index in self.indices:
            if not self.objects[index].hidden:
                picture = replace(self, index=index)._drawn_over(picture, look, opacity, view)
        return picture

    def _drawn_over(self, picture: Picture, look: str, opacity: float, view: int) -> Picture:
        own = self.data.placed(self._at, view)
        others = [
            self.data.placed(other, view)
            for other, item in enumerate(self.objects)
            if other != self._at and not item.hidden
        ]
        in_front = hiding(own, others) if others else None
        if in_front is not None and in_front.is_whole:
            return picture

        def relight(image: AttributeImage) -> FloatArray:
            compared = self.problem.views
            photo = next((own.photo for own in compared if own.index == view), compared[0].photo)
            return relit(photo, self.renderer, own.pose, image)

        shown = ModelInPhoto(picture, own.mesh, self.renderer, own.pose, relight, opacity)
        drawn = draw_style(look, shown)
        return drawn if in_front is None else np.where(in_front.hidden[..., None], picture, drawn)

    def draw(self, path: str | Path, look: str = "outline") -> tuple[Path, ...]:
        """Write ``picture(look)`` in the format of the file's ending, of several views one for
        each, ``pose.NAME.png`` for a ``path`` ``pose.png``; which files are written.

        Raises:
            PoseViewerError: there is no such look or format, or a file cannot be written.
        """
        path, paths = Path(path), []
        for number, view in enumerate(self.views):
            stem = Path(view.name).with_suffix("").as_posix().replace("/", "-")
            name = f"{path.stem}.{stem}{path.suffix}" if len(self.views) > 1 else path.name
            paths.append(path.with_name(name))
            save_image(paths[-1], self.picture(look, view=number))
        return tuple(paths)

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
        problem = self.problem
        free = len(problem.free_indices)
        total = free * (free - 1) // 2 * size**2
        with RendererPool(self.renderer) as pool:
            slices = landscape(problem, pool, self.parameters, half_width=half_width, size=size)
            for piece in slices:
                newest[piece.first, piece.second] = piece
                if watch is not None:
                    watch(sum(int(np.isfinite(s.losses).sum()) for s in newest.values()), total)
        return self.maps_at(self.parameters, newest.values(), half_width)

    def maps_at(self, centre: FloatArray, slices: Iterable[Slice], half_width: float) -> LossMaps:
        """``slices`` about parameters (d,) as maps that can be written to files."""
        problem, name = self.problem, self.settings.loss_name
        whose = "loss" if self.settings.loss == "default" else f"loss of {name}"
        title = f"{self.photo.label}: {whose} about the pose, ±{half_width:.0%}"
        slices = tuple(slices)
        error = max((piece.error or 0.0 for piece in slices), default=0.0)
        title += f", good to {error:.1%} of each map's range" if error else ""
        chart = problem.chart
        scales, text = chart.scales(centre), photo_text(self.photo)
        return LossMaps(slices, chart.names, centre, scales, problem.scale, title, text)


@dataclass(frozen=True, slots=True, eq=False)
class ViewResult:
    """The result of an object by one view alone."""

    view: View
    pose: Pose
    loss: float
    scale: LossScale
    verdict: Verdict | None
    seen: float | None
    """Share of the object's pixels that count; None: it was not searched for."""
