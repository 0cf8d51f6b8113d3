"""Open what options name: settings, a calibrated camera, files, a scene."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.terminal import progress_bar, tell, tell_of_compiling
from poseviewer.errors import SettingsError
from poseviewer.scene.settings import FitSettings, Limits

if TYPE_CHECKING:  # help texts come before all that
    from poseviewer.api import Find, Scene
    from poseviewer.files.cameras import Calibration
    from poseviewer.files.file_set import FileSet
    from poseviewer.starts.loading import StartCamera

SAYS = "with {}, which says it itself; leave it out"


def refuse_with_paper(options: Namespace) -> None:
    """Refuse the paper's loss with what it does not have."""
    if getattr(options, "loss", None) == "paper":
        if options.pixels == "near":
            raise SettingsError("--loss paper with --pixels near; it has clip and whole alone")
        compares_grey = "with --loss paper, which compares grey; leave one of them out"
        table.refuse(options, (table.REFLECTANCE,), compares_grey)


def settings_of(options: Namespace) -> FitSettings:
    """Options of a fit."""
    refuse_with_paper(options)
    return table.made(
        FitSettings,
        options,
        mask=options.mask.name if options.mask else None,
        without=tuple(options.without) if options.without else None,
        limits=table.made(Limits, options),
    )


def calibration_of(options: Namespace) -> Calibration | None:
    """The calibration that the options name; None where they name none."""
    if options.calibration is None:
        table.refuse(options, table.OF_CALIBRATION, "without --calibration; name its file")
        return None
    from poseviewer.files.cameras import Calibration

    fisheye = options.calibration_fisheye
    return Calibration(options.calibration, options.calibration_camera, fisheye)


def named_files(options: Namespace) -> FileSet:
    """The files that the options name; raises ``SettingsError``: they do not go together."""
    from poseviewer.files.file_set import FileSet, ModelFiles, is_scene_file

    photo, model, views = options.photo, options.model, options.views
    if views is not None:
        table.refuse(options, (table.OBJECT, *table.OF_A_PHOTO), SAYS.format("--views"))
        if model is not None or photo is None:
            raise SettingsError("--views SET wants MODEL alone: the set says the photos")
        return FileSet(models=(ModelFiles(photo),), pose=options.pose, views=views)
    table.refuse(options, table.OF_VIEWS, "without --views; leave it out, or name a set of photos")
    is_json = model is None and photo is not None and photo.suffix.lower() == ".json"
    if photo is not None and (is_json or is_scene_file(photo)):
        table.refuse(options, (*table.STARTS, *table.OF_A_PHOTO), SAYS.format(photo.name))
        if model is not None:
            raise SettingsError(f"{photo}: a scene file says its models; leave out MODEL")
        return FileSet(scene=photo)
    table.refuse(options, (table.OBJECT,), "without a scene; leave it out, or name a scene file")
    return FileSet(photo, models=(ModelFiles(model),) if model else (), pose=options.pose)


def open_scene(options: Namespace) -> Scene:
    """The scene that the options name, about one object where they say which."""
    from poseviewer.api import SetChoice, StartCamera, load

    settings, files, given = settings_of(options), named_files(options), vars(options)
    if settings.renderer != "opengl":
        tell_of_compiling()
    parallel = given.get("projection") == "parallel"
    camera = StartCamera(parallel, given.get("focal"), options.free_focal)
    with progress_bar(None, options.quiet) as bar:
        scene = load(
            files.scene or files.photo,
            files.models[0].path if files.models else None,
            None if files.scene else _start_of(options, camera),
            settings,
            views=files.views,
            view=options.view,
            scale=options.scale,
            choice=table.made(SetChoice, options),
            calibration=calibration_of(options),
            box=given.get("box"),
            instances=given.get("instances") or 1,
            camera=camera,
            mask=options.mask,
            watch=bar.update,
        )
    if files.scene is not None and given.get("object"):
        scene = scene[options.object]
    for note in () if options.quiet else scene.notes:
        tell(f"note: {note}")
    return scene


def _start_of(options: Namespace, camera: StartCamera) -> Path | str | Find:
    """A pose file, "auto", or a function that finds a start from marks on the photo."""
    given = table.values(options, table.STARTS)
    if options.views is None and (options.photo is None or options.model is None):
        raise SettingsError("PHOTO and MODEL are wanted, or a scene file; name them")
    if given["start"] is not None and options.views is None:
        return given["start"]
    table.refuse(
        options,
        (table.BOX, table.INSTANCES),
        "without --start auto; leave it out, or add --start auto",
    )
    if options.pose is not None:
        return options.pose
    if options.views is not None:
        raise SettingsError("--views wants a start with --pose: a pose in one of the photos")
    if not any(given.values()):
        wanted = ", ".join(start.flag for start in table.STARTS if start.name in options)
        raise SettingsError(f"a start is wanted: give {wanted}")
    from poseviewer.files.marks import load_pairs, wheels_from_text
    from poseviewer.starts.point_pairs import start_from_pairs
    from poseviewer.starts.wheels import start_from_found_wheels, start_from_wheels

    if options.pairs is not None:
        return lambda inputs: start_from_pairs(inputs, load_pairs(options.pairs), camera)
    if options.find_wheels is not None:
        return lambda inputs: start_from_found_wheels(inputs, options.find_wheels, camera)
    return lambda inputs: start_from_wheels(inputs, wheels_from_text(options.wheels), camera)
