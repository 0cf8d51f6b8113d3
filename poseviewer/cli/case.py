"""From options to a photo, a model and a start; and the fit of them."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from poseviewer.api import (
    Case,
    FitResult,
    FitSettings,
    SceneCase,
    SetCase,
    SetResult,
    load,
    load_scene,
    load_views,
)
from poseviewer.cli.options import (
    calibration_of,
    choice_of,
    refuse_beside,
    refuse_views,
    settings_of,
)
from poseviewer.cli.terminal import progress_bar, say, tell, tell_of_compiling
from poseviewer.errors import SettingsError
from poseviewer.files.marks import load_pairs, wheels_from_text
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.verdict import Verdict
from poseviewer.render.pool import processors
from poseviewer.starts.automatic import AUTOMATIC
from poseviewer.starts.point_pairs import start_from_pairs
from poseviewer.starts.registration import Start, StartCamera, StartInputs
from poseviewer.starts.wheels import start_from_found_wheels, start_from_wheels

AnyCase = TypeVar("AnyCase", Case, SceneCase, SetCase)


def open_case(options: Namespace) -> Case:
    """Photo, model and start: from a pose file, from marks on the photo, or found.

    Raises:
        PoseViewerError: a file cannot be used, or the options do not go together.
    """
    settings, given = settings_of(options), vars(options)
    if options.photo is None or options.model is None:
        raise SettingsError("PHOTO and MODEL are wanted; name both, or a scene with --scene")
    refuse_views(options)
    if given.get("object"):
        raise SettingsError("--object without --scene; leave it out, or name a scene")
    if given.get("box") and options.start is None:
        raise SettingsError("--box without --start auto; leave it out, or add --start auto")
    _tell_of_compiling(settings)
    parallel = given.get("projection") == "parallel"
    camera = StartCamera(parallel, given.get("focal"), options.free_focal)
    with progress_bar(None, options.quiet) as bar:
        case = load(
            options.photo,
            options.model,
            options.pose or _start(options, camera),
            settings,
            calibration=calibration_of(options),
            box=given.get("box"),
            camera=camera,
            mask=options.mask,
            watch=bar.update,
        )
    return _noted(case, options)


def open_scene(options: Namespace) -> SceneCase:
    """The scene that ``--scene`` names.

    Raises:
        PoseViewerError: a file cannot be used, or the options do not go together.
    """
    settings = settings_of(options)
    given = ("photo", "mask", "calibration", "box", "focal")
    refuse_beside(options, "--scene", given)
    _tell_of_compiling(settings)
    return _noted(load_scene(options.scene, settings), options)


def open_views(options: Namespace) -> SetCase:
    """The set of photos that ``--views`` names, with the model in each.

    Raises:
        PoseViewerError: a file cannot be used, or the options do not go together.
    """
    settings = settings_of(options)
    refuse_beside(options, "--views", ("scene", "object", "mask", "calibration", "box", "focal"))
    if options.pose is None:
        raise SettingsError("--views wants a start with --pose: a pose in one of the photos")
    if options.model is not None or options.photo is None:
        raise SettingsError("--views SET wants MODEL alone: the set says the photos")
    _tell_of_compiling(settings)
    case = load_views(
        options.views,
        options.photo,
        options.pose,
        settings,
        view=options.view,
        scale=options.scale,
        choice=choice_of(options),
    )
    return _noted(case, options)


def open_any(options: Namespace) -> Case | SceneCase | SetCase:
    """A photo, several objects in one, or one in several, as the options have it.

    Raises:
        PoseViewerError: a file cannot be used, or the options do not go together.
    """
    if options.views is not None:
        return open_views(options)
    return open_case(options) if options.scene is None else open_scene(options)


def fit(options: Namespace) -> FitResult | SceneCase | SetResult:
    """The same, searched to the end or to Ctrl-C, which keeps the best pose so far; printed."""
    match open_any(options):
        case Case() as one:
            return search(one, options.quiet)
        case SceneCase() as scene:
            return search_scene(scene, options.object, options.quiet)
        case views:
            return search_views(views, options.quiet)


def _tell_of_compiling(settings: FitSettings) -> None:
    if settings.renderer != "opengl":
        tell_of_compiling()


def _noted(case: AnyCase, options: Namespace) -> AnyCase:
    """The same, once its notes are told."""
    for note in () if options.quiet else case.notes:
        tell(f"note: {note}")
    return case


def _start(options: Namespace, camera: StartCamera) -> Path | str | Callable[[StartInputs], Start]:
    if options.start is not None:
        return AUTOMATIC
    if options.pairs is not None:
        return lambda inputs: start_from_pairs(inputs, load_pairs(options.pairs), camera)
    if options.find_wheels is not None:
        return lambda inputs: start_from_found_wheels(inputs, options.find_wheels, camera)
    return lambda inputs: start_from_wheels(inputs, wheels_from_text(options.wheels), camera)


def search(case: Case, quiet: bool) -> FitResult:
    """Fit to the end, or to Ctrl-C, which keeps the best pose so far; print how it ended."""
    with _watching(quiet) as watch:
        found = case.fit(watch=watch, threads=processors(), interruptible=True)
    print_end(found)
    return found


def search_scene(scene: SceneCase, object_id: str | None, quiet: bool) -> SceneCase:
    """The same of all objects of a scene, or one of them."""
    with _watching(quiet) as watch:
        found = scene.fit(object_id, watch=watch, threads=processors(), interruptible=True)
    shares = found.visibility.shares
    for one, result, share in zip(found.scene.objects, found.results, shares, strict=True):
        if object_id not in (None, one.id):
            continue
        say(f"{one.label} (seen to {share:.0%})")
        if result is None:
            say("Not searched for: it stands wholly behind others; its pose is as it was.")
        else:
            print_end(result)
    return found


def search_views(case: SetCase, quiet: bool) -> SetResult:
    """The same of one pose in several photos."""
    with _watching(quiet) as watch:
        found = case.fit(watch=watch, threads=processors(), interruptible=True)
    assert found.progress is not None  # it was searched for
    _print_search(found.progress)
    for name, view in zip(case.names, found.views, strict=True):
        said = "" if view.verdict is None else f", {view.verdict.word} by it alone"
        seen = "" if view.hidden is None else f", {view.seen:.0%} of the model seen"
        say(f"{name}: {view.case.problem.scale.text(view.loss)}{seen}{said}")
    if case.registration.free_size:
        say(f"scale: {1.0 / found.size:.6g} lengths of the model's unit in one of the set's")
    unit = found.case.registration.registrations[0].mesh.unit
    _print_verdict(found.verdict, unit, found.notes)
    return found


@contextmanager
def _watching(quiet: bool) -> Iterator[Callable[[FitProgress], None]]:
    """What shows the progress of searches, one after the other."""
    with progress_bar(None, quiet) as bar:
        last, before = 0, 0

        def watch(progress: FitProgress) -> None:
            nonlocal last, before
            if progress.evaluations < last:
                before += last
            last = progress.evaluations
            text = f"restart {progress.restart}, {progress.loss_text}"
            bar.set_description_str(text, refresh=False)
            bar.update(before + last - bar.n)

        yield watch


def print_end(found: FitResult) -> None:
    """How a search ended."""
    progress, verdict = found.progress, found.verdict
    assert progress is not None  # it was searched for
    _print_search(progress)
    if parts := found.parts.parts_text:
        say(f"unexplained by part: {parts}")
    if found.hidden is not None:
        say(
            f"something in front was taken to hide a part of the model: {found.seen:.0%} of it is "
            "seen, and the rest was left out"
        )
    _print_verdict(verdict, found.case.registration.mesh.unit, found.notes)


def _print_search(progress: FitProgress) -> None:
    say(
        f"{progress.status.value}\n"
        f"{progress.loss_text} (start {progress.scale.shown(progress.start_loss):.3f})\n"
        f"{progress.evaluations} evaluations, {progress.restart} restarts, {progress.seconds:.1f} s"
    )


def _print_verdict(verdict: Verdict | None, unit: str | None, notes: Sequence[str] = ()) -> None:
    if verdict is None:
        return
    say(f"verdict: {verdict.word} ({verdict.probability:.0%} of such fits are right)")
    for reason in (*verdict.reasons, *notes):
        say(f"  {reason}")
    if verdict.covariance is not None:
        say(f"how sure, as standard deviations: {verdict.covariance.words(unit)}")
