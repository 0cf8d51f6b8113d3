"""What the page sends in other tools' formats is what ``convert`` and ``render`` write."""

from dataclasses import astuple, replace
from io import BytesIO
from zipfile import ZipFile

import numpy as np
import pytest

from poseviewer.app.state.display_edits import set_fields
from poseviewer.app.state.objects import add_object, alter_object, pick_object
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import CONVERTED, RELATIVE, export
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.maps import SIZE, MapMaker
from poseviewer.app.workers.opening import open_files
from poseviewer.errors import PoseViewerError
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.scene.settings import FitSettings
from tests.app.state.documents import after

OF_ONE_UNIT = ("bop", "dope", "linemod")


def test_every_format_of_convert_is_there():
    own = {name for name, known in FORMATS.items() if known.is_own}
    assert set(CONVERTED) - set(FORMATS) == {"masks, depth, normals", RELATIVE}
    assert set(FORMATS) - own == set(CONVERTED) & set(FORMATS)


@pytest.mark.parametrize("what", sorted({*CONVERTED} - {*OF_ONE_UNIT, RELATIVE}))
def test_a_pose_is_sent_in_every_format(scene, what):
    document = open_files(scene.photo, scene.model, scene.start)
    ((name, data),) = export(what, Session(document)).items()
    if what == "matrix":
        place = document.pose.camera_from_model
        wanted = np.column_stack([place.rotation, place.translation])
        np.testing.assert_allclose(np.loadtxt(BytesIO(data))[:3], wanted)
    if name.endswith(".zip"):
        names = ZipFile(BytesIO(data)).namelist()
        assert any("cameras.txt" in file or "/nocs/" in file for file in names)
    assert data


@pytest.mark.parametrize("what", ["opencv", "colmap", "nerfstudio"])
def test_an_assumed_focal_length_is_said_of_a_camera(scene, what, tmp_path):
    known = Session(open_files(scene.photo, scene.model, scene.start))
    camera = known.document.photo.default_camera()
    pose = replace(known.document.pose, camera=camera)
    assumed = Session(known.document.at_pose(pose))
    for session, is_assumed in ((known, False), (assumed, True)):
        notes: list[str] = []
        ((name, data),) = export(what, session, notes=notes).items()
        assert any("is assumed" in note for note in notes) == is_assumed
        out = tmp_path / str(is_assumed) / name
        out.parent.mkdir()
        out.write_bytes(data)
        if name.endswith(".zip"):
            ZipFile(out).extractall(out.parent)
            out = next(out.parent.rglob("cameras.txt")).parent
        text = (out / "cameras.txt" if out.is_dir() else out).read_text()
        has_comment = "# The focal length is assumed" in text
        assert has_comment == (is_assumed and what != "nerfstudio")
        found = FORMATS[what].read(out, ConvertOptions())
        wanted = astuple(session.document.pose.camera)
        np.testing.assert_allclose(astuple(found.views[0].camera), wanted)


def test_no_object_of_a_photo_has_another_ones_file(scene):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    session = after(session, add_object(), nudge("move", 5.0), add_object(), nudge("move", 9.0))
    session = after(session, alter_object(3, name="taxi v1.2"))
    for what in ("pose", "overlay", "matrix"):
        names = [next(iter(export(what, after(session, pick_object(i))))) for i in (1, 2, 3)]
        begins = "p.m.1.", "p.m.2.", "p.taxi v1.2."
        assert all(name.startswith(begin) for name, begin in zip(names, begins, strict=True))
    assert set(export("gltf", session)) == {"p.glb"}  # it holds them all


@pytest.mark.parametrize("what", OF_ONE_UNIT)
def test_a_format_of_one_unit_asks_for_the_models(scene, what):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    with pytest.raises(PoseViewerError, match="on the page with Model's unit"):
        export(what, session, "as it says")
    assert export(what, session, "mm")


def test_maps_are_saved_once_they_are_fine_by_both_losses_on_one_grid(scene):
    document = open_files(scene.photo, scene.model, scene.start)
    locked = ("rotation_x", "rotation_y", "rotation_z", "log_depth")
    document = document.with_object(settings=FitSettings("default", lock=locked))
    session = after(Session(document), set_fields("display", mapped_loss="both"))
    session = replace(session, other_settings=FitSettings("paper", lock=locked))
    coarse, *_, fine = MapMaker(renderer_of(document.mesh).clone()).run(session)
    for what in ("sheet", "maps-npz"):
        with pytest.raises(PoseViewerError, match="still coarse"):
            export(what, after(session, set_fields("results", landscapes=coarse)))
    saved = after(session, set_fields("results", landscapes=fine))
    assert len(export("sheet", saved)) == 2
    archives = [np.load(BytesIO(data)) for data in export("maps-npz", saved).values()]
    assert [archive["losses"].shape for archive in archives] == [(1, SIZE, SIZE)] * 2
    assert np.isfinite([archive["losses"] for archive in archives]).all()
