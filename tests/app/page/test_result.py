"""The pose in numbers, as the page shows it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import html as lxml_html
from scipy.spatial.transform import Rotation

from poseviewer.app.page.result import copies_of, deviations_of, result_html
from poseviewer.app.page.texts import files_text
from poseviewer.app.state.pose_edits import pose_numbers
from poseviewer.app.state.session import Session
from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.files.pose import load_pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import SearchResult
from tests.app.state import edits as c
from tests.app.state.documents import BUMPY, PARALLEL, PERSPECTIVE, after, make_photo, make_session


def searched(session: Session, spread: float = 1e-3) -> Session:
    """The session with a covariance of its pose, its focal length among it."""
    factor = spread * np.random.default_rng(5).normal(size=(7, 7))
    covariance = PoseCovariance(session.document.pose, BUMPY.centre, factor @ factor.T)
    result = SearchResult(loss=0.1, unexplained=0.1, covariance=covariance)
    return replace(session, document=session.document.with_object(result=result))


def rows_of(session: Session) -> dict[str, str]:
    page = lxml_html.fromstring(result_html(session))
    names, values = (page.xpath(f"//{tag}") for tag in ("th", "td"))
    return {n.text: v.text_content() for n, v in zip(names, values, strict=True) if n.text}


@pytest.mark.parametrize("camera", [PERSPECTIVE, PARALLEL])
def test_the_page_says_where_the_model_is_and_how_it_is_turned(camera) -> None:
    session = make_session(camera)
    numbers, place = pose_numbers(session.document.pose), session.document.pose.camera_from_model
    turns = [numbers[f"turn {axis}"] for axis in "xyz"]
    turned = Rotation.from_euler("xyz", turns, degrees=True).as_matrix()
    np.testing.assert_allclose(turned, place.rotation, atol=1e-12)
    rows = rows_of(session)
    assert rows["X"] == "0.2"
    assert rows["Y"] == "-0.1"
    assert ("distance" in rows) == ("Z" in rows) == (camera is PERSPECTIVE)
    if camera is PARALLEL:
        assert rows["scale"] == "25 px per unit"
    else:
        assert numbers["distance"] == pytest.approx(np.linalg.norm(place.translation))
        assert rows["focal"] == "300 px, 64.9 mm"


def test_each_number_has_the_deviation_of_poses_drawn_by_the_covariance() -> None:
    session = searched(make_session())
    covariance = session.covariance_in(0)
    assert covariance is not None
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(7), covariance.matrix, 4000)
    drawn = [list(pose_numbers(covariance.pose_at(draw)).values()) for draw in draws]
    said = deviations_of(session)
    assert list(said) == list(pose_numbers(session.document.pose))
    np.testing.assert_allclose(list(said.values()), np.std(drawn, axis=0), rtol=0.05)
    assert all("±" in text for text in rows_of(session).values())
    moved = after(session, c.nudge("move", 1.0))  # it was the other pose's
    assert not any("±" in text for text in rows_of(moved).values())


def test_an_angle_at_half_a_turn_has_its_deviation() -> None:
    turned = RigidTransform.from_rotation_vector([0.0, 0.0, np.pi], [0.0, 0.0, 8.0])
    session = make_session()
    pose = replace(session.document.pose, camera_from_model=turned)
    session = searched(after(session, c.set_fields(document=session.document.at_pose(pose))))
    assert deviations_of(session)["turn z"] < 1.0


def test_where_angles_jump_the_quaternion_is_shown() -> None:
    session, shown = make_session(), list[dict[str, str]]()
    for degrees in (89.9, 90.1):
        turned = RigidTransform.from_rotation_vector([0.0, np.radians(degrees), 0.0], [0, 0, 8.0])
        pose = replace(session.document.pose, camera_from_model=turned)
        shown.append(rows_of(after(session, c.set_fields(document=session.document.at_pose(pose)))))
        assert not any("turn" in name for name in shown[-1])
        assert float(shown[-1]["q w"]) == pytest.approx(np.cos(np.radians(degrees / 2)), abs=1e-4)
    for part in "wxyz":
        assert float(shown[0][f"q {part}"]) == pytest.approx(float(shown[1][f"q {part}"]), abs=0.01)
    assert "turn y" in rows_of(session)


def test_a_guessed_focal_length_is_said_to_be_assumed_and_the_distance_with_it() -> None:
    session = make_session(make_session().document.photo.default_camera())
    assumed = {name for name, text in rows_of(session).items() if "*" in text}
    assert "assumed" in rows_of(session)["focal"]
    assert assumed == {"Z", "distance", "focal"}
    assert not any("*" in text for text in rows_of(make_session()).values())


def test_a_calibration_and_exif_are_named() -> None:
    calibrated, by_exif = make_photo(), make_photo()
    calibrated = replace(calibrated, camera=PERSPECTIVE)
    by_exif = replace(by_exif, focal_length_35mm=28.0)
    for photo, word in ((calibrated, "calibrated"), (by_exif, "EXIF")):
        session = make_session(photo.default_camera(), photo=photo)
        assert [text for text in rows_of(session).values() if word in text] == [
            rows_of(session)["focal"]
        ]
        assert (f"{word} camera" in files_text(session)) == (word == "calibrated")
        changed = after(session, c.set_field_of_view(20.0))
        assert word not in rows_of(changed)["focal"]


def test_the_pose_is_copied_in_three_forms(tmp_path: Path) -> None:
    session = make_session()
    place, copies = session.document.pose.camera_from_model, copies_of(session)
    matrix = np.fromstring(copies["Matrix"], sep=" ").reshape(4, 4)
    np.testing.assert_array_equal(matrix[:3], np.c_[place.rotation, place.translation])
    quaternion, translation = (
        np.fromstring(row, sep=" ") for row in copies["Quaternion"].split("\n")
    )
    turned = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(turned, place.rotation, atol=1e-12)
    np.testing.assert_array_equal(translation, place.translation)
    path = tmp_path / "pose.json"
    path.write_text(copies["JSON"])
    assert json.loads(copies["JSON"])["model"]["file"] == "m.ply"
    np.testing.assert_allclose(load_pose(path).pose.camera_from_model.translation, translation)


def test_nothing_is_said_of_a_model_that_is_still_to_be_placed() -> None:
    session = make_session()
    document = session.document.with_object(is_placed=False)
    assert result_html(replace(session, document=document)) == ""
