"""Measurements in the panel at the right: points, their distance, and poses between objects."""

from collections.abc import Iterator, Sequence
from html import escape

from poseviewer.app.page.controls import Controls, kept
from poseviewer.app.page.result import with_deviation
from poseviewer.app.state.display_edits import set_fields
from poseviewer.app.state.document import label_of
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.measuring import POINTS, measured_pixels
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Parallel
from poseviewer.starts.measuring import (
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
    scene, view = session.document.scene, session.document.at
    pixels = () if session.is_moving else measured_pixels(session)
    points = [measure_point(scene, pixel, view) for pixel in pixels]
    return tuple(point for point in points if point is not None)


measured_points = kept(lambda s: (s.document, s.measured, s.tool, s.is_moving), _measure)
"""Points at the pixels that are measured; those where no model is seen, or one moves, are left out.
"""


def distance_text(session: Session) -> str:
    """The distance of two points with its unit, or why it is not known; "": there are not two."""
    scene, points = session.document.scene, measured_points(session)
    if len(points) < POINTS:
        return ""
    items = [scene.objects[point.object_index] for point in points]
    is_in_world = items[0] is not items[1] and items[0].world_from_model.scale != 1.0
    try:
        distance = measure_distance(scene, *points, view=session.document.at)
    except SettingsError:
        return "not known under parallel projection"
    unit = scene.unit if is_in_world else items[0].mesh.unit
    return f"{with_deviation(*distance)} {unit or ''}".strip()


def measurement_html(session: Session) -> str:
    """The measured points in the frames of model and camera, and their distance; "": none."""
    points, document = measured_points(session), session.document
    count = len(measured_pixels(session))
    if len(points) < count:
        return '<div class="pv-result"><b>No model rests at a measured point.</b></div>'
    if not points:
        return ""
    is_parallel, objects = isinstance(document.pose.camera, Parallel), document.scene.objects
    rows = [("point", "1", "2")[: 1 + count]]
    if len(objects) > 1:
        labels = (label_of(objects[point.object_index]) for point in points)
        rows.append(("of", *(label[:MAX_LETTERS] for label in labels)))
    names = COORDINATES[: 5 if is_parallel else 6]
    rows += zip(names, *map(_texts, points), strict=False)
    if distance := distance_text(session):
        rows.append(("distance", distance))
    unit = document.mesh.unit or "the model's unit"
    copied = "\n".join("\t".join(row) for row in rows)
    return _table(f"Measured points, in {unit}", rows, copied)


def _texts(point: MeasuredPoint) -> Iterator[str]:
    """Coordinates of a point with their deviations."""
    deviations = [None] * 6 if point.deviations is None else point.deviations.tolist()
    return map(with_deviation, point.coordinates.tolist(), deviations)


def _table(head: str, rows: Sequence[Sequence[str]], copied: str) -> str:
    """Rows of texts below a title (HTML), and a button that copies a text."""
    texts = [[escape(text) for text in row] for row in rows]
    cells = "".join(f"<tr><th>{row[0]}</th><td>{'</td><td>'.join(row[1:])}</td>" for row in texts)
    button = f'<button type="button" data-copy="{escape(copied)}">Copy</button>'
    return (
        f'<div class="pv-result"><b>{escape(head)}</b><table>{cells}</table>'
        f"<div>{button}</div></div>"
    )


def add_relative(controls: Controls) -> None:
    """The choice of another object's frame, and the active object's pose there."""

    def choose(text: str) -> Edit:
        numbers = {label: number for number, label in other_frames(controls.session).items()}
        return set_fields("display", relative_to=numbers.get(text, 0))

    controls.field(
        controls.gui.add_dropdown("Relative to", (OF_CAMERA,)),
        choose,
        options=lambda s: tuple(other_frames(s).values()),
        value=lambda s: other_frames(s).get(s.display.relative_to, OF_CAMERA),
        visible=lambda s: len(other_frames(s)) > 1,
    )
    controls.html(kept(lambda s: (s.document, s.display), relative_html))


def other_frames(session: Session) -> dict[int, str]:
    """Labels of the frames that the active object's pose can be shown in, by objects' numbers."""
    active, frames = session.document.object, {0: OF_CAMERA}
    for item in session.document.scene.objects if active.is_placed else ():
        if item.is_placed and item is not active:
            frames[int(item.id)] = f"{label_of(item)} ({item.id})"
    return frames


def relative_html(session: Session) -> str:
    """The active object's pose in the frame of the object that is chosen; "": none is."""
    document, number = session.document, session.display.relative_to
    if not number or number not in other_frames(session):
        return ""
    scene, other = document.scene, document.scene.index(str(number))
    try:
        pose = measure_relative(scene, document.active, other, document.at)
    except SettingsError as error:
        return f'<div class="pv-result">{escape(str(error))}</div>'
    vectors = [pose["quaternion_wxyz"], pose["translation"]]
    shown = [" ".join(with_deviation(value, None) for value in vector) for vector in vectors]
    rows = [
        ("quaternion w x y z", shown[0]),
        ("translation X Y Z", shown[1]),
        ("distance", with_deviation(pose["distance"], pose.get("distance_std"))),
        ("angle", f"{with_deviation(pose['degrees'], pose.get('degrees_std'))}°"),
    ]
    copied = "\n".join(" ".join(map(repr, vector)) for vector in vectors)
    head = f"{label_of(document.object)} in the frame of {other_frames(session)[number]}"
    unit = scene.objects[other].mesh.unit or "the model's unit"
    return _table(f"{head}, in {unit}", rows, copied)
