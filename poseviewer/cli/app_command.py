"""Open the app in the browser, on the files named or on the bundled demo."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import SAYS, calibration_of, load_named_sequence, mask_of, name_files
from poseviewer.cli.terminal import say
from poseviewer.errors import SettingsError
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.scene.settings import FitSettings

if TYPE_CHECKING:
    from poseviewer.app.state.document import Document
    from poseviewer.opening.sources import Sources

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
        table.MASK_LABEL,
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


def _named_files(options: Namespace) -> Sources:
    """Return the files named, or those of a folder or zip, with all that models refer to."""
    from poseviewer.files.demo import demo_case
    from poseviewer.files.state.folder import state_folder
    from poseviewer.files.video import VIDEOS
    from poseviewer.opening.sources import ModelFiles, Sources, files_below, sort_set
    from poseviewer.opening.uploads import gather, keep_zip

    path: Path | None = options.photo
    suffix = "" if path is None or options.views else path.suffix.lower()
    if path and not options.views and (path.is_dir() or suffix == ".zip"):
        uploads = state_folder() / "uploads"
        files = sort_set(files_below(path if path.is_dir() else keep_zip(uploads, path)))
        for note in files.notes:
            say(f"{path}: {note}")
        named = [options.model] if options.model else [gather(uploads, m) for m in files.models]
        models = tuple(map(ModelFiles, named))
        return replace(files, models=models, start=options.pose or files.start, unused=())
    files = name_files(options)
    if path is None:
        of_photo = (table.POSE, table.MASK, table.MASK_LABEL, table.WITHOUT, table.CALIBRATION)
        table.refuse(options, of_photo, "without PHOTO and MODEL; name all three")
        case = demo_case()
        return Sources(case.photo, model=case.model, start=case.start)
    return replace(files, photo=None, frames=(path,)) if suffix in VIDEOS else files


def _sources(options: Namespace) -> Sources:
    """Return the files named, or the demo's; an error is raised before the page opens."""
    from poseviewer.files.scene_json import load_scene
    from poseviewer.opening.photo_sets import SetChoice

    calibration, files = calibration_of(options), _named_files(options)
    shown = files.photo or files.views or files.frames
    if files.scene is None and not ((files.model or files.models) and shown):
        what = "model" if shown else "photo"
        raise SettingsError(f"{options.photo}: no {what} was found; name PHOTO and MODEL")
    more = {"calibration": calibration or files.calibration, "mask": mask_of(options)}
    if files.views is not None:
        more["choice"] = table.make(SetChoice, options)
    else:
        table.refuse(options, table.OF_VIEWS, "without a set of photos; leave it out")
    if files.scene is not None or files.views is not None:
        what = "a scene" if files.scene is not None else "a set of photos"
        table.refuse(options, (table.MASK, table.CALIBRATION), SAYS.format(what))
    if not files.frames:
        table.refuse(options, table.SEQUENCE, "without a video or a folder of frames; leave it out")
    models = (files.model, *(model.path for model in files.models))
    frames = files.frames[:1] if isinstance(files.frames, tuple) else ()
    named = (*frames, files.photo, files.scene, *models, files.start, options.mask, files.views)
    for path in named:
        is_set = path is not None and path == files.views
        if isinstance(path, Path) and not (path.is_file() or (is_set and path.is_dir())):
            raise SettingsError(f"{path}: no such file; check the path")
    if files.frames:
        files = replace(files, frames=load_named_sequence(options, files.frames))
    if isinstance(files.scene, Path):
        load_scene(files.scene)
    if options.without:
        more["settings"] = FitSettings(without=tuple(options.without))
    return replace(files, **more)


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    sources = _sources(options)
    from poseviewer.app.serving import serve_app
    from poseviewer.app.workers.opening import open_sources
    from poseviewer.render.renderers import require_renderer

    def open_first() -> tuple[Document, None]:
        document = open_sources(sources)
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
