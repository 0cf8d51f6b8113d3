"""The answer: place, angles and focal length, each with its deviation; to be copied."""

import math
from itertools import zip_longest
from pathlib import Path

import htpy as h
import numpy as np

from poseviewer.app.page.controls import as_html
from poseviewer.app.state.document import label_of
from poseviewer.app.state.pose_edits import pose_numbers
from poseviewer.app.state.session import Session
from poseviewer.confidence.pose_covariance import short
from poseviewer.files.pose import PoseRecord, pose_bytes
from poseviewer.files.structs import ModelReference, PhotoReference
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.image import Photo

DIGITS = 5
"""Digits that are shown of a number whose deviation is not known."""
MAX_DEVIATION_DEG = 90.0
"""Above this deviation an angle's is linear no more, as where two axes coincide: none is shown."""
JUMPS_FROM_DEG = 85.0
"""Turn about y from which the other two jump: a quaternion is shown instead."""
ABOUT = (
    "Camera axes: X to the right, Y down, Z forward, of the model's origin. Turns: about the "
    "camera's x, then its y, then its z axis; near 90° about y, where they jump, the unit "
    "quaternion q. ±: standard deviations, if the pose is right. mm of "
    "the focal length: as if on 35-mm film."
)
FOLLOW_FOCAL = "Z", "distance", "focal"
EMPTY = h.th, h.td
SOURCES = {
    "calibrated": "by a calibration",
    "EXIF": "by the photo's EXIF",
    "assumed": "no calibration, no EXIF, no search told the focal length",
}
"""Sources of a focal length, and the tooltip of each."""


def deviations_of(session: Session) -> dict[str, float]:
    """Known standard deviations of ``pose_numbers`` by their names, to first order."""
    covariance, pose = session.covariance_in(session.document.view_index), session.document.pose
    if covariance is None:
        return {}
    at = pose_numbers(pose)

    def off(moved: Pose) -> FloatArray:
        """The numbers' differences from the pose, those of angles by the short way."""
        now = pose_numbers(moved)
        return np.array(
            [math.remainder(now[n] - at[n], 360.0) if "turn" in n else now[n] - at[n] for n in at]
        )

    deviations = dict(zip(at, covariance.deviations_of(off).tolist(), strict=True))
    return {
        name: value
        for name, value in deviations.items()
        if value > 0.0 and not ("turn" in name and value > MAX_DEVIATION_DEG)
    }


def result_html(session: Session) -> str:
    """The numbers of the active object in the large photo; "" until it is placed."""
    document = session.document
    if not document.object.is_placed:
        return ""
    numbers, deviations = pose_numbers(document.pose), deviations_of(session)
    if abs(numbers["turn y"]) > JUMPS_FROM_DEG:
        parts = zip("wxyz", document.pose.camera_from_model.as_quaternion().tolist(), strict=True)
        quaternion = {f"q {part}": value for part, value in parts}
        numbers = quaternion | {n: v for n, v in numbers.items() if "turn" not in n}
    source = source_of(document.photo, document.pose.camera)
    left, right = [], []
    for name, value in numbers.items():
        number = with_deviation(value, deviations.get(name)) + _unit_text(session, name, value)
        text: list[h.Node] = [number]
        if source and name in FOLLOW_FOCAL[-1 if source != "assumed" else 0 :]:
            word = source if name == "focal" else ""
            mark = word + "*" * (source == "assumed")
            text += [" ", h.i(f".pv-{source}", title=SOURCES[source])[mark]]
        column = left if name in ("X", "Y", "Z", "distance") else right
        column.append((h.th[name], h.td[text]))
    rows = [h.tr[a, b] for a, b in zip_longest(left, right, fillvalue=EMPTY)]
    buttons = [
        (" ", h.button(type="button", data_copy=text)[name])
        for name, text in copies_of(session).items()
    ]
    name, unit = label_of(document.object), document.model.unit or "the model's unit"
    if deviations and source == "assumed":
        unit += f"; all ± hold if {numbers['focal']:,.0f} px is right"
    elif deviations and len(document.scene.views) > 1:
        unit += "; ± hold if the cameras are right"
    head = h.b[name], f" as the camera sees it, in {unit}"
    whole = head, h.table[rows], h.div["Copy as", buttons]
    return as_html(h.div(".pv-result", title=ABOUT)[whole])


def source_of(photo: Photo, camera: Camera) -> str:
    """The source, of ``SOURCES``, of a focal length that the photo has; "" of any other one."""
    if isinstance(camera, Parallel) or camera.fx != photo.default_camera().fx:
        return ""
    if photo.camera is not None:
        return "calibrated"
    return "assumed" if photo.focal_length_35mm is None else "EXIF"


def unit_of(session: Session, name: str) -> str:
    """Unit of one of ``pose_numbers``."""
    unit = session.document.model.unit or "unit"
    of_camera = {"scale": f"px per {unit}", "focal": "px"}
    return "°" if name.startswith("turn") else of_camera.get(name, unit)


def _unit_text(session: Session, name: str, value: float) -> str:
    """Text after a number: its unit, and of a focal length what it is on 35-mm film."""
    photo = session.document.photo
    if name == "focal":
        film = value * math.hypot(36.0, 24.0) / math.hypot(photo.width, photo.height)
        return f" px, {film:.3g} mm"
    if name.startswith("turn"):
        return "°"
    return f" {unit_of(session, name)}" if name == "scale" else ""


def copies_of(session: Session) -> dict[str, str]:
    """Texts of the pose: 4 x 4 matrix; quaternion w x y z and translation; pose file."""
    document, pose = session.document, session.document.pose
    rigid, model = pose.camera_from_model, document.model
    reference = ModelReference(model.name, model.sha256, model.unit)
    photo = PhotoReference(file=document.photo.name, sha256=document.photo.sha256)
    record = PoseRecord.of(pose, photo, model=reference)
    return {
        "Matrix": "\n".join(map(_row, rigid.as_matrix())),
        "Quaternion": f"{_row(rigid.as_quaternion())}\n{_row(rigid.translation)}",
        "JSON": pose_bytes(Path("pose.json"), record).decode(),
    }


def _row(numbers: FloatArray) -> str:
    return " ".join(map(repr, numbers.tolist()))


def with_deviation(value: float, deviation: float | None) -> str:
    """A number with its deviation, to two digits of it; without one, or by 0, to ``DIGITS``."""
    if not deviation:
        return np.format_float_positional(value, DIGITS, fractional=False, trim="-")
    text = short(deviation)
    return f"{value:.{len(text.partition('.')[2])}f} ± {text}"
