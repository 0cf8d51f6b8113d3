"""Scale of cameras by markers, in drawn pictures of known cameras."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.still.marker_scale import NO_SCALE, scale_by_markers
from poseviewer.still.pictures import Placed, Placement
from tests.still_scene import CAMERA, MARKER, MARKERS, Solid, arc, marker, write_pictures

TRUE = arc(4)
SHORTER = 0.37
"""The cameras' scale before, in the true one."""
FAMILY = "AprilTag 36h11"


def scaled(paths: Sequence[Path], lens: Undistortion | None = None) -> Placement:
    short = [RigidTransform(place.rotation, SHORTER * place.translation) for place in TRUE]
    placed = {index: Placed(CAMERA, lens, place, 0.1) for index, place in enumerate(short)}
    before = Placement(placed, {}, {}, {})
    return scale_by_markers(lambda _: None, before, paths, FAMILY, MARKER)


def factor(found: Placement) -> float:
    own = found.placed[0].camera_from_world.translation
    return float((own @ TRUE[0].translation) / (TRUE[0].translation @ TRUE[0].translation))


def test_one_marker_tells_the_scale(tmp_path):
    found = scaled(write_pictures(tmp_path / "m", TRUE, MARKERS[:1], boxes=()))
    assert found.unit_known
    assert not found.notes
    assert factor(found) == pytest.approx(1.0, abs=0.005)


def test_a_lens_is_undone(tmp_path):
    lens = Undistortion.of(Lens("opencv", (-0.2, 0.0, 0.0, 0.0)), CAMERA)
    paths = write_pictures(tmp_path / "m", TRUE, MARKERS, boxes=(), lens=lens)
    assert factor(scaled(paths, lens)) == pytest.approx(1.0, abs=0.005)
    assert factor(scaled(paths)) != pytest.approx(1.0, abs=0.005)


def test_a_marker_of_another_side_than_most_is_said(tmp_path):
    larger = marker(9, 0.0, -0.2, 1.5 * MARKER)
    paths = write_pictures(tmp_path / "m", TRUE, (*MARKERS[1:3], larger), boxes=())
    found = scaled(paths)
    assert factor(found) == pytest.approx(1.0, abs=0.005)
    (note,) = found.notes
    assert "9 (1.5" in note


def test_a_marker_that_moves_or_is_seen_once_tells_none(tmp_path):
    def move(index: int, solids: list[Solid]) -> list[Solid]:
        return [*solids, marker(9, -0.1 + 0.06 * index, -0.3)]

    def once(index: int, solids: list[Solid]) -> list[Solid]:
        return [*solids, *(MARKERS[:1] if index == 1 else ())]

    for name, change in {"moving": move, "once": once}.items():
        found = scaled(write_pictures(tmp_path / name, TRUE, boxes=(), change=change))
        assert not found.unit_known
        assert found.notes[0].startswith(NO_SCALE)
        assert factor(found) == pytest.approx(SHORTER)
