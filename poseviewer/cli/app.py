"""Open the app."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.options import (
    COMPARED,
    add_calibration,
    add_fields,
    add_server,
    add_views,
    calibration_of,
    choice_of,
    option,
    refuse,
    refuse_beside,
    refuse_views,
)
from poseviewer.cli.terminal import say
from poseviewer.errors import SettingsError
from poseviewer.files.scene import is_scene_file
from poseviewer.fit.settings import FitSettings

if TYPE_CHECKING:
    from poseviewer.app.workers.opening import Opened
    from poseviewer.files.file_set import FileSet


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer [PHOTO MODEL]``."""
    option(parser, "photo PHOTO|FOLDER|ZIP|SCENE.json", "what is to be opened", Path, nargs="?")
    option(parser, "model MODEL", kind=Path, nargs="?")
    option(parser, "--pose POSE.json", "the start", Path)
    fields = {name: COMPARED[name] for name in ("mask", "without")}
    add_fields(parser, FitSettings, {"method": ("--method", "chosen at first"), **fields})
    add_views(parser)
    add_server(parser)
    add_calibration(parser)


def _files_of(path: Path) -> tuple[FileSet, list[Path]]:
    """What a folder or a zip holds, and where its models lie with all that they name."""
    from poseviewer.files.file_set import files_below, sort_set
    from poseviewer.files.state.folder import state_folder
    from poseviewer.files.state.uploads import gathered, keep_zip

    uploads = state_folder() / "uploads"
    files = sort_set(files_below(path if path.is_dir() else keep_zip(uploads, path)))
    for note in files.notes:
        say(f"{path}: {note}")
    return files, [gathered(uploads, model) for model in files.models]


def _opening(options: Namespace) -> Callable[[], Opened]:
    """What opens all that is named, or the demo."""
    photo, model, pose, views = options.photo, options.model, options.pose, options.views
    calibration, objects, scene = calibration_of(options), [], False
    if views is not None:
        if photo is None or model is not None:
            raise SettingsError("--views SET wants MODEL alone: the set says the photos")
        photo, model = None, photo
    else:
        refuse_views(options)
    if photo is None and views is None:
        files = ("pose", "mask", "without", "calibration")
        refuse(options, files, "without PHOTO and MODEL; name all three")
    elif photo is not None and (photo.is_dir() or photo.suffix.lower() == ".zip"):
        folder, (files, models) = photo, _files_of(photo)
        models = models if model is None else [model]
        model, objects = next(iter(models), None), models[1:]
        photo, views, pose = files.photo or files.scene, files.views, pose or files.pose
        scene = files.scene is not None
        if not (photo or views) or (model is None and not scene):
            what = "model" if photo or views else "photo"
            raise SettingsError(f"{folder}: no {what} was found in it; name PHOTO and MODEL")
        if calibration is None and files.camera is not None and views is None:
            from poseviewer.files.cameras import Calibration

            calibration = Calibration(files.camera)
    elif photo is not None:
        scene = is_scene_file(photo)
        if scene and (model or pose or options.mask):
            raise SettingsError(f"{photo}: a scene file says what is where; leave out all but that")
        if model is None and not scene:
            raise SettingsError(f"{photo}: a photo without a model; name PHOTO and MODEL")
    if views is not None:
        refuse_beside(options, "a set of photos", ("mask", "calibration"))
    for path in filter(None, (photo, model, pose, options.mask, views)):
        if not (path.is_file() or (path == views and path.is_dir())):  # before there is a page
            raise SettingsError(f"{path}: no such file; check the path")

    def open_first() -> Opened:
        from poseviewer.app.workers.opening import open_files, open_scene, open_set
        from poseviewer.files.demo import demo_case

        without = options.without or ()
        if views is not None and model is not None:
            chosen = choice_of(options), options.view, options.scale, without
            return open_set(views, model, pose, *chosen)
        if photo is not None and scene:
            return open_scene(photo, without)
        if photo is None or model is None:
            case = demo_case("perspective")
            return open_files(case.photo, case.model, case.start)
        return open_files(photo, model, pose, calibration, options.mask, without, objects)

    return open_first


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    open_first = _opening(options)
    from poseviewer.app.serving import serve_app

    def opened() -> tuple[Opened, None]:
        from poseviewer.app.workers.opening import by_method

        return by_method(open_first(), options.method or "default"), None

    serve_app(
        opened,
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=say,
    )
    return 0
