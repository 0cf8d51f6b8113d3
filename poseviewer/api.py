"""poseviewer as a library: load, fit, look, map and save.

::

    case = load("photo.jpg", "car.glb", "start.json")
    found = case.fit(seconds=60)
    print(found.verdict, found.unexplained, found.pose.camera_from_model.rotation)
    found.save("pose.json")
    found.draw("residual.png", look="residual")
    found.landscape(size=21).save("maps.png")

Inside poses, pixel centres are at i + 0.5; the files have OpenCV's, at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

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
from poseviewer.fit.landscape import Slice, landscape
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss, shown_attributes
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.fit.search import search
from poseviewer.fit.settings import FitSettings, Limits, settings_as_json
from poseviewer.fit.stages import make_stages
from poseviewer.fit.unexplained import Unexplained
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.moments import model_attributes
from poseviewer.render.overlay import LOOKS
from poseviewer.render.overlay.looks import SOLID_OPACITY, Picture, View, draw_look
from poseviewer.render.pool import RendererPool
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import AttributeImage, Renderer
from poseviewer.starts.automatic import AUTOMATIC, AutoStart
from poseviewer.starts.registration import (
    Start,
    StartCamera,
    StartInputs,
    load_registration,
    load_with_start,
)

__all__ = [
    "Case",
    "FitResult",
    "FitSettings",
    "LossMaps",
    "Mask",
    "PoseViewerError",
    "StartCamera",
    "load",
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
            the settings' region, or the whole photo.
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
    unknown = sorted(set(changes) - set(FitSettings.__slots__))
    if unknown:
        known = ", ".join(FitSettings.__slots__)
        raise SettingsError(f"there is no setting {unknown[0]!r}; there are {known}")
    chosen = replace(settings or FitSettings(), **changes)
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
        unplaced = model if isinstance(model, LoadedModel) else Path(model)
        registration = load_with_start(Path(photo), unplaced, find, *more)
    own = model.mesh if isinstance(model, LoadedModel) else None
    if registration.mesh.left_out and registration.mesh is not own:
        renderer = None  # it draws the parts that are left out
    return make_case(registration, chosen, renderer)


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
        return search(self.problem, self.registration.mesh, self.renderer, judge_end, threads)

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
        progress: FitProgress | None = None
        problem = replace(self.problem, limits=limits)
        try:
            for progress in replace(self, problem=problem).search(threads=threads):
                if watch is not None:
                    watch(progress)
        except KeyboardInterrupt:
            if progress is None or not interruptible:
                raise
            stopped = replace(progress, status=Status.STOPPED)
            mesh = self.registration.mesh
            verdict = judge_end(stopped, problem, mesh, self.renderer, threads)
            progress = replace(stopped, verdict=verdict)
        assert progress is not None  # a fit yields at least once
        return FitResult(self, progress.pose, progress)

    def slices(
        self, pose: Pose, *, half_width: float = 0.2, size: int = 41, pool: RendererPool
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
        photo, chart = self.registration.photo, self.problem.chart
        centre = chart.from_pose(pose)
        name = self.settings.method_name
        whose = "loss" if self.settings.method == "default" else f"loss of {name}"
        title = f"{photo.label}: {whose} about the pose, ±{half_width:.0%}"
        return LossMaps(
            tuple(slices),
            chart.names,
            centre,
            chart.scales(centre),
            self.problem.scale,
            title,
            photo_text(photo),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
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
    def stopped(self) -> bool:
        """Whether it is what an interrupted search had found so far."""
        return self.progress is not None and self.progress.status is Status.STOPPED

    @property
    def verdict(self) -> Verdict | None:
        """Whether the pose is right, and why; None for a pose that was not searched for."""
        return None if self.progress is None else self.progress.verdict

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
            features.pop("weak", None)
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
        )

    def save(self, path: str | Path) -> None:
        """Write the pose file, and the mask beside it (``car.mask.png`` for ``car.pose.json``),
        whole or not at all.

        Raises:
            PoseViewerError: the folder is missing or cannot be written to.
        """
        save_pose_and_mask(path, self.record, self.case.registration.mask)

    def picture(self, look: str = "outline", *, opacity: float = SOLID_OPACITY) -> Picture:
        """(height, width, 3) RGB: the model over the photo, in one of ``overlay.LOOKS``.

        ``opacity`` is that of the look ``solid``, in [0, 1].

        Raises:
            SettingsError: there is no such look.
        """
        if look not in LOOKS:
            raise SettingsError(f"there is no look {look!r}; choose one of {', '.join(LOOKS)}")
        registration, renderer = self.case.registration, self.case.renderer
        photo = registration.photo
        pixels = photo.as_rgb8(photo.width, photo.height)
        view = View(pixels, registration.mesh, renderer, self.pose, self._relit, opacity)
        return draw_look(look, view)

    def _relit(self, image: AttributeImage) -> FloatArray:
        attributes = shown_attributes(self.case.problem.photo)
        lighting = recover_lighting(self.case.renderer.moments(self.pose, attributes))
        return lighting.apply(model_attributes(image, attributes))

    def draw(self, path: str | Path, look: str = "outline") -> None:
        """Write ``picture(look)`` in the format of the file's ending.

        Raises:
            PoseViewerError: there is no such look or format, or the file cannot be written.
        """
        save_image(path, self.picture(look), photo_text(self.case.registration.photo))

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
