"""Cameras of a drawn scene, by features and by markers, against the truth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.scene.types import View
from poseviewer.still.still_cameras import StillCameras, find_cameras
from tests.still_scene import CAMERA, MARKER, MARKERS, arc, errors, write_pictures

CAMERAS = arc(12)


@pytest.fixture(scope="session")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Twelve pictures of the scene, with markers."""
    return write_pictures(tmp_path_factory.mktemp("still"), CAMERAS, MARKERS)


def last(steps) -> StillCameras:
    *lines, found = steps
    assert all(isinstance(line, str) for line in lines)
    assert isinstance(found, StillCameras)
    return found


def off(views: Sequence[View], scale: float | None = None) -> tuple[float, float]:
    indices = [int(Path(view.name).stem) for view in views]
    true = [CAMERAS[index] for index in indices]
    return errors([view.camera_from_world for view in views], true, scale)


@pytest.mark.slow
@pytest.mark.long
def test_features_find_cameras_and_focal_length_of_an_unknown_camera(pictures):
    steps = list(find_cameras(pictures, "features"))
    found = last(steps)
    assert [view.name for view in found.views] == [path.name for path in pictures]
    degrees, percent = off(found.views)
    assert degrees < 0.1
    assert percent < 0.2
    camera = found.views[0].camera
    assert isinstance(camera, Perspective)
    assert camera.fx == pytest.approx(CAMERA.fx, rel=0.01)
    assert not found.is_scale_known
    assert found.scene.free_scale
    assert "features 12 of 12" in steps
    assert any(str(step).startswith("matched ") for step in steps)
    assert "placed 12 of 12" in steps
    assert "12 of 12 pictures have cameras, by features" in found.lines
    assert "scale: not known; with `marker_size` it is, where markers are seen" in found.lines


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("bent", [-0.2, 0.0])
def test_a_given_camera_that_does_not_fit_is_said(tmp_path, bent):
    lens = Undistortion.of(Lens("opencv", (bent, 0.0, 0.0, 0.0)), CAMERA)
    paths = write_pictures(tmp_path / "bent", CAMERAS[::2], lens=lens if bent else None)
    found = last(list(find_cameras(paths, "features", camera=CAMERA)))
    said = [note for note in found.notes if note.startswith("The given camera does not fit")]
    assert len(said) == (1 if bent else 0)
    if bent:
        assert "leave it out" in said[0]


@pytest.mark.slow
def test_markers_find_cameras_in_their_unit(pictures):
    known = last(find_cameras(pictures, camera=CAMERA, marker_size=MARKER, unit="m"))
    assert known.by == "markers"
    assert len(known.views) == 12
    degrees, percent = off(known.views, scale=1.0)
    assert degrees < 0.3
    assert percent < 0.5
    assert (known.unit, known.is_scale_known) == ("m", True)
    free = last(find_cameras(pictures, "markers"))
    camera = free.views[0].camera
    assert isinstance(camera, Perspective)
    assert camera.fx == pytest.approx(CAMERA.fx, rel=0.01)
    assert off(free.views, scale=MARKER)[1] < 1.0
    assert not free.is_scale_known


@pytest.mark.slow
@pytest.mark.long
def test_one_marker_scales_cameras_by_features(tmp_path):
    paths = write_pictures(tmp_path / "m", CAMERAS, MARKERS[:1])
    steps = list(find_cameras(paths, "features", marker_size=MARKER, unit="mm"))
    found = last(steps)
    assert (found.by, found.unit, found.is_scale_known) == ("features", "mm", True)
    assert "markers in 12 of 12" in steps
    degrees, percent = off(found.views, scale=1.0)
    assert degrees < 0.1
    assert percent < 0.3
    assert not found.notes


def test_the_world_stands_on_the_marker_that_is_seen_most(pictures):
    found = last(find_cameras(pictures[:4], "markers", camera=CAMERA))
    above = [view.camera_from_world.inverse().translation[2] for view in found.views]
    true = [place.inverse().translation[2] for place in CAMERAS[:4]]
    np.testing.assert_allclose(np.multiply(above, MARKER), true, rtol=0.02)


@pytest.mark.slow
def test_a_known_lens_is_undone_in_the_views(tmp_path):
    lens = Lens("opencv", (-0.2, 0.05, 0.0, 0.0))
    known = Undistortion.of(lens, CAMERA)
    paths = write_pictures(tmp_path / "bent", CAMERAS[::3], MARKERS, lens=known)
    found = last(find_cameras(paths, "markers", camera=known, marker_size=MARKER))
    assert {view.file.undistortion for view in found.views} == {known}
    true = CAMERAS[::3]
    assert errors([view.camera_from_world for view in found.views], true, 1.0)[1] < 0.5
    assert found.views[0].photo.undistortion == known
