"""Pictures that tell no cameras, or not all of them: what is found is right, the rest is said."""

import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform
from poseviewer.still import features
from poseviewer.still.pictures import Placement
from poseviewer.still.still_cameras import place_pictures
from tests.still_scene import (
    BOXES,
    CAMERA,
    MARKER,
    MARKERS,
    PLACES,
    Solid,
    arc,
    errors,
    look_at,
    marker,
    noise,
    sheet,
    spin,
    write_pictures,
)

ARC = arc(6)


def place(
    paths: Sequence[Path], by: str, folder: Path, camera: Perspective | None = CAMERA,
    marker_size: float | None = None,
) -> Placement:  # fmt: skip
    """Find cameras in this process, of a known camera unless another is given."""
    given = paths, by, camera, marker_size, folder
    return place_pictures(lambda _: None, *given).placement  # pyright: ignore[reportArgumentType]


def off(found: Placement, scale: float | None = None, true=ARC) -> tuple[float, float]:
    order = sorted(found.placed)
    placed = [found.placed[index].camera_from_world for index in order]
    return errors(placed, [true[index] for index in order], scale)


@pytest.mark.slow
def test_two_pictures_do_where_the_camera_is_known_and_say_it_is_assumed_where_not(tmp_path):
    cameras = arc(2, 20.0)
    paths = write_pictures(tmp_path / "two", cameras)
    found = place(paths, "features", tmp_path)
    assert off(found, true=cameras)[0] < 0.2
    (tmp_path / "again").mkdir()
    (note,) = place(paths, "features", tmp_path / "again", None).notes
    assert "focal length is assumed" in note


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, None])
def test_a_camera_that_turns_on_the_spot_is_refused(tmp_path, camera):
    paths = write_pictures(tmp_path / "spin", spin(5))
    with pytest.raises(SettingsError, match="turned on the spot"):
        place(paths, "features", tmp_path, camera)


@pytest.mark.slow
def test_a_still_camera_before_moving_things_is_refused(tmp_path):
    def move(index: int, solids: list[Solid]) -> list[Solid]:
        by = RigidTransform(np.eye(3), np.array([0.03 * index, 0.0, 0.0]))
        return [solids[0], *(tuple(one.moved(by) for one in solid) for solid in solids[1:])]

    paths = write_pictures(tmp_path / "still", [look_at(0.0)] * 5, change=move)
    with pytest.raises(SettingsError, match="stood still"):
        place(paths, "features", tmp_path)


def test_pictures_without_texture_are_refused(tmp_path):
    paths = write_pictures(tmp_path / "plain", ARC[:3], boxes=(), contrast=0.0)
    with pytest.raises(SettingsError, match=r"0 of 3 pictures can be used .*too little texture"):
        place(paths, "features", tmp_path)


@pytest.mark.slow
def test_a_thing_that_moves_among_others_leaves_the_cameras_right(tmp_path):
    def move(index: int, solids: list[Solid]) -> list[Solid]:
        by = RigidTransform(np.eye(3), np.array([0.03 * index, 0.0, 0.0]))
        return [*solids[:-1], tuple(one.moved(by) for one in solids[-1])]

    paths = write_pictures(tmp_path / "one", ARC, change=move)
    assert off(place(paths, "features", tmp_path))[0] < 0.2


@pytest.mark.slow
def test_two_places_are_told_apart(tmp_path):
    def elsewhere(index: int, solids: list[Solid]) -> list[Solid]:
        if index < 4:
            return solids
        wall = sheet((0.0, 0.9, 0.4), (1.6, 0.0, 0.0), (0.0, 0.0, 0.9), noise(3.2, 1.8, 70))
        top = sheet((0.0, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 0.6, 0.0), noise(1.6, 1.2, 71))
        return [(wall, top)]

    cameras = [*arc(4, 40.0), *arc(3, 30.0)]
    paths = write_pictures(tmp_path / "two", cameras, change=elsewhere)
    found = place(paths, "features", tmp_path)
    assert sorted(found.placed) == [0, 1, 2, 3]
    assert set(found.left_out) == {4, 5, 6}
    assert "4 pictures hang together, 3 others among themselves" in found.notes[0]


@pytest.mark.slow
@pytest.mark.long
def test_pictures_of_two_sizes_have_a_camera_each(tmp_path):
    large = Perspective(300.0, 300.0, 200.0, 160.0, 400, 320)
    paths = write_pictures(tmp_path / "a", ARC)
    others = write_pictures(tmp_path / "b", ARC, camera=large)
    found = place([*paths[:3], *others[3:]], "features", tmp_path, None)
    assert off(found)[0] < 0.2
    assert {own.camera.width for own in found.placed.values()} == {320, 400}
    (tmp_path / "again").mkdir()
    found = place([*paths[:3], *others[3:]], "features", tmp_path / "again")
    assert set(found.left_out) == {3, 4, 5}
    assert "400x320 px, and the camera is for 320x240" in found.left_out[3]


@pytest.mark.slow
@pytest.mark.long
def test_pictures_of_several_zooms_have_a_camera_each_by_exif_and_are_doubted_without(tmp_path):
    near = Perspective(450.0, 450.0, 160.0, 120.0, 320, 240)
    paths, others = (
        write_pictures(tmp_path / name, ARC, camera=camera)
        for name, camera in (("far", CAMERA), ("near", near))
    )
    mixed = [others[i] if i % 3 == 0 else paths[i] for i in range(len(ARC))]
    notes = " ".join(place(mixed, "features", tmp_path, None).notes)
    assert "were they zoomed?" in notes
    for own, camera in ((paths, CAMERA), (others, near)):
        for path in own:
            exif = Image.Exif()
            focal = camera.fx / np.hypot(320, 240) * np.hypot(36.0, 24.0)
            exif[IFD.Exif] = {Base.FocalLengthIn35mmFilm: round(focal)}
            with Image.open(path) as picture:
                picture.save(path, exif=exif)
    (tmp_path / "again").mkdir()
    found = place(mixed, "features", tmp_path / "again", None)
    assert off(found)[0] < 0.2
    assert not found.notes
    focals = [round(found.placed[i].camera.fx, -1) for i in range(len(ARC))]
    assert focals == [450.0, 300.0, 300.0, 450.0, 300.0, 300.0]
    assert len(set(found.focals_px.values())) == 2


@pytest.mark.slow
def test_a_broken_picture_and_one_that_is_there_twice_are_left_out(tmp_path):
    paths = write_pictures(tmp_path / "a", ARC)
    paths[2].write_bytes(paths[2].read_bytes()[:3000])
    paths[4].write_bytes(paths[3].read_bytes())
    found = place(paths, "features", tmp_path)
    assert sorted(found.placed) == [0, 1, 3, 5]
    assert "cannot be read" in found.left_out[2]
    assert found.left_out[4] == "the same picture as 0003.png"


@pytest.mark.slow
@pytest.mark.long
def test_frames_between_the_chosen_ones_are_placed_by_their_points(tmp_path, monkeypatch):
    monkeypatch.setattr(features, "MAX_WHOLE", 6)
    monkeypatch.setattr(features, "CHOSEN", 5)
    cameras, told = arc(10, 45.0), list[str]()
    paths = write_pictures(tmp_path / "film", cameras)
    found = place_pictures(told.append, paths, "features", CAMERA, None, tmp_path).placement
    assert sorted(found.placed) == list(range(10))
    degrees, percent = off(found, true=cameras)
    assert degrees < 0.2
    assert percent < 0.3
    assert "features 6 of 6" in told
    assert "placed 4 of the 4 between" in told


def test_without_pycolmap_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(SettingsError, match=r"pip install 'poseviewer\[cameras\]'"):
        place([tmp_path / "a.png", tmp_path / "b.png"], "features", tmp_path)


@pytest.mark.slow
def test_a_marker_of_another_size_is_said(tmp_path):
    larger = (*MARKERS[:4], marker(9, 0.0, -0.3, 1.5 * MARKER))
    paths = write_pictures(tmp_path / "m", ARC, larger, boxes=())
    found = place(paths, "markers", tmp_path, marker_size=MARKER)
    (note,) = found.notes
    assert "marker 9 has 1.50 times the side of most" in note
    assert off(found, 1.0)[1] < 0.6


@pytest.mark.slow
@pytest.mark.long
def test_a_marker_that_moves_is_left_out_and_said(tmp_path):
    def move(index: int, solids: list[Solid]) -> list[Solid]:
        return [*solids, marker(9, -0.1 + 0.03 * index, -0.3)]

    paths = write_pictures(tmp_path / "m", ARC, MARKERS, boxes=(), change=move)
    found = place(paths, "markers", tmp_path, marker_size=MARKER)
    assert [note[: len("marker 9 did not stay")] for note in found.notes] == [
        "marker 9 did not stay"
    ]
    assert off(found, 1.0)[1] < 0.6


def test_a_number_that_is_there_twice_is_not_used_and_said(tmp_path):
    paths = write_pictures(tmp_path / "m", ARC[:3], (*MARKERS, marker(0, 0.0, -0.3)), boxes=())
    found = place(paths, "markers", tmp_path, marker_size=MARKER)
    assert len(found.placed) == 3
    (note,) = found.notes
    assert "marker 0 is there twice in 0000.png" in note


def test_mirrored_markers_are_none(tmp_path):
    mirrored = [marker(n, x, y, mirrored=True) for n, (x, y) in enumerate(PLACES)]
    paths = write_pictures(tmp_path / "m", ARC[:2], mirrored, boxes=())
    with pytest.raises(SettingsError, match="unmirrored"):
        place(paths, "markers", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["DICT_4X4_50", "DICT_6X6_250", "DICT_APRILTAG_25H9"])
def test_the_family_of_markers_is_found(tmp_path, family):
    number = getattr(cv2.aruco, family)
    own = [marker(n, x, y, family=number) for n, (x, y) in enumerate(PLACES)]
    paths = write_pictures(tmp_path / "m", ARC[::2], own, boxes=())
    found = place(paths, "auto", tmp_path, marker_size=MARKER)
    assert off(found, 1.0, ARC[::2])[1] < 1.0


def test_pictures_that_share_no_marker_do_not_hang_together(tmp_path):
    def apart(index: int, solids: list[Solid]) -> list[Solid]:
        return [solids[0], *(MARKERS[:1] if index < 3 else MARKERS[1:2])]

    paths = write_pictures(tmp_path / "m", ARC[:5], boxes=(), change=apart)
    found = place(paths, "markers", tmp_path)
    assert sorted(found.placed) == [0, 1, 2]
    assert "3 pictures hang together, 2 others among themselves" in found.notes[0]


def test_without_markers_their_size_is_refused(tmp_path):
    paths = write_pictures(tmp_path / "m", ARC[:2], boxes=BOXES)
    with pytest.raises(SettingsError, match="no marker in the pictures"):
        place(paths, "auto", tmp_path, marker_size=MARKER)
    with pytest.raises(SettingsError, match="no marker in the pictures"):
        place(paths, "features", tmp_path, marker_size=MARKER)
