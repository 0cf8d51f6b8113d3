"""A third loss, of ``assets/examples/own_loss.py``, is a file and a row of ``LOSSES``, no more."""

import asyncio
import runpy
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from poseviewer.app.below_viser.guard import serve
from poseviewer.app.page.controls import Controls
from poseviewer.app.page.map_panel import add_maps
from poseviewer.app.page.panels import add_fitting
from poseviewer.app.page.texts import ends_table
from poseviewer.app.state.results import LossComparison
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import search_edits
from poseviewer.app.workers.maps import MapMaker, maps_about
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.files.scene_json import load_scene, save_scene
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.pose_error import pose_error
from poseviewer.losses.known_losses import LOSSES
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state import edits as c
from tests.app.state.documents import after, open_files
from tests.commands import refusal, run

EXAMPLE = Path(__file__).resolve().parents[2] / "assets" / "examples" / "own_loss.py"
FIT = "fit p.png m.ply --pose start.json --quiet"


@pytest.fixture
def own() -> Iterator[str]:
    """Name of the example's loss, which has its row until the test ends."""
    before = dict(LOSSES)
    runpy.run_path(str(EXAMPLE))
    (name,) = set(LOSSES) - set(before)
    yield name
    LOSSES.clear()
    LOSSES.update(before)


@pytest.mark.slow
@pytest.mark.long
def test_the_command_line_fits_by_it(scene, own, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(scene.photo.parent)
    out = tmp_path / "pose.json"
    assert run(f"{FIT} --loss {own} --pixels whole --out {out}") == 0
    record = load_pose(out)
    assert record.settings is not None
    assert record.settings["loss"] == own
    assert record.loss is not None
    assert 0.0 <= record.loss < 0.1
    assert f"loss {record.loss:.3f} of 2" in capsys.readouterr().out
    mesh, truth = load_model(scene.model).mesh, load_pose(scene.truth).pose
    assert pose_error(mesh, record.pose, truth).percent < 2.0


def test_every_command_with_losses_has_it(own, capsys):
    for command in ("fit", "app", "study"):
        assert run(f"{command} --help") == 0
        assert f"--loss {{default,paper,{own}}}" in capsys.readouterr().out
    assert refusal(capsys, FIT, "--out", "o.json", "--loss", "owm").endswith("fit --help")
    assert refusal(capsys, FIT, "--out", "o.json", "--loss", own, "--colour-reflectance")


def test_its_value_is_that_of_the_pictures(scene, own):
    """The correlation of the greys of the photo and of the drawn model, over the full image."""
    session = Session(open_files(scene.photo, scene.model, scene.start))
    session = after(
        session, c.set_loss(own), c.alter_settings(lambda s: replace(s, pixels="whole"))
    )
    document = session.document
    problem, _ = make_problem(document.scene)
    drawn = SoftwareRenderer(document.mesh).render(document.pose)
    grey = np.where(drawn.mask, drawn.reflectance @ GREY_WEIGHTS, 0.0)
    photo = document.photo.grey()
    wanted = 1.0 - np.corrcoef(photo.ravel(), grey.ravel())[0, 1]
    renderer = SoftwareRenderer(document.mesh)
    assert pose_loss(problem, renderer, problem.start) == pytest.approx(wanted, abs=1e-4)


def test_the_page_offers_it_for_fits_and_for_maps(scene, own):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    guarded = serve("127.0.0.1", 0)
    try:
        controls = Controls(guarded.server.gui, lambda _: 0, session)
        add_fitting(controls)
        add_maps(controls)
        controls.show(after(session, c.set_loss(own)), 0)
        loop = guarded.server.get_event_loop()
        asyncio.run_coroutine_threadsafe(asyncio.sleep(0), loop).result(60.0)  # shown by then
        handles = guarded.server.gui._gui_input_handle_from_uuid.values()
        menus = {one.label: one for one in handles if isinstance(one, viser.GuiDropdownHandle)}
    finally:
        guarded.stop()
    label = LOSSES[own].label
    assert menus["Loss"].options == tuple(loss.label for loss in LOSSES.values())
    assert label in menus["Loss"].options
    assert menus["Loss"].value == label
    assert label in menus["Maps of"].options


def test_maps_show_it_alone_and_beside_the_others(scene, own):
    document = open_files(scene.photo, scene.model, scene.start)
    locked = FitSettings(lock=("rotation_x", "rotation_y", "rotation_z", "log_depth"))
    session = Session(document.with_object(settings=locked))
    renderer = SoftwareRenderer(document.mesh)
    for shown, names in ((own, [own]), ("all", list(LOSSES))):
        mapped = after(session, c.set_fields("display", mapped_loss=shown))
        maps = list(MapMaker(renderer.clone()).run(mapped))[-1]
        assert [item.problem.settings.loss for item in maps] == names
        mine = maps[names.index(own)]
        (piece,) = mine.slices
        assert np.isfinite(piece.losses).all()
        assert 0.0 <= piece.losses.min() < piece.losses.max() <= 2.0
        assert LOSSES[own].label in maps_about(mine, mapped).title


@pytest.mark.slow
@pytest.mark.long
def test_a_comparison_has_its_end_beside_the_others(scene, own):
    document = open_files(scene.photo, scene.model, scene.start)
    few = FitSettings(limits=Limits(100))
    session = after(Session(document.with_object(settings=few)), c.compare_losses())
    assert session.search is not None
    *_, last = search_edits(session.search)
    found: LossComparison = last.arguments[2]
    assert [end.settings.loss for end in found.ends] == list(LOSSES)
    header, *_ = ends_table(found).splitlines()
    assert header.split(" | ")[-1] == f"{own.capitalize()} |"
    mine = list(LOSSES).index(own)
    assert found.losses[mine, mine] == found.ends[mine].progress.loss
    taken = after(replace(session, comparison=found), c.take_end(mine))
    assert taken.document.settings.loss == own


def test_a_file_that_names_an_unknown_loss_is_refused(scene, own, tmp_path, capsys):
    path = tmp_path / "one.scene.json"
    document = open_files(scene.photo, scene.model, scene.start)
    save_scene(path, document.with_object(settings=FitSettings(own)).scene)
    assert load_scene(path).objects[0].settings.loss == own
    del LOSSES[own]
    said = refusal(capsys, f"fit {path} --out {tmp_path / 'end.json'}")
    known = "take one of default, paper."
    assert said == f"poseviewer: settings of a file: --loss {own}: there is no such choice; {known}"
