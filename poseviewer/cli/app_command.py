"""Open the app in the browser, on the files named or on the bundled demo."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import SAYS, calibration_of, load_named_sequence, sort_named_files
from poseviewer.cli.terminal import say
from poseviewer.errors import SettingsError
from poseviewer.losses.default_loss import DEFAULT

if TYPE_CHECKING:
    from poseviewer.app.state.document import Document
    from poseviewer.files.file_set import FileSet

OPTIONS = {
    "": (
        table.option(
            "photo PHOTO|FOLDER|ZIP|VIDEO|SCENE.json",
            "photo, frames of a sequence (a folder or a video), or all files together",
            nargs="?",
        ),
        table.MODEL,
        table.POSE,
        *table.METHODS,
        table.MASK,
        table.WITHOUT,
        table.APP_RENDERER,
        table.FEATURES,
        *table.SERVER,
    ),
    "a sequence": table.SEQUENCE,
    **table.VIEWS,
    **table.CAMERA,
}
EXAMPLES = (
    "poseviewer photo.jpg car.glb --pose start.json",
    "poseviewer app clip.mp4 car.glb --every 5",
)


def _files_of(options: Namespace) -> tuple[FileSet, list[Path]]:
    """Sort the files named, or those of a folder or zip; find the files that models refer to."""
    from poseviewer.files.video import VIDEOS

    path: Path | None = options.photo
    if path and path.suffix.lower() in VIDEOS and not options.views:
        files = replace(sort_named_files(options), photo=None, frames=(path,))
        return files, [model.path for model in files.models]
    if options.views or not (path and (path.is_dir() or path.suffix.lower() == ".zip")):
        files = sort_named_files(options)
        return files, [model.path for model in files.models]
    from poseviewer.files.file_set import files_below, sort_set
    from poseviewer.files.state.folder import state_folder
    from poseviewer.files.state.uploads import gather, keep_zip

    uploads = state_folder() / "uploads"
    files = sort_set(files_below(path if path.is_dir() else keep_zip(uploads, path)))
    for note in files.notes:
        say(f"{path}: {note}")
    models = [options.model] if options.model else [gather(uploads, m) for m in files.models]
    return replace(files, pose=options.pose or files.pose), models


def _opening(options: Namespace) -> Callable[[], Document]:
    """Return a function that opens the files named, or the demo."""
    from poseviewer.files.cameras import Calibration

    calibration, (files, models) = calibration_of(options), _files_of(options)
    if options.photo is None:
        of_photo = (table.POSE, table.MASK, table.WITHOUT, table.CALIBRATION)
        table.refuse(options, of_photo, "without PHOTO and MODEL; name all three")
    elif files.scene is None and not (models and (files.photo or files.views or files.frames)):
        what = "model" if files.photo or files.views or files.frames else "photo"
        raise SettingsError(f"{options.photo}: no {what} was found; name PHOTO and MODEL")
    if files.views is not None:
        table.refuse(options, (table.MASK, table.CALIBRATION), SAYS.format("a set of photos"))
    elif calibration is None and files.camera is not None:
        calibration = Calibration(files.camera)
    if not files.frames:
        table.refuse(options, table.SEQUENCE, "without a video or a folder of frames; leave it out")
    named = (
        *files.frames[:1],
        files.photo,
        files.scene,
        *models,
        files.pose,
        options.mask,
        files.views,
    )
    for path in filter(None, named):  # an error is printed before the page opens
        if not (path.is_file() or (path == files.views and path.is_dir())):
            raise SettingsError(f"{path}: no such file; check the path")
    sequence = load_named_sequence(options, files.frames) if files.frames else None
    if files.scene is not None:
        from poseviewer.files.scene_json import load_scene

        load_scene(files.scene)

    def open_first() -> Document:
        from poseviewer.app.workers.opening import open_files, open_scene, open_set
        from poseviewer.files.demo import demo_case
        from poseviewer.files.photo_sets import SetChoice

        without, pose = options.without or (), files.pose
        if files.scene is not None:
            return open_scene(files.scene, without)
        if files.views is not None:
            choice = table.make(SetChoice, options)
            return open_set(files.views, models[0], pose, choice, without)
        if photo := sequence or files.photo:
            chosen = calibration, options.mask, without, models[1:]
            return open_files(photo, models[0], pose, *chosen)
        case = demo_case()
        return open_files(case.photo, case.model, case.start)

    return open_first


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    opening = _opening(options)
    from poseviewer.app.serving import serve_app
    from poseviewer.render.renderers import require_renderer

    def open_first() -> tuple[Document, None]:
        document = opening()
        settings = document.settings.of_loss(options.loss or DEFAULT.name)
        settings = replace(settings, search=options.search or "auto")
        document = document.with_object(settings=settings).with_renderer(options.renderer or "auto")
        require_renderer(document.settings.renderer)
        return document, None

    features: Path | None = options.features
    if features is not None:
        from poseviewer.starts.dino_features import PatchEncoder

        PatchEncoder.load(features)  # an error is printed before the page opens
    serve_app(open_first, tell=say, features=features, **table.values(options, table.SERVER))
    return 0
