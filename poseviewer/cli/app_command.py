"""Open the app."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.case import calibration_of, choice_of, named_files, refuse, refuse_beside
from poseviewer.cli.options import CAMERA, MASK, MODEL, SERVER, VIEWS, WITHOUT, option
from poseviewer.cli.terminal import say
from poseviewer.errors import SettingsError
from poseviewer.fit.settings import CHOICES

if TYPE_CHECKING:
    from poseviewer.app.state.document import Document
    from poseviewer.files.file_set import FileSet

OPTIONS = {
    "": (
        option("photo PHOTO|FOLDER|ZIP|SCENE.json", "what is to be opened", nargs="?"),
        MODEL,
        option("--pose POSE.json", "the start"),
        option("--method", "chosen at first", CHOICES["method"], default="default"),
        MASK,
        WITHOUT,
        *SERVER,
    ),
    **VIEWS,
    **CAMERA,
}


def _files_of(options: Namespace) -> tuple[FileSet, list[Path]]:
    """The files that are named, or lie in a folder or a zip that is; and where their models lie
    with all that they name.
    """
    path: Path | None = options.photo
    if options.views or not (path and (path.is_dir() or path.suffix.lower() == ".zip")):
        files = named_files(options)
        return files, [model.path for model in files.models]
    from poseviewer.files.file_set import files_below, sort_set
    from poseviewer.files.state.folder import state_folder
    from poseviewer.files.state.uploads import gathered, keep_zip

    uploads = state_folder() / "uploads"
    files = sort_set(files_below(path if path.is_dir() else keep_zip(uploads, path)))
    for note in files.notes:
        say(f"{path}: {note}")
    models = [options.model] if options.model else [gathered(uploads, m) for m in files.models]
    return replace(files, pose=options.pose or files.pose), models


def _opening(options: Namespace) -> Callable[[], Document]:
    """Return a function that opens all that is named, or the demo."""
    calibration, (files, models) = calibration_of(options), _files_of(options)
    photo, pose, views, scene = files.photo, files.pose, files.views, files.scene
    if options.photo is None:
        which = ("pose", "mask", "without", "calibration")
        refuse(options, which, "without PHOTO and MODEL; name all three")
    elif scene is None and not (models and (photo or views)):
        what = "model" if photo or views else "photo"
        raise SettingsError(f"{options.photo}: no {what} was found; name PHOTO and MODEL")
    if views is not None:
        refuse_beside(options, "a set of photos", ("mask", "calibration"))
    elif calibration is None and files.camera is not None:
        from poseviewer.files.cameras import Calibration

        calibration = Calibration(files.camera)
    for path in filter(None, (photo, scene, *models, pose, options.mask, views)):
        if not (path.is_file() or (path == views and path.is_dir())):  # before there is a page
            raise SettingsError(f"{path}: no such file; check the path")

    if scene is not None:  # a damaged file is said before there is a page
        from poseviewer.files.scene_file import load_scene

        load_scene(scene)

    def open_first() -> Document:
        from poseviewer.app.workers.opening import open_files, open_scene, open_set
        from poseviewer.files.demo import demo_case

        without = options.without or ()
        if scene is not None:
            return open_scene(scene, without)
        if views is not None:
            chosen = choice_of(options), options.view, options.scale, without
            return open_set(views, models[0], pose, *chosen)
        if photo is None:
            case = demo_case("perspective")
            return open_files(case.photo, case.model, case.start)
        return open_files(photo, models[0], pose, calibration, options.mask, without, models[1:])

    return open_first


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    opening = _opening(options)
    from poseviewer.app.serving import serve_app

    def open_first() -> tuple[Document, None]:
        document = opening()
        settings = document.settings.of_method(options.method)
        return document.with_object(settings=settings), None

    serve_app(
        open_first,
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=say,
    )
    return 0
