"""From options to what they name: settings, a calibrated camera, files, a scene."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from poseviewer.cli.options import OF_VIEWS, made
from poseviewer.cli.terminal import progress_bar, tell, tell_of_compiling
from poseviewer.errors import SettingsError
from poseviewer.fit.settings import FitSettings, Limits

if TYPE_CHECKING:  # help texts come before all that
    from poseviewer.api import Scene
    from poseviewer.files.cameras import Calibration
    from poseviewer.files.file_set import FileSet
    from poseviewer.files.photo_sets import SetChoice
    from poseviewer.starts.loading import Start, StartCamera, StartInputs

STARTS = ("pose", "pairs", "wheels", "find_wheels", "start")
"""Options that say where the model starts."""
OF_A_PHOTO = ("mask", "calibration", "box", "focal")
"""Options that a set of photos, or a scene, says itself."""


def refuse(options: Namespace, names: Sequence[str], why: str) -> None:
    """Refuse the options of these names, where they are given."""
    for name in names:
        if getattr(options, name, None) not in (None, False):
            raise SettingsError(f"--{name.replace('_', '-')} {why}")


def refuse_beside(options: Namespace, flag: str, names: Sequence[str]) -> None:
    """Refuse options that say what the ``flag`` says itself."""
    refuse(options, names, f"with {flag}, which says it itself; leave it out")


def refuse_with_paper(options: Namespace) -> None:
    """Refuse the paper's method with what it does not have."""
    if getattr(options, "method", None) != "paper":
        return
    if options.pixels == "near":
        raise SettingsError("--method paper with --pixels near; it has clip and whole alone")
    compares_grey = "with --method paper, which compares grey; leave one of them out"
    refuse(options, ["colour_reflectance"], compares_grey)


def settings_of(options: Namespace) -> FitSettings:
    """Options of a fit."""
    refuse_with_paper(options)
    return made(
        FitSettings,
        options,
        mask=options.mask.name if options.mask else None,
        without=tuple(options.without) if options.without else None,
        limits=made(Limits, options),
    )


def calibration_of(options: Namespace) -> Calibration | None:
    """The calibration that the options name; None where they name none."""
    camera, fisheye = options.calibration_camera, options.calibration_fisheye
    if options.calibration is None:
        more = ("calibration_camera", "calibration_fisheye")
        refuse(options, more, "without --calibration; name its file")
        return None
    from poseviewer.files.cameras import Calibration

    return Calibration(options.calibration, camera, fisheye)


def choice_of(options: Namespace) -> SetChoice:
    """Choice among the set's photos."""
    from poseviewer.files.photo_sets import SetChoice

    return SetChoice(options.photos or (), options.photo_folder, options.rig_object)


def named_files(options: Namespace) -> FileSet:
    """The files that the options name, by what they are.

    Raises:
        SettingsError: they do not go together.
    """
    from poseviewer.files.file_set import FileSet, ModelFiles, is_scene_file

    photo, model, views = options.photo, options.model, options.views
    if views is not None:
        refuse_beside(options, "--views", ("object", *OF_A_PHOTO))
        if model is not None or photo is None:
            raise SettingsError("--views SET wants MODEL alone: the set says the photos")
        return FileSet(models=(ModelFiles(photo),), pose=options.pose, views=views)
    refuse(options, OF_VIEWS, "without --views; leave it out, or name a set of photos")
    is_json = model is None and photo is not None and photo.suffix.lower() == ".json"
    if photo is not None and (is_json or is_scene_file(photo)):
        refuse_beside(options, photo.name, (*STARTS, *OF_A_PHOTO))
        if model is not None:
            raise SettingsError(f"{photo}: a scene file says its models; leave out MODEL")
        return FileSet(scene=photo)
    refuse(options, ["object"], "without a scene; leave it out, or name a scene file")
    return FileSet(photo, models=(ModelFiles(model),) if model else (), pose=options.pose)


def open_scene(options: Namespace) -> Scene:
    """A photo, several objects in one, or one in several, as the options have it; about one object
    where they name one.

    Raises:
        PoseViewerError: a file cannot be used, or the options do not go together.
    """
    settings, files = settings_of(options), named_files(options)
    if settings.renderer != "opengl":
        tell_of_compiling()
    from poseviewer.api import load

    if files.views is not None:
        if options.pose is None:
            raise SettingsError("--views wants a start with --pose: a pose in one of the photos")
        scene = load(
            views=files.views,
            model=files.models[0].path,
            start=options.pose,
            settings=settings,
            view=options.view,
            scale=options.scale,
            choice=choice_of(options),
        )
    elif files.scene is not None:
        scene = load(files.scene, settings=settings)
        if getattr(options, "object", None):
            scene = scene[options.object]
    else:
        scene = _open_photo(options, settings)
    for note in () if options.quiet else scene.notes:
        tell(f"note: {note}")
    return scene


def _open_photo(options: Namespace, settings: FitSettings) -> Scene:
    """Photo, model and start: from a pose file, from marks on the photo, or found."""
    from poseviewer.api import load
    from poseviewer.starts.loading import StartCamera

    given = vars(options)
    if options.photo is None or options.model is None:
        raise SettingsError("PHOTO and MODEL are wanted, or a scene file; name them")
    if given.get("box") and options.start is None:
        raise SettingsError("--box without --start auto; leave it out, or add --start auto")
    if all(given.get(name) is None for name in STARTS):
        wanted = ", ".join(f"--{name.replace('_', '-')}" for name in STARTS if name in given)
        raise SettingsError(f"a start is wanted: give {wanted}")
    parallel = given.get("projection") == "parallel"
    camera = StartCamera(parallel, given.get("focal"), options.free_focal)
    with progress_bar(None, options.quiet) as bar:
        return load(
            options.photo,
            options.model,
            options.pose or options.start or _find(options, camera),
            settings,
            calibration=calibration_of(options),
            box=given.get("box"),
            camera=camera,
            mask=options.mask,
            watch=bar.update,
        )


def _find(options: Namespace, camera: StartCamera) -> Callable[[StartInputs], Start]:
    """Return a function that finds a start from marks on the photo."""
    from poseviewer.files.marks import load_pairs, wheels_from_text
    from poseviewer.starts.point_pairs import start_from_pairs
    from poseviewer.starts.wheels import start_from_found_wheels, start_from_wheels

    if options.pairs is not None:
        return lambda inputs: start_from_pairs(inputs, load_pairs(options.pairs), camera)
    if options.find_wheels is not None:
        return lambda inputs: start_from_found_wheels(inputs, options.find_wheels, camera)
    return lambda inputs: start_from_wheels(inputs, wheels_from_text(options.wheels), camera)
