"""What the app gives away: pose records, pictures, maps."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from poseviewer.api import Case, FitResult, picture_of_all
from poseviewer.app.state.document import Document, SceneObject
from poseviewer.app.state.hiding import compared_mask
from poseviewer.app.state.requests import Export
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import case_at, renderer_of
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.files.masks import mask_as_png, mask_path
from poseviewer.files.photo import described, photo_text
from poseviewer.files.pose import (
    ChartParameters,
    ModelReference,
    PhotoReference,
    PoseRecord,
    record_as_json,
)
from poseviewer.files.scene import ObjectRecord, SceneRecord
from poseviewer.fit.settings import settings_as_json
from poseviewer.geometry.mask import Mask
from poseviewer.render.overlay.looks import SOLID_OPACITY, Picture


def record_of(session: Session) -> PoseRecord:
    """All that the pose file of the session says."""
    document, latest, overlay = session.document, session.own_search, session.overlay
    if document.searched is not None:
        return document.searched.record
    if latest is not None:
        case = latest.case.behind(latest.progress.hidden)
        return FitResult(case, document.pose, latest.progress).record
    known = overlay.unexplained if overlay is not None and overlay.loss_is_current else None
    if overlay is None or known is None or overlay.request.pose is not document.pose:
        return _plain_record(document)
    try:
        case = _case_of(session)
    except PoseViewerError:
        return _plain_record(document)  # a pose where nothing can be compared is a pose, too
    return FitResult(case, document.pose, known_loss=known.loss).record


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
    photo = session.document.registration.photo
    stem = Path(photo.name).stem + (".undistorted" if photo.undistortion is not None else "")
    if what == "pose":
        name, record = f"{stem}.pose.json", record_of(session)
        mask, files = compared_mask(session), {}
        if mask is not None:
            beside = mask_path(name).name
            record, files = replace(record, mask=beside), {beside: mask_as_png(mask)}
        text = json.dumps(record_as_json(record), indent=2, ensure_ascii=False)
        return {name: (text + "\n").encode(), **files}
    if what == "overlay":
        return {f"{stem}.overlay.png": _overlay(session)}
    kind = "png" if what == "sheet" else what.removeprefix("maps-")
    found = [update for update in session.landscapes if update.slices]
    if not found:
        raise SettingsError("there are no maps yet; wait for the first ones")
    endings = {"default": f"landscape.{kind}", "paper": f"landscape.paper.{kind}"}
    return {
        f"{stem}.{endings[update.case.settings.method]}": update.maps.as_bytes(kind)
        for update in found
    }


def _overlay(session: Session) -> bytes:
    """The photo, in its own size, with its objects in the look that is shown; PNG."""
    look = session.look
    picture = picture_of(session.document, look.name, look.opacity)
    data = np.asarray(cv2.imencode(".png", picture[..., ::-1])[1]).tobytes()
    return described(data, photo_text(session.document.registration.photo))


def picture_of(
    document: Document, look: str = "outline", opacity: float = SOLID_OPACITY
) -> Picture:
    """(height, width, 3) RGB: the photo with the picked object and all that stand in it.

    Raises:
        PoseViewerError: one of them cannot be compared with the photo.
    """
    objects = []
    for one in document.objects:
        if one is document or one.stands:
            own = document.picking(one.number)
            at = replace(own.registration, start=own.pose)
            objects.append((at, own.settings, renderer_of(at.mesh).clone()))
    return picture_of_all(objects, look, opacity)


def _case_of(session: Session) -> Case:
    document = session.document
    renderer = renderer_of(document.registration.mesh).clone()
    return case_at(document.registration, document.pose, document.settings, renderer)
