"""Library: load, fit, draw, map and save.

::

    result = load("photo.jpg", "car.glb", "start.json").fit(seconds=60)
    print(result.verdict, result.unexplained, result.pose.camera_from_model.rotation)
    result.save("pose.json")
    result.draw("residual.png", look="residual")
    result.landscape(size=21).save("maps.png")

    shelf = load("shelf.scene.json").fit()  # several objects
    rig = load("rig.json", "car.glb", "start.json").fit()  # several photos
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError as PoseViewerError
from poseviewer.errors import SettingsError, list_names
from poseviewer.figures.map_archive import LossMaps
from poseviewer.files.cameras import Calibration
from poseviewer.files.formats.gltf_export import save_painting
from poseviewer.files.image_sequence import load_sequence
from poseviewer.files.masks import MaskFile, save_pose_and_masks
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import as_saved, pose_json, save_scene
from poseviewer.files.writing import safe_path
from poseviewer.fit.lighting import render_relit
from poseviewer.fit.painting import paint_object
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss, pose_to_params
from poseviewer.fit.progress import FitProgress, SearchProgress, Status
from poseviewer.fit.propagation import propagate
from poseviewer.fit.search import Search, make_search_result
from poseviewer.fit.slices import Slice, landscape
from poseviewer.fit.stages import StageMaker, make_stages
from poseviewer.fit.view_results import ViewResult, results_by_view
from poseviewer.fit.visibility import Visibility, make_occlusion, visibility
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.losses.loss import Unexplained
from poseviewer.opening.photo_sets import LoadedViews, SetChoice
from poseviewer.opening.scenes import open_scene, with_key
from poseviewer.opening.sources import Sources, name_sources
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.overlay import LOOKS
from poseviewer.render.overlay.styles import SOLID_OPACITY, ModelInPhoto, Picture, draw_style
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import visible_fraction
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.sequence import FrameStep, require_keys, store_poses
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene, SceneObject
from poseviewer.starts.automatic import AUTOMATIC, propose_about
from poseviewer.starts.instances import AutoStart
from poseviewer.starts.start import FindStart
from poseviewer.starts.start import StartCamera as StartCamera


def load(
    photo: str | Path | LoadedViews,
    model: str | Path | ModelFile | None = None,
    start: str | Path | Pose | AutoStart | FindStart | None = None,
    settings: FitSettings | None = None,
    *,
    choice: SetChoice | None = None,
    calibration: Calibration | str | Path | None = None,
    mask: str | Path | MaskFile | Mask | None = None,
    renderer: Renderer | None = None,
    **changes: Any,
) -> Registration:
    """Load a photo, or several photos of one thing, with a model and a start; or a scene file.

    Args:
        photo: JPEG, PNG, TIFF, WebP or BMP file; a set of photos whose cameras know their poses to
            one another: our own set file, COLMAP's model or project, ``transforms.json``, the
            folder of a BOP scene, or a loaded set; or, alone, a scene file.
        model: OBJ, PLY, STL, OFF, GLB, glTF, 3MF, DAE, 3DS or STEP file; or a loaded one
            (``files.scene_assets.load_model``), for many photos of one thing.
        start: pose file, or pose; ``"auto"`` or an ``AutoStart``: searched for in some seconds; or
            a function that finds one, such as ``starts.point_pairs.start_from_pairs``.
        settings: what is compared and how; parts ``without`` of a scene's objects are named with
            their ids: ``duck:beak``.
        choice: photos of a set to use, the one that the start is a pose in, and the set's scale.
        calibration: camera and lens of the photo: a file, or a choice among the cameras of one
            (``files.cameras.Calibration``); a distorted photo is undistorted.
        mask: picture of the photo's size whose white pixels count; an annotation (COCO, Labelme),
            with its object's label as ``files.masks.MaskFile``; or ``Mask.of(weights)``, of weights
            (height, width) from 0, hidden, to 1; default: that of the pose file.
        renderer: renderer of the same model, to be used again; default: a new one.
        **changes: fields of the settings by name (``grey=True``, ``pixels="clip"``).

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    if unknown := sorted(set(changes) - set(FitSettings.__slots__)):
        known = ", ".join(FitSettings.__slots__)
        raise SettingsError(f"there is no setting {unknown[0]!r}; there are {known}")
    settings = replace(settings or FitSettings(), **changes)
    start = AutoStart() if start == AUTOMATIC else start
    if isinstance(calibration, str | Path):
        calibration = Calibration(Path(calibration))
    mask = MaskFile(Path(mask)) if isinstance(mask, str | Path) else mask
    more = {"choice": choice, "calibration": calibration, "mask": mask, "settings": settings}
    sources = name_sources(photo, model, start, **more)
    if sources.scene is None and (model is None or start is None):
        raise SettingsError("wanted a photo, or several, with a model and a start; or a scene.")
    return make_registration(open_scene(sources), renderer)


def load_frames(
    frames: str | Path,
    model: str | Path | ModelFile,
    keys: Mapping[int, str | Path | Pose],
    *,
    every: int = 1,
    calibration: Calibration | str | Path | None = None,
    **changes: Any,
) -> Registration:
    """Load a video or a folder of frames as a sequence, with the poses of a model in some of them.

    Args:
        frames: video, or folder of images.
        model: file, or loaded model.
        keys: pose files or poses by the frames' indices, which count those that are taken.
        every: take the first frame, and every N-th after it.
        calibration: camera and lens of all frames, as of ``load``.
        **changes: fields of the settings by name.

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    if not keys:
        raise SettingsError("no keys; wanted a pose in one of the frames.")
    if isinstance(calibration, str | Path):
        calibration = Calibration(Path(calibration))
    poses = {index: one if isinstance(one, Pose) else Path(one) for index, one in keys.items()}
    sources = Sources(
        frames=load_sequence(frames, every),
        model=Path(model) if isinstance(model, str) else model,
        keys=poses,
        calibration=calibration,
        settings=replace(FitSettings(), **changes),
    )
    return make_registration(open_scene(sources))


def make_registration(
    scene: Scene, renderer: Renderer | None = None, object_index: int | None = None
) -> Registration:
    """Make the registration of one object, by default of the only one or of all. A ``renderer`` of
    one of the meshes is used again.

    Raises:
        PoseViewerError: the settings of the object do not go with the photos.
    """
    if object_index is None and len(scene.objects) == 1:
        object_index = 0
    renderers = {} if renderer is None else {renderer.mesh: renderer}
    registration = Registration(scene, renderers, object_index)
    notes, problems = [*scene.notes], {}
    for item in (scene.objects[i] for i in registration.indices):
        _add_renderers(renderers, item)
        notes += item.notes
        if not item.is_placed:
            notes.append(f"{item.label} is not placed: no search moves it.")
    if object_index is not None:
        problems[object_index], of_chart = make_problem(scene, object_index)
        notes += of_chart
    return replace(registration, notes=tuple(notes), _problems=problems)


def _add_renderers(renderers: dict[Mesh, Renderer], item: SceneObject) -> None:
    """Add renderers of an object's surfaces: the model's, and those of its paint."""
    for mesh in {item.mesh, item.drawn_mesh, item.compared_mesh} - {*renderers}:
        renderers[mesh] = make_renderer(mesh, item.settings.renderer)


@dataclass(frozen=True, slots=True, eq=False)
class PosedScene:
    """Views times objects at their poses; ``["id"]`` is about one of the objects alone."""

    scene: Scene
    """Views and objects, frozen."""
    renderers: Mapping[Mesh, Renderer]
    """Renderers for one thread at a time."""
    object_index: int | None = None
    """Index of the object that it is about; None: all."""
    view_index: int = 0
    """Index of the view whose chart is used."""
    _problems: dict[int, FitProblem] = field(default_factory=dict, repr=False)
    data = property(attrgetter("scene"), doc="``scene``.")
    objects = property(attrgetter("scene.objects"), doc="``scene.objects``.")
    views = property(attrgetter("scene.views"), doc="``scene.views``.")
    settings = property(attrgetter("object.settings"), doc="``object.settings``.")
    mesh = property(attrgetter("object.mesh"), doc="``object.mesh``.")
    renderer = property(
        lambda self: self.renderers[self.object.compared_mesh], doc="Renderer of the object."
    )
    photo = property(
        lambda self: self.views[self.view_index].photo, doc="Photo of the view whose chart is used."
    )

    def __getitem__(self, object_id: str) -> Self:
        """Give the part about one object.

        Raises:
            SettingsError: there is no object of that id.
        """
        return replace(self, object_index=self.scene.index(object_id))

    @property
    def whole(self) -> Self:
        """The part about all objects."""
        return replace(self, object_index=0 if len(self.objects) == 1 else None)

    @property
    def indices(self) -> Sequence[int]:
        """Indices of the objects that it is about."""
        return range(len(self.objects)) if self.object_index is None else [self.object_index]

    @property
    def _index(self) -> int:
        if self.object_index is None:
            ids = ", ".join(repr(item.id) for item in self.objects)
            raise SettingsError(f"the scene has several objects; say which, one of {ids}.")
        return self.object_index

    @property
    def object(self) -> SceneObject:
        """The object that it is about.

        Raises:
            SettingsError: there are several.
        """
        return self.objects[self._index]

    @property
    def pose(self) -> Pose:
        """Pose of the object in the view whose chart is used."""
        return self.scene.pose(self._index, self.view_index)

    @property
    def progress(self) -> FitProgress | None:
        """End of a search for the object; None: there was no search."""
        return None

    @property
    def problem(self) -> FitProblem:
        """The problem of fitting the object, without pixels that a search took for occluders.

        Raises:
            PoseViewerError: the settings do not go with the photos, the model or the start.
        """
        if self.progress is not None:
            return self.progress.problem
        index = self._index
        if index not in self._problems:
            self._problems[index] = make_problem(self.scene, index, self.view_index)[0]
        return self._problems[index]

    @property
    def parameters(self) -> FloatArray:
        """(d,): parameters of the pose in the problem's chart; after a search, those of its end."""
        if self.progress is not None:
            return self.progress.parameters
        problem, scale = self.problem, self.object.world_from_model.scale
        pose = self.scene.pose(self._index, problem.views[0].view_index)
        return pose_to_params(problem.chart, pose, scale)

    @property
    def loss(self) -> float:
        """Loss that a search minimises, the mean over the views; evaluated unless a search did."""
        if self.progress is not None:
            return self.progress.loss
        return pose_loss(self.problem, self.renderer, self.parameters)

    @property
    def unexplained(self) -> float:
        """The loss as unexplained share of the photo, in [0, 1]; 0: all is explained."""
        return self.problem.scale.as_unexplained(self.loss)

    @property
    def parts(self) -> Unexplained:
        """Unexplained shares by lighting, classes and edges; takes an evaluation."""
        problem = self.problem
        return problem.scale.read(self.loss, self.renderer.moments(self.pose, problem.photo))

    @property
    def visibility(self) -> Visibility:
        """Pixels of the chart's view that show each object, and each object's visible fraction."""
        models = (self.scene.model_at(i, self.view_index) for i in range(len(self.objects)))
        return visibility([*models])

    def at(self, pose: Pose) -> Registration:
        """Put the object at another pose in the chart's view, compared with the same pixels."""
        scene = self.scene.with_pose(self._index, pose, self.view_index)
        scene = scene.with_object(self._index, doubt="")
        where = self.renderers, self.object_index, self.view_index
        return Registration(scene, *where, {self._index: replace(self.problem, doubt="")})

    @property
    def record(self) -> PoseRecord:
        """Content of the pose file of the object in the view whose chart is used."""
        return pose_json(as_saved(self._with_loss), self._index, self.view_index)

    @property
    def _with_loss(self) -> Scene:
        if self.object_index is None or self.object.result is not None:
            return self.scene
        start = FitProgress.at_start(self.problem)
        known = replace(start, parameters=self.parameters, loss=self.loss)
        result = make_search_result(self.scene, self._index, known)
        return self.scene.with_object(self._index, result=result)

    def save(self, path: str | Path) -> None:
        """Write the pose file of one object in one view, or else the scene file, with masks beside
        it; each file whole or not at all.

        Raises:
            PoseViewerError: the folder is missing or cannot be written to.
        """
        is_single = len(self.views) == 1 and not self.scene.frames
        if self.object_index is not None and is_single:
            masks = self.scene.mask(self._index), self.scene.occluders(self._index)
            save_pose_and_masks(path, self.record, *masks)
        else:
            save_scene(path, as_saved(self._with_loss))

    def picture(
        self, look: str = "outline", *, opacity: float = SOLID_OPACITY, view: int | None = None
    ) -> Picture:
        """Draw the visible pixels of the objects over a photo: (height, width, 3), RGB.

        Args:
            look: one of ``render.overlay.LOOKS``.
            opacity: of the look ``solid``, in [0, 1].
            view: index; default: the view whose chart is used.

        Raises:
            PoseViewerError: there is no such look; the settings do not go with an object.
        """
        if look not in LOOKS:
            wanted = f"choose one of {', '.join(LOOKS)}"
            raise SettingsError(f"there is no look {look!r}; {wanted}")
        view = self.view_index if view is None else view
        photo = self.views[view].photo
        picture = photo.as_rgb8(photo.width, photo.height)
        for index in self.indices:
            if not self.objects[index].hidden:
                picture = replace(self, object_index=index)._draw_over(picture, look, opacity, view)
        return picture

    def _draw_over(self, picture: Picture, look: str, opacity: float, view: int) -> Picture:
        placed = self.scene.model_at(self._index, view)
        shown = (i for i, item in enumerate(self.objects) if i != self._index and not item.hidden)
        others = [self.scene.model_at(index, view) for index in shown]
        in_front = make_occlusion(placed, others) if others else None
        if in_front is not None and in_front.is_total:
            return picture

        def relight(image: AttributeImage) -> FloatArray:
            views = self.problem.views
            photo = next((each.photo for each in views if each.view_index == view), views[0].photo)
            return render_relit(photo, self.renderers[mesh], placed.pose, image)

        mesh = self.object.drawn_mesh

        model = ModelInPhoto(picture, mesh, self.renderers[mesh], placed.pose, relight, opacity)
        drawn = draw_style(look, model)
        return drawn if in_front is None else np.where(in_front.occluded[..., None], picture, drawn)

    def save_painted(self, path: str | Path) -> tuple[Path, ...]:
        """Write the painted models as GLB and return the files: of several objects one each,
        ``painted.ID.glb`` for a ``path`` ``painted.glb``.

        Raises:
            PoseViewerError: an object is not painted, or a file cannot be written.
        """
        paths = self.painted_files(path)
        for index, file in zip(self.indices, paths, strict=True):
            item = self.objects[index]
            if item.painting is None:
                raise SettingsError(f"{item.label} is not painted; paint it first.")
            save_painting(file, item.painting)
        return paths

    def painted_files(self, path: str | Path) -> tuple[Path, ...]:
        """Return the files that ``save_painted`` writes, each of another name."""
        path = Path(path)
        if len(self.indices) == 1:
            return (path,)
        names = [safe_path(self.objects[i].id.replace("/", "-")).name for i in self.indices]
        folded = [name.casefold() for name in names]
        for at, name in enumerate(folded):
            if folded.count(name) > 1:
                names[at] += f"-{self.indices[at] + 1}"
        return tuple(path.with_name(f"{path.stem}.{name}{path.suffix}") for name in names)

    def draw(self, path: str | Path, look: str = "outline") -> tuple[Path, ...]:
        """Write ``picture(look)`` in the format of the path's ending and return the files: for
        several views one each, ``pose.NAME.png`` for a ``path`` ``pose.png``.

        Raises:
            PoseViewerError: there is no such look or format, or a file cannot be written.
        """
        path, paths = Path(path), []
        for index, view in enumerate(self.views):
            stem = Path(view.name).with_suffix("").as_posix().replace("/", "-")
            name = f"{path.stem}.{stem}{path.suffix}" if len(self.views) > 1 else path.name
            paths.append(path.with_name(name))
            save_image(paths[-1], self.picture(look, view=index))
        return tuple(paths)

    def landscape(
        self,
        *,
        half_width: float = 0.2,
        size: int = 41,
        watch: Callable[[int, int], object] | None = None,
    ) -> LossMaps:
        """Map the loss about the pose for every two free parameters, on all cores.

        ``watch`` is called with the number of points that are done, and that of all.

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
        return LossMaps.about(self.parameters, newest.values(), half_width, problem, self.photo)


@dataclass(frozen=True, slots=True, eq=False)
class Registration(PosedScene):
    """Objects that can be searched for from where they are."""

    notes: tuple[str, ...] = ()
    """Notes for the user on how the files were read."""
    start = property(lambda self: self, doc="This registration, as ``FitResult.start``.")

    def _search(self, threads: int, stages: StageMaker, **limits: float | None) -> Search:
        """Make the search, within the limits that are given."""
        given = {name: limit for name, limit in limits.items() if limit is not None}
        scene = self.scene
        for index, item in enumerate(scene.objects if given else ()):
            settings = replace(item.settings, limits=replace(item.settings.limits, **given))
            scene = scene.with_object(index, settings=settings)
        placed = tuple(i for i in self.indices if scene.objects[i].is_placed)
        if not placed:
            names = list_names([repr(scene.objects[i].label) for i in self.indices])
            raise SettingsError(
                f"{names}: not placed, so there is no start; place it, or look for it (auto)."
            )
        renderers = {i: self.renderers[scene.compared_mesh(i)] for i in placed}
        return Search(scene, renderers, placed, threads, self.view_index, stages, propose_about)

    def search(
        self, *, threads: int = 1, stages: StageMaker = make_stages
    ) -> Iterator[SearchProgress]:
        """Yield the progress of ``fit`` after every evaluation; to stop the search, stop asking."""
        return self._search(threads, stages).run()

    def fit(
        self,
        *,
        seconds: float | None = None,
        evaluations: int | None = None,
        watch: Callable[[FitProgress], object] | None = None,
        threads: int = 1,
        interruptible: bool = False,
        stages: StageMaker = make_stages,
    ) -> FitResult:
        """Search to the end, or to a limit of each search, for the object or for all.

        Args:
            seconds: time limit of each search, s; default: that of the settings.
            evaluations: limit of evaluations of each search; default: that of the settings.
            watch: called after every evaluation; an exception in it ends the search.
            threads: more of them give the same poses in less time.
            interruptible: whether Ctrl-C ends the search and keeps the best pose so far.
            stages: makes pyramid levels and minimisers of a search, see ``fit.stages``.

        Raises:
            PoseViewerError: the settings do not go with an object, or no view shows it.
        """
        search = self._search(threads, stages, seconds=seconds, evaluations=evaluations)
        now: SearchProgress | None = None
        try:
            for now in search.run():
                if watch is not None:
                    watch(now.progress)
        except KeyboardInterrupt:
            if now is None or not interruptible:
                raise
            now = search.stop(now)
        if now is None:
            _ = self.object_index is None or self.problem  # raises the reason
            raise SettingsError(
                "no object of the scene is to be seen where it starts: bring them onto the photo."
            )
        scene = search.scene
        for index, item in enumerate(self.objects):
            scene = scene.with_object(index, settings=item.settings)
        about = scene, self.renderers, self.object_index, self.view_index
        return FitResult(*about, before=self, progress_by_object=now.progress_by_object)

    def with_key(self, frame_index: int, start: str | Path | Pose) -> Registration:
        """Make a key of the object's pose in a frame of a sequence: a pose, or a pose file.

        Raises:
            PoseViewerError: there is no such frame, the file cannot be used, or the pose is by
                another camera than the sequence's.
        """
        path_or_pose = start if isinstance(start, Pose) else Path(start)
        scene = with_key(self.scene, frame_index, path_or_pose, self._index)
        notes = (*self.notes, *scene.notes[len(self.scene.notes) :])
        return replace(self, scene=scene, notes=notes, _problems={})

    def paint(self) -> Registration:
        """Paint the models from the keys of a sequence, or from all photos that show them.

        Poses are searched for by the painted models then; verdicts are of the bare ones.

        Raises:
            PoseViewerError: there is no key, no photo shows enough, or one cannot be read.
        """
        scene, renderers = self.scene, dict(self.renderers)
        for index in self.indices:
            scene = scene.with_object(index, painting=paint_object(scene, index))
            _add_renderers(renderers, scene.objects[index])
        return replace(self, scene=scene, renderers=renderers, _problems={})

    def propagate(
        self,
        first: int = 0,
        last: int | None = None,
        *,
        threads: int = 1,
        known: Sequence[FrameStep] = (),
    ) -> Iterator[FrameStep]:
        """Yield the poses of ``track`` frame by frame; to stop it, stop asking.

        Args:
            first: index of the first frame.
            last: index of the last frame; default: that of the sequence.
            threads: more of them give the same poses in less time.
            known: what was yielded before it was stopped; it goes on from there.

        Raises:
            SettingsError: the scene is no sequence, or has no keys.
        """
        require_keys(self.scene, [self.objects[index].id for index in self.indices])
        renderers = {i: self.renderers[self.objects[i].compared_mesh] for i in self.indices}
        last = len(self.scene.frames) - 1 if last is None else last
        return propagate(self.scene, renderers, first, last, self.indices, threads, known)

    def track(
        self,
        first: int = 0,
        last: int | None = None,
        *,
        watch: Callable[[Scene, FrameStep], object] | None = None,
        threads: int = 1,
    ) -> Registration:
        """Propagate poses from the keys of a sequence to its other frames.

        Args:
            first: index of the first frame.
            last: index of the last frame; default: that of the sequence.
            watch: called after every frame with the scene so far; an exception in it ends it.
            threads: more of them give the same poses in less time.

        Raises:
            SettingsError: the scene is no sequence, or has no keys.
        """
        scene, notes = self.scene, [*self.notes]
        for step in self.propagate(first, last, threads=threads):
            scene = store_poses(scene, {step.frame_index: step.poses})
            notes += [step.note] if step.note else []
            if watch is not None:
                watch(scene, step)
        return replace(self, scene=scene, notes=tuple(notes), _problems={})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitResult(PosedScene):
    """Poses that a search has found, and how sure they are."""

    before: Registration = field(repr=False)
    """Registration of all objects that was fitted; see ``start``."""
    progress_by_object: Mapping[int, FitProgress]
    """End of the last search for each object that was searched for."""
    placings = property(attrgetter("progress_by_object"), doc="``progress_by_object``.")

    @property
    def progress(self) -> FitProgress | None:
        """End of the search for the object; None: there was no search."""
        return self.progress_by_object.get(self._index)

    @property
    def _ends(self) -> list[FitProgress]:
        return [end for i, end in self.progress_by_object.items() if i in self.indices]

    @property
    def start(self) -> Registration:
        """Registration that was fitted, about the same object."""
        return replace(self.before, object_index=self.object_index)

    @property
    def verdict(self) -> Verdict | None:
        """Whether the pose is right, and why; None: there was no search."""
        return None if self.progress is None else self.progress.verdict

    @property
    def covariance(self) -> PoseCovariance | None:
        """Covariance of the pose; None: there was no search, or the pose is lost."""
        return None if self.progress is None else self.progress.covariance

    @property
    def status(self) -> str:
        """End of the search in a sentence."""
        return "Not searched." if self.progress is None else self.progress.status.value

    @property
    def stopped(self) -> bool:
        """Whether the search was interrupted."""
        return any(end.status is Status.STOPPED for end in self.progress_by_object.values())

    @property
    def evaluations(self) -> int:
        """Number of evaluations of the search for the object, or for all."""
        return sum(end.evaluations for end in self._ends)

    @property
    def seconds(self) -> float:
        """Duration of the search for the object, or for all, s."""
        return sum(end.seconds for end in self._ends)

    @property
    def hidden(self) -> NDArray[np.bool_] | None:
        """(height, width): pixels that the search took for occluders; None: none."""
        result = self.object.result
        return result.hidden[self.view_index] if result is not None and result.hidden else None

    @property
    def seen(self) -> float:
        """Visible fraction of the object's pixels in the photo, in [0, 1]."""
        return visible_fraction(self.problem.photo, self.renderer, self.pose)

    @property
    def view_results(self) -> tuple[ViewResult, ...]:
        """Result by each compared view alone; takes an evaluation each."""
        about, end = (self.scene, self._index), self.progress
        return () if end is None else tuple(results_by_view(*about, end, self.renderer))
