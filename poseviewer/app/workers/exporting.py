"""Downloads of the app: pose files, pictures, maps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal
from zipfile import ZipFile

import cv2
import numpy as np

from poseviewer import api
from poseviewer.app.state.document import Document, is_shown, label_of
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.maps import is_fine, maps_about
from poseviewer.errors import SettingsError
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.gltf_export import painting_contents
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.formats.sequence_export import (
    SEQUENCE_FORMATS,
    SequencePictures,
    export_sequence,
)
from poseviewer.files.masks import pose_contents
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.files.writing import json_bytes, safe_path
from poseviewer.geometry.mesh import Mesh
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.render.attributes import Renderer
from poseviewer.render.overlay.styles import SOLID_OPACITY, Picture
from poseviewer.scene.measuring import measure_relative
from poseviewer.scene.sequence import as_still, stale_notes
from poseviewer.scene.settings import settings_as_json
from poseviewer.scene.types import ChartParameters, Scene, SceneObject, SearchResult

Export = Literal["pose", "overlay", "painted", "sheet", "maps-npz"] | str
"""Name of a download, or a key of ``CONVERTED``."""
RELATIVE = "relative poses"
"""Name of the active object's poses in the frames of the others."""
CONVERTED = {
    **{name: known.ending for name, known in FORMATS.items() if not known.is_own},
    "masks, depth, normals": "",
    RELATIVE: ".relative.json",
}
"""Endings of other tools' formats, pictures and relative poses; "": a folder."""
OF_FRAMES = {f"all frames: {name}": name for name in SEQUENCE_FORMATS}
"""Formats of a sequence, by the names of their downloads."""
WITH_NUMBERS = ("bop", "all frames: bop")
"""Those that have numbers in place of names; frames have theirs by their names."""
MAX_DOWNLOAD_BYTES = 1_000_000_000
"""Limit of a download, which is in memory."""
MAX_STEM_BYTES = 90
"""Bytes of a photo's and a model's name each: file systems take 255 in all."""


def scene_to_save(session: Session) -> Scene:
    """The scene; an active object without a result gets its parameters and its loss, if known."""
    document, losses = session.document, session.results.losses
    if document.object.result is not None:
        return document.scene
    mean = losses.mean if losses and losses.at_pose == session.at_pose else None
    chart, focal_note = document.chart, document.photo.focal_note(document.pose.camera)
    result = SearchResult(
        loss=mean and mean.loss,
        unexplained=mean and mean.total,
        chart=ChartParameters(chart.name, chart.names, tuple(document.parameters.tolist())),
        settings=settings_as_json(document.settings),
        notes=(focal_note,) if focal_note else (),
        view=document.view_index,
    )
    return document.scene.with_object(document.active, result=result)


def pose_file_view(document: Document) -> int:
    """Index of the view whose pose is saved: that of the search, or else the large one."""
    return document.view_index if document.object.result is None else document.object.result.view


def stem_of(document: Document, view: int, of_sequence: bool = False) -> str:
    """Stem of a pose's files: ``PHOTO.MODEL``, or ``PHOTO`` for several objects; safe and short.
    That of a sequence has the folder of its frames in place of the photo.
    """
    file = document.scene.views[view].file
    names = [file.location.absolute().parent.name if of_sequence else Path(file.name).name]
    names += [document.model.name] * (len(document.scene.objects) == 1)
    stems = (safe_path(name).stem.encode() for name in names)
    return ".".join(stem[:MAX_STEM_BYTES].decode(errors="ignore") for stem in stems)


def _export_stem(document: Document, view: int, of_all: bool = False) -> str:
    """Stem of a download, ``PHOTO.OBJECT``, which is unique; ``PHOTO`` for all objects."""
    item, objects = document.object, document.scene.objects
    if of_all or len(objects) == 1:
        return stem_of(document, view)
    name = item.name.strip() or Path(item.model.name).stem
    name += f".{item.id}" * ([label_of(other) for other in objects].count(label_of(item)) > 1)
    name = safe_path(name).name.encode()[:MAX_STEM_BYTES].decode(errors="ignore")
    return f"{stem_of(document, view)}.{name}"


def export(
    what: Export,
    session: Session,
    notes: list[str] | None = None,
    numbers: ConvertOptions | None = None,
    tell: Callable[[float, int], object] = lambda *_: None,
) -> dict[str, bytes]:
    """Contents of a download's files by their names.

    Args:
        what: name of the download.
        session: to take it from.
        notes: sentences on a conversion are added to it.
        numbers: of the image and the objects in BOP.
        tell: is given the number of frames that are drawn, and that of all.

    Raises:
        PoseViewerError: there is nothing of that kind yet, or a format needs the unit or numbers.
    """
    document, notes = session.document, [] if notes is None else notes
    if document.scene.frames and what not in OF_FRAMES:
        notes += stale_notes(document.scene, [document.scene.frame_index])
    if what == RELATIVE:
        return _relative_poses(document)
    if what in {**CONVERTED, **OF_FRAMES}:
        options = replace(numbers or ConvertOptions(), overwrite=True)
        return _convert(what, session, options, notes, tell)
    view = pose_file_view(document) if what == "pose" else document.view_index
    stem = _export_stem(document, view)
    if what == "pose":
        at, scene = (document.active, view), as_saved(scene_to_save(session))
        masks = scene.mask(*at), scene.occluders(*at)
        files = pose_contents(Path(f"{stem}.pose.json"), pose_json(scene, *at), *masks)
        return {path.name: files[path] for path in reversed(files)}
    if what == "painted":
        painting = document.object.painting
        if painting is None:
            raise SettingsError("the model is not painted; paint it in the step Judge")
        return {f"{stem}.painted.glb": painting_contents(painting)}
    stem += ".undistorted" * (document.view.file.undistortion is not None)
    if what == "overlay":
        picture = picture_of(document, session.display.style, session.display.opacity)
        data = np.asarray(cv2.imencode(".png", picture[..., ::-1])[1]).tobytes()
        return {f"{stem}.overlay.png": data}
    kind = "png" if what == "sheet" else what.removeprefix("maps-")
    mapped = [update for update in session.results.landscapes if update.slices]
    if not mapped:
        raise SettingsError("there are no maps yet; wait for the first ones")
    if not all(map(is_fine, mapped)):
        raise SettingsError("the maps are still coarse; save them once they are fine, at rest")
    names = (update.problem.settings.loss for update in mapped)
    whose = ("" if name == DEFAULT.name else f".{name}" for name in names)
    return {
        f"{stem}.landscape{of}.{kind}": maps_about(maps, session).as_bytes(kind)
        for of, maps in zip(whose, mapped, strict=True)
    }


def _convert(
    what: str,
    session: Session,
    options: ConvertOptions,
    notes: list[str],
    tell: Callable[[float, int], object],
) -> dict[str, bytes]:
    """Convert to one file, or a zip of several; for all objects if the format holds several."""
    document, scene = session.document, as_saved(scene_to_save(session))
    of_all = what not in FORMATS or FORMATS[what].several_objects
    stem, kind = _export_stem(document, document.view_index, of_all), OF_FRAMES.get(what)
    is_of_many = scene.has_many_views and what in FORMATS and FORMATS[what].several_of_both
    stem = stem_of(document, 0, of_sequence=True) if kind or is_of_many else stem
    from poseviewer.figures.object_maps import (  # numba takes a quarter of a second
        pictures_of_objects,
        save_pictures,
        write_masks,
    )

    with TemporaryDirectory() as folder:
        out = Path(folder, f"{stem}{CONVERTED[what] if kind is None else SEQUENCE_FORMATS[kind]}")
        if kind is not None:
            renderers = _renderers_of(scene.objects)
            done = count(1)

            def draw(shown: Scene) -> Picture:
                tell(next(done), len(scene.frames))
                return api.Registration(shown, renderers).whole.picture("outline")

            def masks(shown: Scene, number: int) -> Mapping[str, bytes]:
                tell(next(done), len(scene.frames))
                return pictures_of_objects(shown, number, masks_alone=True)

            pictures = SequencePictures(draw, masks)
            notes += export_sequence(kind, scene, out, options, pictures)[1]
        elif what in FORMATS:
            scene = as_still(scene)
            if not FORMATS[what].several_objects:
                scene = replace(scene, objects=(scene.objects[document.active],))
            notes += FORMATS[what].convert(scene, out, options)[1]
            notes += write_masks(scene, out, options, tell) if what == "bop" else []
        else:
            save_pictures(out, pictures_of_objects(scene), overwrite=True)
        files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        if sum(path.stat().st_size for path in files) > MAX_DOWNLOAD_BYTES:
            found = f"these files have more than {MAX_DOWNLOAD_BYTES:,} bytes"
            raise SettingsError(f"{found}; save the scene, and write them by poseviewer convert")
        if len(files) == 1:
            return {files[0].name: files[0].read_bytes()}
        memory = BytesIO()
        with ZipFile(memory, "w") as archive:
            for path in files:
                archive.write(path, path.relative_to(folder))
        return {f"{stem}.{kind or what.partition(',')[0]}.zip": memory.getvalue()}


def _renderers_of(objects: Sequence[SceneObject]) -> dict[Mesh, Renderer]:
    """Renderers of all surfaces of objects, as they are drawn and compared."""
    meshes = {mesh for item in objects for mesh in (item.drawn_mesh, item.compared_mesh)}
    return {mesh: renderer_of(mesh).clone() for mesh in meshes}


def _relative_poses(document: Document) -> dict[str, bytes]:
    """JSON file of the active object's pose in the frame of every other one."""
    name = Path(document.photo.name).stem + CONVERTED[RELATIVE]
    poses = [
        {"frame": label_of(item), **measure_relative(document.scene, document.active, index)}
        for index, item in enumerate(document.scene.objects)
        if document.object.is_placed and item.is_placed and index != document.active
    ]
    if not poses:
        raise SettingsError("relative poses are between objects that are placed; add another one")
    data = {"object": label_of(document.object), "unit": document.model.unit, "poses": poses}
    return {name: json_bytes(Path(name), data, SettingsError)}


def picture_of(
    document: Document, look: str = "outline", opacity: float = SOLID_OPACITY
) -> Picture:
    """Draw the active object and all shown ones over the photo: (height, width, 3), RGB."""
    objects = tuple(
        replace(item, hidden=index != document.active and not is_shown(item))
        for index, item in enumerate(document.scene.objects)
    )
    renderers = _renderers_of([item for item in objects if not item.hidden])
    index = 0 if len(objects) == 1 else None
    scene = replace(document.scene, objects=objects)
    shown = api.Registration(scene, renderers, index, document.view_index)
    return shown.picture(look, opacity=opacity)
