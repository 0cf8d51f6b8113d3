"""Measurements in the panel at the right: points, their distance, and poses between objects."""

from collections.abc import Sequence

import htpy as h

from poseviewer.app.page.controls import Controls, as_html, memoize
from poseviewer.app.page.result import with_deviation
from poseviewer.app.state.document import label_of
from poseviewer.app.state.edits import set_fields
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Parallel
from poseviewer.scene.measuring import (
    MeasuredPoint,
    measure_distance,
    measure_point,
    measure_relative,
)

COORDINATES = ("model x", "model y", "model z", "camera X", "camera Y", "camera Z")
"""Names of a measured point's coordinates."""
OF_CAMERA = "the camera"
"""Choice of no other object's frame."""
MAX_LETTERS = 22
"""Letters of an object's name above its column: two columns fit the panel."""


def _measure(session: Session) -> tuple[MeasuredPoint, ...]:
    scene, view = session.document.scene, session.document.view_index
    pixels = () if session.is_moving else session.measurement_pixels
    return tuple(filter(None, (measure_point(scene, pixel, view) for pixel in pixels)))


measured_points = memoize(lambda s: (s.document, s.measured, s.tool, s.is_moving), _measure)
"""Points at the measured pixels, where a model is seen; none while one moves."""


def distance_text(session: Session) -> str:
    """The distance of two points with its unit, or why it is not known; "": there are not two."""
    scene, points = session.document.scene, measured_points(session)
    if len(points) < 2:
        return ""
    item, other = (scene.objects[point.object_index] for point in points)
    is_in_models = item is other or item.world_from_model.scale == 1.0
    try:
        text = with_deviation(*measure_distance(scene, *points))
    except SettingsError:
        return "not known under parallel projection"
    return f"{text} {(item.model.unit if is_in_models else scene.unit) or ''}".strip()


def measurement_html(session: Session) -> str:
    """The measured points in the frames of model and camera, and their distance; "": none."""
    points, document = measured_points(session), session.document
    if len(points) < len(session.measurement_pixels):
        return as_html(h.div(".pv-result")[h.b["No model rests at a measured point."]])
    if not points:
        return ""
    labels = (label_of(document.scene.objects[point.object_index]) for point in points)
    rows = [("point", "1", "2")[: 1 + len(points)], ("of", *(n[:MAX_LETTERS] for n in labels))]
    shown = COORDINATES[: 5 if isinstance(document.pose.camera, Parallel) else 6]
    for i, name in enumerate(shown):
        stds = [None if point.deviations is None else point.deviations[i] for point in points]
        values = [point.coordinates[i] for point in points]
        rows.append((name, *map(with_deviation, values, stds)))
    rows += [("distance", distance_text(session))] * (len(points) > 1)
    unit = document.model.unit or "the model's unit"
    return _table(f"Measured points, in {unit}", rows, "\n".join(map("\t".join, rows)))


def _table(head: str, rows: Sequence[Sequence[str]], copied: str) -> str:
    """Rows of texts below a title (HTML), and a button that copies a text."""
    table = h.table[[h.tr[h.th[name], [h.td[text] for text in texts]] for name, *texts in rows]]
    button = h.button(type="button", data_copy=copied)["Copy"]
    return as_html(h.div(".pv-result")[h.b[head], table, h.div[button]])


def add_relative(controls: Controls) -> None:
    """The choice of another object's frame, and the active object's pose there."""
    controls.field(
        controls.gui.add_dropdown("Relative to", (OF_CAMERA,)),
        lambda label: set_fields("display", relative_to=label),
        options=lambda s: (OF_CAMERA, *other_frames(s)),
        value=lambda s: (
            s.display.relative_to if s.display.relative_to in other_frames(s) else OF_CAMERA
        ),
        visible=lambda s: bool(other_frames(s)),
    )
    controls.html(memoize(lambda s: (s.document, s.display), relative_html))


def other_frames(session: Session) -> dict[str, int]:
    """Indices of the objects in whose frames the active one can be shown, by their labels."""
    document = session.document
    placed = [(i, o) for i, o in enumerate(document.scene.objects) if o.is_placed]
    frames = {f"{label_of(item)} ({item.id})": i for i, item in placed if i != document.active}
    return frames if document.object.is_placed else {}


def relative_html(session: Session) -> str:
    """The active object's pose in the frame of the object that is chosen; "": none is."""
    document, frame = session.document, session.display.relative_to
    other = other_frames(session).get(frame)
    if other is None:
        return ""
    try:
        pose = measure_relative(document.scene, document.active, other)
    except SettingsError as error:
        return as_html(h.div(".pv-result")[str(error)])
    vectors = [pose["quaternion_wxyz"], pose["translation"]]
    shown = [" ".join(with_deviation(value, None) for value in vector) for vector in vectors]
    rows = [
        ("quaternion w x y z", shown[0]),
        ("translation X Y Z", shown[1]),
        ("distance", with_deviation(pose["distance"], pose.get("distance_std"))),
        ("angle", f"{with_deviation(pose['degrees'], pose.get('degrees_std'))}°"),
    ]
    unit = document.scene.objects[other].model.unit or "the model's unit"
    copied = "\n".join(" ".join(map(repr, vector)) for vector in vectors)
    return _table(f"{label_of(document.object)} in the frame of {frame}, in {unit}", rows, copied)
