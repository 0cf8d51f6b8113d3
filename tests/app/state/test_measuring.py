"""Two presses measure; the numbers follow the poses, and the tool forgets them when it is left."""

import json

import numpy as np
import pytest
from lxml import html as lxml_html

from poseviewer.app.page.handles import handles_of
from poseviewer.app.page.measure_panel import distance_text, measurement_html, relative_html
from poseviewer.app.state.objects import pick_object
from poseviewer.app.state.pointer_edits import toggle_measuring
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import RELATIVE, export
from poseviewer.errors import SettingsError
from tests.app.page.test_result import searched
from tests.app.state import edits as c
from tests.app.state.documents import after, held, make_session, refused
from tests.app.state.test_objects import middle, with_two


def pressed(session: Session, *places: np.ndarray) -> Session:
    return after(session, *(edit for x, y in places for edit in (c.press(x, y), c.release())))


def with_points() -> Session:
    """Two points of a searched model, measured."""
    session = after(searched(make_session()), toggle_measuring())
    return pressed(session, middle(session, 1), middle(session, 1) + np.array([9.0, 5.0]))


def test_two_presses_measure_and_a_third_starts_anew() -> None:
    both = with_points()
    rows = lxml_html.fromstring(measurement_html(both)).xpath("//tr")
    cells = {row[0].text: [cell.text for cell in row[1:]] for row in rows}
    points = np.array([[float(cell.split()[0]) for cell in cells[f"camera {x}"]] for x in "XYZ"])
    distance, _, deviation = cells["distance"][0].split()
    assert float(distance) == pytest.approx(np.linalg.norm(points @ [1.0, -1.0]), rel=0.02)
    assert 0.0 < float(deviation) < 0.1
    assert cells["distance"][0] in handles_of(both)
    assert "no model there" in refused(both, c.press(1.0, 1.0))
    anew = pressed(both, middle(both, 1))
    assert [pixel.tolist() for pixel in anew.measurement_pixels] == [middle(both, 1).tolist()]
    for end in (c.cancel_drag(), toggle_measuring(), c.set_tool("region")):
        assert measurement_html(after(both, end)) == ""
    assert after(both, c.cancel_drag(), toggle_measuring()).measurement_pixels == ()


def test_pixels_stay_and_are_measured_by_the_pose_at_hand() -> None:
    both = with_points()
    moved = after(both, c.nudge("scale", 5.0))
    assert moved.measurement_pixels == both.measurement_pixels
    assert distance_text(moved) not in ("", distance_text(both))
    assert "±" not in distance_text(moved)  # no search has led there
    away = after(both, c.nudge("move", 80.0))
    assert "No model" in measurement_html(away)
    assert "No model" in measurement_html(held(both))
    assert distance_text(after(away, c.undo())) == distance_text(both)


def test_points_of_two_objects_are_measured() -> None:
    session = after(with_two(), toggle_measuring())
    both = pressed(session, middle(session, 1), middle(session, 2))
    assert "<td>m.ply</td><td>box.ply</td>" in measurement_html(both)
    assert float(distance_text(both)) > 0.0
    parallel = after(both, c.set_projection("parallel"))
    assert "not known" in distance_text(parallel)
    assert "camera Z" not in measurement_html(parallel)


def test_the_pose_in_another_objects_frame_is_shown_copied_and_exported() -> None:
    session = after(with_two(), c.set_fields("display", relative_to="m.ply (1)"))
    pose = session.document.scene.relative_pose(1, 0).rigid
    (copied,) = lxml_html.fromstring(relative_html(session)).xpath("//@data-copy")
    np.testing.assert_array_equal(
        np.fromstring(copied, sep=" "), [*pose.as_quaternion(), *pose.translation]
    )
    ((name, data),) = export(RELATIVE, session).items()
    assert name == "0.relative.json"
    (told,) = json.loads(data)["poses"]
    assert told["frame"] == "m.ply"
    assert told["translation"] == pose.translation.tolist()
    assert relative_html(after(session, pick_object(1))) == ""  # its own frame
    assert "parallel" in relative_html(after(session, c.set_projection("parallel")))
    with pytest.raises(SettingsError, match="add another"):
        export(RELATIVE, make_session())
