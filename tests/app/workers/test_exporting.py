"""What the page sends in other tools' formats is what ``convert`` and ``render`` write."""

import json
import shutil
from dataclasses import astuple, replace
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import trimesh

from poseviewer.app.state.edits import set_fields, undo
from poseviewer.app.state.objects import (
    add_object,
    alter_object,
    pick_object,
    set_unit,
    unit_of_models,
)
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import CONVERTED, RELATIVE, export
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.maps import SIZE, MapMaker
from poseviewer.app.workers.opening import open_sources
from poseviewer.app.workers.saving import Autosaver
from poseviewer.errors import PoseViewerError
from poseviewer.files.formats.bop import likely_numbers
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.scene_assets import load_model
from poseviewer.opening.sources import Sources
from poseviewer.scene.settings import FitSettings
from tests.app.state.documents import after, open_files
from tests.commands import run

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


def test_gltf_of_a_model_without_a_unit_says_so(scene):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    for unit, is_said in ((None, True), ("mm", False)):
        notes = list[str]()
        export("gltf", after(session, set_unit(unit)), notes)
        assert any("unit is not known" in note for note in notes) is is_said


@pytest.mark.parametrize("what", OF_ONE_UNIT)
def test_a_format_of_one_unit_asks_for_the_models(scene, what):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    numbers = ConvertOptions(image="4", object_ids=(2,))
    with pytest.raises(PoseViewerError, match="say it with `unit`"):
        export(what, session, numbers=numbers)
    assert export(what, after(session, set_unit("mm")), numbers=numbers)


def test_bop_on_the_page_is_what_convert_writes_with_the_numbers_that_are_asked(scene, tmp_path):
    photo = shutil.copy(scene.photo, tmp_path / "000007.png")
    models = [shutil.copy(scene.model, tmp_path / f"obj_{n:06d}.ply") for n in (5, 9)]
    session = Session(open_files(photo, models[0], scene.start))
    other = load_model(models[1])
    session = after(session, add_object(other), nudge("move", 9.0), set_unit("mm"))
    image, numbers = likely_numbers(session.document.scene)
    assert (image, numbers) == (7, (5, 9))
    Autosaver(tmp_path).save(session)
    line = f"convert {tmp_path}/000007.scene.json {tmp_path}/bop --to bop"
    assert run(line) == 0
    written = {path.relative_to(tmp_path / "bop"): path for path in (tmp_path / "bop").rglob("*.*")}
    ((name, data),) = export("bop", session, numbers=ConvertOptions(object_ids=numbers)).items()
    sent = ZipFile(BytesIO(data))
    assert name == "000007.bop.zip"
    within = {Path(*Path(own).parts[1:]): sent.read(own) for own in sent.namelist()}
    assert within == {own: path.read_bytes() for own, path in written.items()}
    assert {f"mask_visib/000007_00000{i}.png" for i in range(2)} <= set(map(str, within))
    # Other numbers on request, and none in silence where no name says them.
    asked = ConvertOptions(image="3", object_ids=(2, 4))
    ((_, data),) = export("bop", session, numbers=asked).items()
    (place,) = (own for own in ZipFile(BytesIO(data)).namelist() if "scene_gt.json" in own)
    poses = json.loads(ZipFile(BytesIO(data)).read(place))
    assert [pose["obj_id"] for pose in poses["3"]] == [2, 4]
    unnamed = after(Session(open_files(scene.photo, scene.model, scene.start)), set_unit("mm"))
    some = {"image": ConvertOptions(object_ids=(1,)), "object": ConvertOptions(image="0")}
    for missing, said in some.items():
        with pytest.raises(PoseViewerError, match=f"BOP wants the {missing}'s number"):
            export("bop", unnamed, numbers=said)


def test_numbers_are_guessed_apart_for_two_models_and_alike_for_one_twice(scene, tmp_path):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    other = load_model(shutil.copy(scene.model, tmp_path / "other.ply"))
    session = after(session, add_object(other), pick_object(1), add_object())
    assert likely_numbers(session.document.scene) == (None, (1, 2, 1))


def test_two_models_have_no_number_in_common_and_one_twice_has_one(scene, tmp_path):
    ball = tmp_path / "ball.ply"
    trimesh.creation.icosphere(radius=0.4).export(ball)
    session = Session(open_files(scene.photo, scene.model, scene.start))
    session = after(session, add_object(load_model(ball)), pick_object(1), add_object())
    session = after(session, set_unit("mm"))
    for numbers in ((1, 1, 2), (1, 2, 2)):
        with pytest.raises(PoseViewerError, match=f"have the number {numbers[1]} in BOP; give"):
            export("bop", session, numbers=ConvertOptions(image="0", object_ids=numbers))
    known = ConvertOptions(image="0", object_ids=(1, 2, 1))
    ((_, data),) = export("bop", session, numbers=known).items()
    (place,) = (own for own in ZipFile(BytesIO(data)).namelist() if "scene_gt.json" in own)
    poses = json.loads(ZipFile(BytesIO(data)).read(place))
    assert [pose["obj_id"] for pose in poses["0"]] == [1, 2, 1]


def test_a_unit_that_is_said_on_the_page_is_in_what_is_saved(scene, tmp_path):
    photo = Path(shutil.copy(scene.photo, tmp_path))
    session = after(Session(open_files(photo, scene.model, scene.start)), set_unit("cm"))
    assert session.is_unsaved
    (pose, *_) = Autosaver(tmp_path).save(session)
    assert json.loads(pose.read_text())["model"]["unit"] == "cm"
    assert unit_of_models(Session(open_files(photo, scene.model, pose))) == "cm"
    two = after(session, add_object(), nudge("move", 9.0), set_unit("mm"))
    assert unit_of_models(after(two, undo())) == "cm"
    path, *_ = Autosaver(tmp_path).save(two)
    objects = json.loads(path.read_text())["objects"]
    assert [item["model"]["unit"] for item in objects] == ["mm", "mm"]
    assert unit_of_models(Session(open_sources(Sources(scene=path)))) == "mm"


def test_maps_are_saved_once_they_are_fine_by_both_losses_on_one_grid(scene):
    document = open_files(scene.photo, scene.model, scene.start)
    locked = ("rotation_x", "rotation_y", "rotation_z", "log_depth")
    document = document.with_object(settings=FitSettings("default", lock=locked))
    session = after(Session(document), set_fields("display", mapped_loss="all"))
    session = session.keeping(FitSettings("paper", lock=locked))
    coarse, *_, fine = MapMaker(renderer_of(document.mesh).clone()).run(session)
    for what in ("sheet", "maps-npz"):
        with pytest.raises(PoseViewerError, match="still coarse"):
            export(what, after(session, set_fields("results", landscapes=coarse)))
    saved = after(session, set_fields("results", landscapes=fine))
    assert len(export("sheet", saved)) == 2
    archives = [np.load(BytesIO(data)) for data in export("maps-npz", saved).values()]
    assert [archive["losses"].shape for archive in archives] == [(1, SIZE, SIZE)] * 2
    assert np.isfinite([archive["losses"] for archive in archives]).all()
