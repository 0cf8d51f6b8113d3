"""What the app gives away: pose records, pictures, maps."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from poseviewer.api import FitResult, picture_of_all
from poseviewer.app.state.document import Document, SceneObject
from poseviewer.app.state.hiding import compared_mask
from poseviewer.app.state.requests import Export
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import case_at, renderer_of
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.files.masks import mask_as_png, mask_path
from poseviewer.files.pose import (
    ChartParameters,
    ModelReference,
    PhotoReference,
    PoseRecord,
    record_as_json,
)
from poseviewer.files.scene import ObjectRecord, SceneRecord
from poseviewer.files.view_set import set_as_json, with_masks
from poseviewer.fit.settings import settings_as_json
from poseviewer.geometry.mask import Mask
from poseviewer.render.overlay.looks import SOLID_OPACITY, Picture


def record_of(session: Session) -> PoseRecord:
    """All that the pose file of the session says."""
    document, latest, overlay = session.document, session.own_search, session.overlay
    if document.searched is not None:
        return document.searched.filed or document.searched.record
    if document.views is not None:
        return _record_in_set(session)
    if latest is not None:
        case = latest.case.behind(latest.progress.hidden)
        return FitResult(case, document.pose, latest.progress).record
    known = overlay.unexplained if overlay is not None and overlay.loss_is_current else None
    if overlay is None or known is None or overlay.request.pose is not document.pose:
        return _plain_record(document)
    try:
        own, renderer = document.registration, renderer_of(document.registration.mesh).clone()
        case = case_at(own, document.pose, document.settings, renderer)
    except PoseViewerError:
        return _plain_record(document)  # a pose where nothing can be compared is a pose, too
    return FitResult(case, document.pose, known_loss=known.loss).record


def filed(session: Session) -> Session:
    """With the photo of a set large that its pose file is of."""
    document = session.document
    end, views = document.searched, document.views
    if end is None or views is None or end.filed is None or end.filed.photo is None:
        return session
    shas = [view.photo.sha256 for view in views.views.views]
    wanted = end.filed.photo.sha256
    return session.looking_at(shas.index(wanted)) if wanted in shas else session


def masks_in_set(document: Document) -> dict[str, Mask]:
    """What counts of each photo of a set, by their names; those of which all does are left out."""
    views = document.views
    found = {}
    for index, name in enumerate(() if views is None else views.names):
        mask = document.looking_at(index).compared_mask
        if mask is not None:
            found[name] = mask
    return found


def _record_in_set(session: Session) -> PoseRecord:
    """Of a pose in a set that no search has ended in: that of the large photo, with the losses as
    far as they are known.
    """
    document, overlay = session.document, session.overlay
    views, plain = document.views, _plain_record(document)
    assert views is not None  # whose record it is
    is_known = overlay is not None and overlay.loss_is_current
    if overlay is None or not is_known or overlay.request.pose is not document.pose:
        overlay = None
    known = {} if overlay is None else overlay.of_photos
    order = [views.at, *(i for i, on in enumerate(views.compared) if on and i != views.at)]
    records = []
    for index in order:
        photo, loss = views.views.views[index].photo, known.get(index)
        record = PoseRecord(
            views.poses[index],
            PhotoReference(photo.name, photo.width, photo.height, photo.sha256),
            undistortion=photo.undistortion,
        )
        if loss is not None:
            record = replace(record, loss=loss.loss, unexplained=loss.total)
        records.append(record)
    seen = replace(views.views, views=tuple(views.views.views[index] for index in order))
    symmetry = document.registration.symmetry
    in_set = set_as_json(seen, records, views.scale, views.free_size, symmetry)
    plain = replace(plain, in_set=in_set)
    if overlay is None or overlay.unexplained is None:
        return plain
    found = overlay.unexplained
    return replace(plain, loss=found.loss, unexplained=found.total)


def scene_of(session: Session) -> tuple[SceneRecord, dict[str, Mask]]:
    """All that the scene file of the session says, and the masks by the ids of objects.

    Raises:
        SettingsError: photo or models are in no file.
    """
    document = session.document
    photo, objects, masks = document.registration.photo, [], {}
    for one in document.objects:
        if one.model_path is None or document.photo_path is None:
            raise SettingsError(f"{one.label}: photo and models of a scene have to be files")
        record, mask = record_of(session), compared_mask(session)
        if one is not document:
            record = _plain_record(one) if one.searched is None else one.searched.record
            mask = one.compared_mask
        objects.append(ObjectRecord(str(one.number), one.model_path, record, one.name.strip()))
        if mask is not None:
            masks[str(one.number)] = mask
    assert document.photo_path is not None  # it was just looked at
    reference = PhotoReference(photo.name, photo.width, photo.height, photo.sha256)
    camera, lens = document.pose.camera, photo.undistortion
    return SceneRecord(document.photo_path, reference, camera, tuple(objects), lens), masks


def _plain_record(document: SceneObject) -> PoseRecord:
    registration, chart = document.registration, document.chart
    photo = registration.photo
    return PoseRecord(
        document.pose,
        PhotoReference(photo.name, photo.width, photo.height, photo.sha256),
        ModelReference(registration.mesh_name, registration.mesh_sha256, registration.mesh.unit),
        ChartParameters(chart.name, chart.names, tuple(float(v) for v in document.parameters)),
        None,
        settings_as_json(document.settings),
        {"name": "poseviewer", "version": version("poseviewer")},
        photo.undistortion,
        notes=tuple(filter(None, (photo.focal_note(document.pose.camera),))),
        without=registration.mesh.left_out,
        symmetry=registration.symmetry,
    )


def export(what: Export, session: Session) -> dict[str, bytes]:
    """The contents of files by their names: of maps, one for each loss that is shown.

    Raises:
        PoseViewerError: there is nothing of that kind yet.
    """
    session = filed(session) if what == "pose" else session
    photo = session.document.registration.photo
    stem = Path(photo.name).stem + (".undistorted" if photo.undistortion is not None else "")
    if what == "pose":
        name, record = f"{stem}.pose.json", record_of(session)
        mask, files = compared_mask(session), {}
        if record.in_set is not None and session.document.views is not None:
            record, beside = with_masks(Path(name), record, masks_in_set(session.document))
            files = {path.name: content for path, content in beside.items()}
        elif mask is not None:
            beside = mask_path(name).name
            record, files = replace(record, mask=beside), {beside: mask_as_png(mask)}
        text = json.dumps(record_as_json(record), indent=2, ensure_ascii=False)
        return {name: (text + "\n").encode(), **files}
    if what == "overlay":
        look = session.look  # the photo in its own size
        picture = picture_of(session.document, look.name, look.opacity)
        data = np.asarray(cv2.imencode(".png", picture[..., ::-1])[1]).tobytes()
        return {f"{stem}.overlay.png": data}
    kind = "png" if what == "sheet" else what.removeprefix("maps-")
    found = [update for update in session.landscapes if update.slices]
    if not found:
        raise SettingsError("there are no maps yet; wait for the first ones")
    endings = {"default": f"landscape.{kind}", "paper": f"landscape.paper.{kind}"}
    return {
        f"{stem}.{endings[update.case.settings.method]}": update.maps.as_bytes(kind)
        for update in found
    }


def picture_of(
    document: Document, look: str = "outline", opacity: float = SOLID_OPACITY
) -> Picture:
    """(height, width, 3) RGB: the photo with the picked object and all that stand in it."""
    objects = []
    for one in document.objects:
        if one is document or one.stands:
            own = document.picking(one.number)
            at = replace(own.registration, start=own.pose)
            objects.append((at, own.settings, renderer_of(at.mesh).clone()))
    return picture_of_all(objects, look, opacity)
