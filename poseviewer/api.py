"""poseviewer as a library: load, fit, look, map and save.

::

    case = load("photo.jpg", "car.glb", "start.json")
    found = case.fit(seconds=60)
    print(found.verdict, found.loss, found.pose.camera_from_model.rotation)
    found.save("pose.json")
    found.draw("residual.png", look="residual")
    found.landscape(size=21).save("maps.png")

Inside poses, pixel centres are at i + 0.5; the files have OpenCV's, at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.auto_start import AUTOMATIC, AutoStart
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.files.calibrated_photo import photo_text
from poseviewer.files.calibration_file import Calibration
from poseviewer.files.landscape_file import save_landscape
from poseviewer.files.photo_file import load_mask, save_image
from poseviewer.files.pose_file import PoseRecord, save_pose
from poseviewer.fit.judged import judged_fit, with_verdict
from poseviewer.fit.landscape import Slice, landscape
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.pose_fit import FitProblem, FitProgress, Limits, Status, pose_loss
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.quick_start import Material, Start, StartCamera, load_unplaced
from poseviewer.registration import (
    FitSettings,
    LoadedModel,
    Registration,
    load_registration,
    make_problem,
    make_record,
    make_renderer,
    shown_attributes,
)
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.many import RendererPool
from poseviewer.render.moments import model_attributes
from poseviewer.render.overlay import LOOKS, Picture, View, draw_look

__all__ = [
    "Case",
    "FitResult",
    "FitSettings",
    "LossMaps",
    "PoseViewerError",
    "StartCamera",
    "load",
]

Watch = Callable[[FitProgress], Any]
Find = Callable[[Material], Start]


def load(
    photo: str | Path,
    model: str | Path | LoadedModel,
    start: str | Path | Find,
    settings: FitSettings | None = None,
    *,
    calibration: Calibration | str | Path | None = None,
    box: tuple[int, int, int, int] | None = None,
    camera: StartCamera | None = None,
    mask: str | Path | None = None,
    renderer: Renderer | None = None,
    watch: Callable[[], object] = lambda: None,
    **changes: Any,
) -> Case:
    """A photo, a model and a start pose, ready to be fitted.

    Args:
        photo: JPEG, PNG, TIFF, WebP or BMP file.
        model: OBJ, PLY, STL, OFF, GLB, glTF or 3DS file; or one that is loaded
            (``registration.load_model``), for many photos of one thing.
        start: a pose file; or ``"auto"``: one is looked for, which takes some seconds; or what
            finds one on the photo: ``quick_start.start_from_pairs`` and its like.
        settings: what is compared and how.
        calibration: of the camera and its lens: a file, or a choice among the cameras of one
            (``files.calibration_file.Calibration``); a photo that the lens distorts is
            undistorted.
        box: for ``"auto"``: a rectangle (left, top, width, height) about the object, px; without
            one, the settings' region, or the whole photo.
        camera: for ``"auto"``: what is known of it; by default EXIF's focal length, or a view of 50
            degrees.
        mask: a picture of the photo's size whose white pixels count.
        watch: for ``"auto"``: called after every evaluation of the fits that it makes; whatever it
            raises ends them.
        renderer: one of the same model, to be used again; by default one is made.
        **changes: fields of the settings by name (``grey=True``, ``pixels="clip"``).

    Raises:
        PoseViewerError: a file cannot be used, or the settings do not go with it.
    """
    chosen = _changed(settings or FitSettings(), changes)
    if isinstance(calibration, str | Path):
        calibration = Calibration(Path(calibration))
    if box is not None and (start != AUTOMATIC or len(box) != 4):
        raise SettingsError(
            f'box={box}: wanted (left, top, width, height), and start="auto", which it is for.'
        )
    if start == AUTOMATIC:
        known, where = camera or StartCamera(), Path(mask) if mask else None
        start = AutoStart(box, known, chosen, where, watch=watch).find
    if callable(start):
        unplaced = model if isinstance(model, LoadedModel) else Path(model)
        registration = load_unplaced(Path(photo), unplaced, start, calibration)
    else:
        registration = load_registration(photo, model, start, calibration)
    weights = None
    if mask is not None:
        weights = load_mask(mask, registration.photo.width, registration.photo.height)
        chosen = replace(chosen, mask=Path(mask).name)
    problem, note = make_problem(registration, chosen, weights)
    if renderer is None:
        renderer = make_renderer(registration.mesh, chosen.renderer)
    notes = [*registration.warnings]
    if note:
        notes.append(f"the free-body chart is used: {note}.")
    return Case(registration, chosen, problem, renderer, tuple(notes))


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
        """The start pose, as if it had been found: to be judged, drawn, mapped."""
        loss = pose_loss(self.problem, self.renderer, self.problem.start)
        return FitResult(self, self.registration.start.pose, loss, None)

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

        ``watch`` is called with a ``FitProgress`` after every evaluation; whatever it raises ends
        the search. With more ``threads`` the same search takes less time, where poses can be
        judged side by side. ``interruptible``: Ctrl-C ends it, and the best pose so far is kept.
        """
        limits = self.problem.limits
        limits = Limits(
            limits.evaluations if evaluations is None else evaluations,
            limits.seconds if seconds is None else seconds,
        )
        progress: FitProgress | None = None
        problem, mesh = replace(self.problem, limits=limits), self.registration.mesh
        try:
            for progress in judged_fit(problem, mesh, self.renderer, threads):
                if watch is not None:
                    watch(progress)
        except KeyboardInterrupt:
            if progress is None or not interruptible:
                raise
            stopped = replace(progress, status=Status.STOPPED)
            progress = with_verdict(stopped, problem, mesh, self.renderer)
        assert progress is not None  # a fit yields at least once
        return FitResult(self, progress.pose, progress.loss, progress)


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """A pose of a case, and how good it is."""

    case: Case
    pose: Pose
    loss: float
    """In [0, min(n, m)]: 0 where some lighting explains the photo."""
    progress: FitProgress | None
    """How the search ended; None for a pose that was not searched for."""

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
    def record(self) -> PoseRecord:
        """All that the pose file says."""
        case = self.case
        return make_record(
            case.registration, case.settings, case.problem, self.pose, self.loss, self.verdict
        )

    def save(self, path: str | Path) -> None:
        """Write the pose file, whole or not at all.

        Raises:
            PoseFileError: the folder is missing or cannot be written to.
        """
        save_pose(path, self.record)

    def picture(self, look: str = "outline") -> Picture:
        """(height, width, 3) RGB: the model over the photo, in one of ``overlay.LOOKS``.

        Raises:
            SettingsError: there is no such look.
        """
        return draw_pose(self.case.registration, self.case.problem, self.case.renderer, self.pose,
                         look)  # fmt: skip

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
        """The loss about the pose for every two free numbers, on all cores.

        ``watch`` is called with how many points are done, and of how many.

        Raises:
            SettingsError: ``size`` is no odd number from 3 on, or ``half_width`` not above 0.
        """
        problem = self.case.problem
        centre = problem.chart.from_pose(self.pose)
        newest: dict[tuple[int, int], Slice] = {}
        free = len(problem.free_indices)
        total = free * (free - 1) // 2 * size**2
        with RendererPool(self.case.renderer) as pool:
            for piece in landscape(problem, pool, centre, half_width=half_width, size=size):
                newest[piece.first, piece.second] = piece
                if watch is not None:
                    watch(sum(int(np.isfinite(s.losses).sum()) for s in newest.values()), total)
        photo, spans = self.case.registration.photo, problem.chart.spans(centre)
        title = f"{photo.label}: loss about the pose, ±{half_width:.0%}"
        slices, names = tuple(newest.values()), problem.chart.names
        return LossMaps(slices, names, centre, spans, title, photo_text(photo))


@dataclass(frozen=True, slots=True, eq=False)
class LossMaps:
    """The loss about a pose: a slice for every two of its numbers."""

    slices: Sequence[Slice]
    names: tuple[str, ...]
    centre: FloatArray
    """(d,): the pose in the middle."""
    spans: FloatArray
    """(d,): what counts as 100 % of each number."""
    title: str = ""
    photo: str = ""
    """Which photo it is, as files say it."""

    def save(self, path: str | Path) -> None:
        """Write a sheet of maps (.png, .pdf, .svg), or the numbers (.npz).

        Raises:
            SettingsError: the format is unknown, or the file cannot be written.
        """
        if Path(path).suffix.lower() == ".npz":
            save_landscape(path, self.names, self.centre, self.spans, self.slices, self.photo)
            return
        from poseviewer.figures.landscape_sheet import make_landscape_sheet
        from poseviewer.figures.save import save_figure

        sheet = make_landscape_sheet(self.slices, self.names, self.centre, title=self.title)
        save_figure(path, sheet)


def draw_pose(
    registration: Registration, problem: FitProblem, renderer: Renderer, pose: Pose, look: str
) -> Picture:
    """(height, width, 3) RGB: the model over the photo at a pose, relit by the light found there.

    Raises:
        SettingsError: there is no such look.
    """
    if look not in LOOKS:
        raise SettingsError(f"there is no look {look!r}; choose one of {', '.join(LOOKS)}")
    photo = np.rint(registration.photo.as_float() * 255.0).astype(np.uint8)
    relight = partial(_relit, renderer, problem, pose)
    return draw_look(look, View(photo, registration.mesh, renderer, pose, relight))


def _relit(
    renderer: Renderer, problem: FitProblem, pose: Pose, image: AttributeImage
) -> FloatArray:
    attributes = shown_attributes(problem.photo)
    lighting = recover_lighting(renderer.moments(pose, attributes))
    return lighting.apply(model_attributes(image, attributes))


def _changed(settings: FitSettings, changes: dict[str, Any]) -> FitSettings:
    unknown = sorted(set(changes) - set(FitSettings.__slots__))
    if unknown:
        names = ", ".join(FitSettings.__slots__)
        raise SettingsError(f"there is no setting {unknown[0]!r}; there are {names}")
    return replace(settings, **changes)
