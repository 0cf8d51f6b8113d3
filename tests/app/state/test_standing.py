"""A sequence becomes the views of a scene that stands still, and comes back."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import undo
from poseviewer.app.state.objects import add_object, set_unit
from poseviewer.app.state.session import Session
from poseviewer.app.state.standing import stand_still, still_document
from poseviewer.app.workers.finding_cameras import (
    StillChoice,
    find_still_cameras,
    known_camera,
)
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import QuickStartError
from poseviewer.files.cameras import Calibration
from poseviewer.files.image_sequence import load_sequence
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.sequence import with_frames
from poseviewer.scene.types import SearchResult, View
from poseviewer.still.still_cameras import StillCameras
from tests.app.sequences import CAMERA, COUNT, MESH, make_sequence, true_pose, write_sequence
from tests.app.state import edits as c
from tests.app.state.documents import after, open_files, refused
from tests.meshes import make_box

BOX = make_box((1.0, 1.5, 0.8))
SCALE = 0.5
"""Lengths of the world in one of the model's."""


def cameras(document: Document, left_out: tuple[int, ...] = (), **more: Any) -> StillCameras:
    """Cameras in whose frames the shape is where it is: it stands still in a world half as large,
    and the cameras move.
    """
    views = []
    for index, frame in enumerate(document.scene.frames):
        if index not in left_out:
            place = true_pose(index).camera_from_model
            place = RigidTransform(place.rotation, SCALE * place.translation)
            views.append(View(frame.file, CAMERA, place))
    return StillCameras("frames", "markers", tuple(views), **more)


def keyed(index: int = 0) -> Session:
    """The shape with a key at its true pose in a frame, which is shown."""
    document = make_sequence()
    document = document.at_frame(index, document.scene.frames[index].file)
    return Session(document).with_document(document.at_pose(true_pose(index)))


def still(session: Session, found: StillCameras) -> Session:
    document = session.document
    return after(session, stand_still(document, found, still_document(document, found)))


def off_px(document: Document, view: int) -> float:
    shown = document.scene.pose(0, view).project(MESH.vertices)
    return float(np.abs(shown - true_pose(view).project(MESH.vertices)).max())


def test_an_object_of_one_frame_is_in_all_where_the_scale_is_known():
    session = keyed(2)
    found = cameras(session.document, is_scale_known=True, unit=None)
    # Said in the model's unit: the world is as large as the model's.
    views = [replace(v, camera_from_world=true_pose(i).camera_from_model)
             for i, v in enumerate(found.views)]  # fmt: skip
    now = still(session, replace(found, views=tuple(views)))
    document = now.document
    assert (len(document.scene.views), document.scene.frames) == (COUNT, ())
    assert (document.view_index, document.scene.free_scale) == (2, False)
    assert max(off_px(document, view) for view in range(COUNT)) < 1e-6
    assert document.scene.pose(0, 2).camera_from_model.translation == pytest.approx(
        true_pose(2).camera_from_model.translation
    )
    assert (now.is_unsaved, document.object.is_placed) == (True, True)
    assert any("pictures have cameras" in note for note in document.scene.notes)
    back = after(now, undo()).document
    assert (len(back.scene.frames), back.scene.frame_index) == (COUNT, 2)
    assert "1" in back.scene.frames[2].poses


def test_a_scale_in_another_unit_is_the_units():
    session = keyed()
    session = after(session, set_unit("m"))
    found = cameras(session.document, is_scale_known=True, unit="cm")
    views = []
    for index, view in enumerate(found.views):
        place = true_pose(index).camera_from_model
        place = RigidTransform(place.rotation, 100.0 * place.translation)
        views.append(replace(view, camera_from_world=place))
    now = still(session, replace(found, views=tuple(views)))
    assert now.document.object.world_from_model.scale == pytest.approx(100.0)
    assert not any("says no unit" in note for note in now.document.scene.notes)
    assert max(off_px(now.document, view) for view in range(COUNT)) < 1e-6


def test_an_unknown_scale_is_that_at_which_the_cameras_look_at_the_object():
    session = keyed()
    now = still(session, cameras(session.document))
    scene = now.document.scene
    assert scene.free_scale
    # These cameras look past the shape, so that it is near the truth, and free.
    assert scene.objects[0].world_from_model.scale == pytest.approx(SCALE, rel=0.3)
    assert off_px(now.document, 0) < 1e-6


def test_of_several_objects_one_tells_the_scale_and_the_others_are_named():
    session = after(keyed(), add_object(ModelFile.of(BOX, name="box.ply")))
    session = after(session, c.press(60.0, 60.0), c.release())
    found = cameras(session.document)
    alone = still(session, found).document.scene
    assert [item.model.name for item in alone.objects] == ["box.ply"]
    (note,) = (note for note in alone.notes if "scale yet" in note)
    assert "m.ply left out; search for box.ply" in note
    both = still(session, replace(found, is_scale_known=True, unit="m")).document
    assert [item.is_placed for item in both.scene.objects] == [True, True]
    assert any("box.ply says no unit: m is taken" in note for note in both.scene.notes)
    ((x, y),) = both.scene.pose(1, 0).project(BOX.centre[None])
    assert (x, y) == pytest.approx((60.0, 60.0))


def test_another_object_is_added_once_a_search_has_told_the_scale():
    session = keyed()
    now = still(session, cameras(session.document))
    model = ModelFile.of(BOX, name="box.ply")
    assert "scale is not known" in refused(now, add_object(model))
    for verdict, is_told in ((Verdict("lost", 0.1), False), (Verdict("found", 0.9), True)):
        result = SearchResult(verdict=verdict)
        searched = replace(now, document=now.document.with_object(result=result))
        if is_told:
            added = after(searched, add_object(model)).document.scene
            assert (added.free_scale, len(added.objects)) == (False, 2)
            scales = [item.world_from_model.scale for item in added.objects]
            assert scales[0] == scales[1]
        else:
            assert "scale is not known" in refused(searched, add_object(model))


def test_a_frame_without_a_camera_leaves_its_object_to_the_nearest_that_has_one():
    session = keyed(3)
    document = session.document
    # The key in the frame that is left out is not the only one.
    document = document.at_frame(5, document.scene.frames[5].file)
    session = Session(document).with_document(document.at_pose(true_pose(5)))
    document = session.document.at_frame(3, document.scene.frames[3].file)
    session = replace(session, document=document)
    views = cameras(document, left_out=(3,), is_scale_known=True)
    place = [replace(v, camera_from_world=RigidTransform(
        v.camera_from_world.rotation, v.camera_from_world.translation / SCALE))
        for v in views.views]  # fmt: skip
    now = still(session, replace(views, views=tuple(place))).document
    assert len(now.scene.views) == COUNT - 1
    assert now.view.name in ("0002.png", "0004.png")
    assert now.object.is_placed
    for view, index in enumerate(i for i in range(COUNT) if i != 3):
        shown = now.scene.pose(0, view).project(MESH.vertices)
        np.testing.assert_allclose(shown, true_pose(index).project(MESH.vertices), atol=1e-6)
    unplaced = still(Session(make_sequence()), cameras(make_sequence())).document
    assert not unplaced.object.is_placed


def test_what_is_painted_stays_in_its_frame():
    session = keyed()
    scene = session.document.scene
    halves = [np.ones((CAMERA.height, CAMERA.width), np.float32) for _ in range(3)]
    for index, half in enumerate(halves):
        half[:, : 40 * (index + 1)] = 0.0
    masks = list(map(Mask.of, halves))
    frames = list(scene.frames)
    frames[1] = replace(frames[1], mask=masks[0], masks={"1": masks[1]}, occluders={"1": masks[2]})
    document = session.document.with_frames_of(replace(scene, frames=tuple(frames)))
    now = still(replace(session, document=document), cameras(document)).document.scene
    assert [view.mask is None for view in now.views] == [True, False, *[True] * (COUNT - 2)]
    own = now.objects[0].in_views[1]
    assert own.mask is not None
    assert own.occluders is not None
    for mask, half in zip((now.views[1].mask, own.mask, own.occluders), halves, strict=True):
        np.testing.assert_array_equal(mask.weights, half)


def test_cameras_of_frames_that_are_no_longer_open_change_nothing():
    session = keyed()
    found = cameras(session.document)
    other = with_frames(session.document.scene, session.document.scene.frames[:3])
    opened = replace(session, document=Document.of(other))
    before = session.document
    done = stand_still(before, found, still_document(before, found))
    assert after(opened, done) is opened


def test_an_object_that_was_moved_while_cameras_were_found_stays_where_it_is():
    session, moved = keyed(), keyed(1)
    found = cameras(session.document)
    done = stand_still(session.document, found, still_document(session.document, found))
    assert after(moved, done).document.view_index == 1
    assert off_px(after(moved, done).document, 1) < 1.0


def test_a_calibrated_camera_is_given_and_that_of_a_pose_is_not():
    document = make_sequence()
    view = document.scene.views[0]
    assert known_camera(document) == document.photo.camera == CAMERA
    photo = replace(document.photo, camera=None)
    views = (replace(view, file=replace(view.file, read=lambda: photo)),)
    assert view.camera == CAMERA
    assert known_camera(replace(document, scene=replace(document.scene, views=views))) is None
    undone = Undistortion.of(Lens("opencv", (-0.1, 0.0, 0.0, 0.0)), CAMERA)
    lens = replace(view, file=replace(view.file, undistortion=undone))
    assert known_camera(replace(document, scene=replace(document.scene, views=(lens,)))) is undone


def test_an_object_that_was_followed_gives_the_cameras(tmp_path: Path):
    session = keyed()
    for index in range(1, COUNT):
        document = session.document.at_frame(index, session.document.scene.frames[index].file)
        session = replace(session, document=document).with_document(
            document.at_pose(true_pose(index))
        )
    task = find_still_cameras(StillChoice("object"))
    result = task.run(session, tmp_path, lambda *_: None)
    assert f"{COUNT} of {COUNT} pictures have cameras, by object" in result.notes
    now = after(session, *result.edits).document
    assert not now.scene.free_scale
    assert max(off_px(now, view) for view in range(COUNT)) < 1e-6
    with pytest.raises(QuickStartError, match="open one first"):
        task.run(replace(session, document=now), tmp_path, lambda *_: None)


@pytest.mark.slow
def test_a_search_for_cameras_that_is_stopped_ends_its_process(tmp_path: Path):
    frames, model, camera, start = write_sequence(tmp_path)
    document = open_files(load_sequence(frames), model, start, Calibration(camera))

    def stop(*_: object) -> None:
        raise QuickStartError("stopped")

    task, own = find_still_cameras(StillChoice()), psutil.Process()
    before = own.children(recursive=True)
    with pytest.raises(QuickStartError, match="stopped"):
        task.run(Session(document), tmp_path, stop)
    assert own.children(recursive=True) == before
