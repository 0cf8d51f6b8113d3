"""Two presses measure; the numbers follow the poses, and the tool forgets them when it is left."""

import json

import numpy as np
import pytest
from lxml import html as lxml_html

from poseviewer.app.page.handles import handles_of
from poseviewer.app.page.measuring import distance_text, measurement_html, relative_html
from poseviewer.app.state.measuring import measured_pixels, toggle_measuring
from poseviewer.app.state.objects import alter_object, pick_object
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import RELATIVE, export
from poseviewer.errors import SettingsError
from tests.app.page.test_result import searched
from tests.app.state import edits as c
from tests.app.state.documents import after, held, make_session, refused
from tests.app.state.test_objects import middle, with_two


def pressed(session: Session, *places: np.ndarray) -> Session:
    return after(session, *(edit for x, y in places for edit in (c.press(x, y), c.release())))


def two_points(session: Session) -> tuple[np.ndarray, np.ndarray]:
    return middle(session, 1), middle(session, 1) + np.array([9.0, 5.0])


def rows_of(html: str) -> dict[str, list[str]]:
    rows = lxml_html.fromstring(html).xpath("//tr")
    return {row[0].text_content(): [cell.text_content() for cell in row[1:]] for row in rows}


def test_two_presses_measure_and_a_third_starts_anew() -> None:
    session = after(searched(make_session()), toggle_measuring())
    first, second = two_points(session)
    one = pressed(session, first)
    assert distance_text(one) == ""
    assert "±" in rows_of(measurement_html(one))["model x"][0]
    both = pressed(one, second)
    assert both.document is session.document
    rows = rows_of(measurement_html(both))
    assert rows["distance"] == [distance_text(both)]
    points = np.array([[float(cell.split()[0]) for cell in rows[f"camera {x}"]] for x in "XYZ"])
    distance = float(distance_text(both).split()[0])
    assert distance == pytest.approx(np.linalg.norm(points[:, 0] - points[:, 1]), rel=0.02)
    assert distance_text(both) in handles_of(both)
    assert "no model there" in refused(both, c.press(1.0, 1.0))
    anew = pressed(both, second)
    assert [list(pixel) for pixel in measured_pixels(anew)] == [list(second)]
    for end in (c.cancel_drag(), toggle_measuring(), c.set_tool("region")):
        left = after(both, end)
        assert measurement_html(left) == ""
        assert distance_text(left) not in handles_of(left) or not distance_text(left)
    assert measured_pixels(after(both, c.cancel_drag(), toggle_measuring())) == ()


def test_pixels_stay_where_they_were_pressed_and_are_measured_by_the_pose_at_hand() -> None:
    session = after(searched(make_session()), toggle_measuring())
    both = pressed(session, *two_points(session))
    moved = after(both, c.nudge("scale", 5.0))
    assert measured_pixels(moved) == measured_pixels(both)
    assert distance_text(moved) != distance_text(both)
    assert "±" in distance_text(both)
    assert "±" not in distance_text(moved)  # no search has led there
    away = after(both, c.nudge("move", 80.0))
    assert "No model" in measurement_html(away)
    assert "No model" in measurement_html(held(both))
    assert distance_text(after(away, c.undo())) == distance_text(both)


def test_points_of_two_objects_are_measured_in_the_world() -> None:
    session = after(with_two(), toggle_measuring())
    both = pressed(session, middle(session, 1), middle(session, 2))
    assert rows_of(measurement_html(both))["of"] == ["m.ply", "box.ply"]
    assert distance_text(both)
    hidden = after(both, alter_object(2, hidden=True))
    assert distance_text(hidden) == ""
    parallel = after(with_two(), c.set_projection("parallel"), toggle_measuring())
    parallel = pressed(parallel, middle(parallel, 1), middle(parallel, 2))
    assert "not known" in distance_text(parallel)
    assert "camera Z" not in measurement_html(parallel)


def test_the_pose_in_another_objects_frame_is_shown_copied_and_exported() -> None:
    session = after(with_two(), c.set_fields("display", relative_to=1))
    scene = session.document.scene
    pose = scene.relative_pose(1, 0)
    (copied,) = lxml_html.fromstring(relative_html(session)).xpath("//@data-copy")
    quaternion, translation = (np.fromstring(row, sep=" ") for row in copied.split("\n"))
    np.testing.assert_array_equal(quaternion, pose.rigid.as_quaternion())
    np.testing.assert_array_equal(translation, pose.rigid.translation)
    ((name, data),) = export(RELATIVE, session).items()
    assert name == "0.relative.json"
    (told,) = json.loads(data)["poses"]
    assert told["translation"] == translation.tolist()
    assert told["distance"] == pytest.approx(np.linalg.norm(translation))
    assert relative_html(after(session, pick_object(1))) == ""  # its own frame
    with pytest.raises(SettingsError, match="add another"):
        export(RELATIVE, make_session())
    parallel = after(session, c.set_projection("parallel"))
    assert "parallel" in relative_html(parallel)
