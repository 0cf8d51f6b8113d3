"""Exports of the app: pose files, pictures, maps."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal
from zipfile import ZipFile

import cv2
import numpy as np
from msgspec import structs

from poseviewer import api
from poseviewer.app.state.document import Document, is_shown, label_of
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.errors import SettingsError
from poseviewer.files.formats.conversion import METRES, ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.masks import mask_as_png, mask_path
from poseviewer.files.pose import pose_bytes
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.files.state.uploads import safe_path
from poseviewer.files.writing import json_bytes
from poseviewer.render.overlay.styles import SOLID_OPACITY, Picture
from poseviewer.scene.settings import settings_as_json
from poseviewer.scene.types import ChartParameters, Scene, SearchResult
from poseviewer.starts.measuring import measure_relative

Export = Literal["pose", "overlay", "sheet", "maps-npz"] | str
"""Name of a download of the page, or a key of ``CONVERTED``."""
RELATIVE = "relative poses"
"""Name of the active object's poses in the frames of all others."""
CONVERTED = {
    **{name: known.ending for name, known in FORMATS.items() if not known.is_own},
    "masks, depth, normals": "",
    RELATIVE: ".relative.json",
}
"""Other tools' formats, pictures, relative poses, and the ending of each; "": a folder."""
MAX_STEM_LETTERS = 90
"""Bytes of a photo's and a model's name each: file systems take 255 in all."""


def scene_to_save(session: Session) -> Scene:
    """The scene, an unsearched active object with its loss, if it is known, and its numbers."""
    own, losses = session.document, session.results.losses
    if own.object.result is not None:
        return own.scene
    known = losses.mean if losses and losses.request.at_pose == session.at_pose else None
    chart = own.chart
    result = SearchResult(
        loss=None if known is None else known.loss,
        unexplained=None if known is None else known.total,
        chart=ChartParameters(chart.name, chart.names, tuple(own.parameters.tolist())),
        settings=settings_as_json(own.settings),
        notes=tuple(filter(None, (own.photo.focal_note(own.pose.camera),))),
        view=own.view_index,
    )
    return own.scene.with_object(own.active, result=result)


def pose_file_view(document: Document) -> int:
    """The view that the pose file is of: where the search was, or else the large one."""
    return document.view_index if document.object.result is None else document.object.result.view


def stem_of(document: Document, view: int) -> str:
    """``PHOTO.MODEL``, as files of a pose are named, of several objects ``PHOTO``; safe on any
    system, and short enough for what follows it.
    """
    names = [document.scene.views[view].photo.name]
    names += [document.model.name] * (len(document.scene.objects) == 1)
    stems = (safe_path(name).stem.encode() for name in names)
    return ".".join(stem[:MAX_STEM_LETTERS].decode(errors="ignore") for stem in stems)


def _export_stem(document: Document, view: int, of_all: bool = False) -> str:
    """``PHOTO.OBJECT``, so that no object's file replaces another's; ``PHOTO`` of several ones."""
    one, objects = document.object, document.scene.objects
    if of_all or len(objects) == 1:
        return stem_of(document, view)
    name = one.name.strip() or Path(one.model.name).stem
    name += f".{one.id}" * ([label_of(other) for other in objects].count(label_of(one)) > 1)
    own = safe_path(name).name.encode()[:MAX_STEM_LETTERS].decode(errors="ignore")
    return f"{stem_of(document, view)}.{own}"


def export(what: Export, session: Session, unit: str = "") -> dict[str, bytes]:
    """The contents of files by their names: of maps, one for each loss that is shown; ``unit``: the
    model's, in place of what it says; raises ``PoseViewerError``: there is nothing of that kind
    yet, or a format wants to know the unit.
    """
    own = session.document
    if what == RELATIVE:
        return _relative_poses(own)
    if what in CONVERTED:
        return _convert(what, session, unit if unit in METRES else None)
    view = pose_file_view(own) if what == "pose" else own.view_index
    photo = own.scene.views[view].photo
    stem = _export_stem(own, view)
    if what == "pose":
        name, scene = f"{stem}.pose.json", scene_to_save(session)
        record, mask = pose_json(as_saved(scene), own.active, view), scene.mask(own.active, view)
        beside = mask_path(name).name
        record = structs.replace(record, mask=None if mask is None else beside)
        files = {} if mask is None else {beside: mask_as_png(mask)}
        return {name: pose_bytes(Path(name), record), **files}
    stem += ".undistorted" * (photo.undistortion is not None)
    if what == "overlay":
        picture = picture_of(
            own, session.display.style, session.display.opacity
        )  # of the photo's own size
        data = np.asarray(cv2.imencode(".png", picture[..., ::-1])[1]).tobytes()
        return {f"{stem}.overlay.png": data}
    kind = "png" if what == "sheet" else what.removeprefix("maps-")
    mapped = [update for update in session.results.landscapes if update.slices]
    if not mapped:
        raise SettingsError("there are no maps yet; wait for the first ones")
    endings = {"default": f"landscape.{kind}", "paper": f"landscape.paper.{kind}"}
    return {
        f"{stem}.{endings[update.problem.settings.loss]}": update.maps.as_bytes(kind)
        for update in mapped
    }


def _convert(what: str, session: Session, unit: str | None) -> dict[str, bytes]:
    """One file of another tool, or a zip of several; of all objects where it holds several."""
    own, scene = session.document, as_saved(scene_to_save(session))
    of_all = what not in FORMATS or FORMATS[what].several_objects
    stem = _export_stem(own, own.view_index, of_all)
    with TemporaryDirectory() as folder:
        out = Path(folder, f"{stem}{CONVERTED[what]}")
        if what in FORMATS:
            if not FORMATS[what].several_objects:
                scene = replace(scene, objects=(scene.objects[own.active],))
            options = ConvertOptions(image="0", object_id=1, unit=unit, overwrite=True)
            FORMATS[what].convert(scene, out, options)
        else:
            from poseviewer.figures.object_maps import (  # numba takes a quarter of a second
                pictures_of_objects,
                save_pictures,
            )

            save_pictures(out, pictures_of_objects(scene), overwrite=True)
        files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        if len(files) == 1:
            return {files[0].name: files[0].read_bytes()}
        memory = BytesIO()
        with ZipFile(memory, "w") as archive:
            for path in files:
                archive.write(path, path.relative_to(folder))
        return {f"{stem}.{what.partition(',')[0]}.zip": memory.getvalue()}


def _relative_poses(own: Document) -> dict[str, bytes]:
    """The active object's pose in the frame of every other one (JSON)."""
    name, placed = Path(own.photo.name).stem + CONVERTED[RELATIVE], own.object.is_placed
    others = [(i, item) for i, item in enumerate(own.scene.objects) if item.is_placed and placed]
    poses = [
        {"frame": label_of(item), **measure_relative(own.scene, own.active, i)}
        for i, item in others
        if i != own.active
    ]
    if not poses:
        raise SettingsError("relative poses are between objects that are placed; add another one")
    data = {"object": label_of(own.object), "unit": own.mesh.unit, "poses": poses}
    return {name: json_bytes(Path(name), data, SettingsError)}


def picture_of(
    document: Document, look: str = "outline", opacity: float = SOLID_OPACITY
) -> Picture:
    """(height, width, 3) RGB: the photo with the active object and all that stand in it."""
    objects = tuple(
        replace(one, hidden=index != document.active and not is_shown(one))
        for index, one in enumerate(document.scene.objects)
    )
    meshes = {one.mesh for one in objects if not one.hidden}
    renderers = {mesh: renderer_of(mesh).clone() for mesh in meshes}
    index = 0 if len(objects) == 1 else None
    scene = replace(document.scene, objects=objects)
    shown = api.Registration(scene, renderers, index, document.view_index)
    return shown.picture(look, opacity=opacity)
