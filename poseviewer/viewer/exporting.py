"""What the app gives away: pose records, pictures, maps."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.files.calibrated_photo import photo_text
from poseviewer.files.landscape_file import landscape_csv_bytes, landscape_npz_bytes
from poseviewer.files.picture_text import described
from poseviewer.files.pose_file import (
    ChartNumbers,
    ModelReference,
    PhotoReference,
    PoseRecord,
    record_as_json,
)
from poseviewer.fit.lighting import recover_lighting
from poseviewer.geometry.arrays import FloatArray
from poseviewer.registration import (
    make_photo_attributes,
    make_record,
    settings_as_json,
    shown_attributes,
)
from poseviewer.render.attributes import AttributeImage
from poseviewer.render.moments import model_attributes
from poseviewer.render.overlay import View, draw_look
from poseviewer.render.software import SoftwareRenderer
from poseviewer.session.jobs import landscape_problem
from poseviewer.session.session import Session
from poseviewer.viewer.requests import Export


def record_of(session: Session) -> PoseRecord:
    """All that the pose file of the session says."""
    document, search = session.document, session.search
    registration, settings = document.registration, document.settings
    try:
        if search is not None and search.news is not None:
            problem, progress = search.news.problem, search.news.progress
            return make_record(
                registration, settings, problem, document.pose, progress.loss, progress.verdict
            )
        problem = landscape_problem(registration, document.pose, settings)
        painting = session.painting
        loss = None if painting is None else painting.loss
        if (
            painting is None
            or loss is None
            or not painting.weighed
            or painting.request.pose is not document.pose
        ):
            return _plain_record(session)
        return make_record(registration, settings, problem, document.pose, loss)
    except PoseViewerError:
        return _plain_record(session)  # a pose where nothing can be compared is a pose, too


def _plain_record(session: Session) -> PoseRecord:
    document = session.document
    registration, chart = document.registration, document.chart
    photo = registration.photo
    return PoseRecord(
        document.pose,
        PhotoReference(photo.name, photo.width, photo.height, photo.sha256),
        ModelReference(registration.mesh_name, registration.mesh_sha256, registration.mesh.unit),
        ChartNumbers(chart.name, chart.names, tuple(float(v) for v in document.numbers)),
        None,
        settings_as_json(document.settings),
        {"name": "poseviewer", "version": version("poseviewer")},
        photo.undistortion,
    )


def export(what: Export, session: Session, renderer: SoftwareRenderer) -> tuple[str, bytes]:
    """A file's name and content.

    Raises:
        PoseViewerError: there is nothing of that kind yet.
    """
    photo = session.document.registration.photo
    stem = Path(photo.name).stem + (".undistorted" if photo.undistortion is not None else "")
    if what == "pose":
        text = json.dumps(record_as_json(record_of(session)), indent=2, ensure_ascii=False)
        return f"{stem}.pose.json", (text + "\n").encode()
    if what == "overlay":
        return f"{stem}.overlay.png", _overlay(session, renderer)
    news = session.landscape
    if news is None or not news.slices:
        raise SettingsError("there are no maps yet; wait for the first ones")
    names, spans = news.problem.chart.names, news.problem.chart.spans(news.numbers)
    if what == "sheet":
        # Half a second of Matplotlib, which opening the app need not wait for.
        from poseviewer.figures.landscape_sheet import make_landscape_sheet
        from poseviewer.figures.save import figure_bytes

        title = f"{photo.label}: loss about the pose, ±{news.half_width:.0%}"
        figure = make_landscape_sheet(list(news.slices), names, news.numbers, title=title)
        return f"{stem}.landscape.png", figure_bytes(figure)
    slices = list(news.slices)
    if what == "maps-npz":
        content = landscape_npz_bytes(names, news.numbers, spans, slices, photo_text(photo))
    else:
        content = landscape_csv_bytes(names, news.numbers, spans, slices)
    return f"{stem}.landscape.{what.removeprefix('maps-')}", content


def _overlay(session: Session, renderer: SoftwareRenderer) -> bytes:
    """The photo, in its own size, with the model in the look that is shown; PNG."""
    document = session.document
    photo, mesh = document.registration.photo, document.registration.mesh
    attributes = shown_attributes(
        make_photo_attributes(photo, mesh, document.pose, document.settings)
    )
    lighting = recover_lighting(renderer.moments(document.pose, attributes))

    def relight(image: AttributeImage) -> FloatArray:
        return lighting.apply(model_attributes(image, attributes))

    view = View(
        photo.as_rgb8(photo.width, photo.height),
        mesh,
        renderer,
        document.pose,
        relight,
        session.look.opacity,
    )
    picture = draw_look(session.look.name, view)
    data = np.asarray(cv2.imencode(".png", picture[..., ::-1])[1]).tobytes()
    return described(data, photo_text(photo))
