"""A review in the real app: its loop and its page's messages."""

from __future__ import annotations

import csv
import json
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.app import App
from poseviewer.app.below_viser.guard import serve
from poseviewer.app.reviewing import Reviewer
from poseviewer.batch.job import run_job
from poseviewer.batch.run import open_batch, save_outcome
from poseviewer.batch.scene import SceneOptions
from poseviewer.files.masks import mask_beside
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.transform import RigidTransform
from tests.app.running_app import settle
from tests.app.socket_page import SocketPage
from tests.scene import make_scene
from tests.several import make_bop


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A batch of three rows, fitted a little, and one that failed for want of a photo."""
    folder = tmp_path_factory.mktemp("batch")
    scene = make_scene(folder)
    lines = [f"{name}.png,{scene.model},{scene.start}" for name in ("a", "b", "c", "gone")]
    for name in ("a", "b", "c"):
        shutil.copy(scene.photo, folder / f"{name}.png")
    (folder / "jobs.csv").write_text("photo,model,start\n" + "\n".join(lines) + "\n")
    settings = FitSettings(limits=Limits(10, 600.0))
    batch = open_batch(folder / "jobs.csv", folder / "out", settings)
    save_outcome(batch, [run_job(job, batch.plan) for job in batch.to_do])
    return folder / "out"


@pytest.fixture
def out(results: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(results, tmp_path / "out"))


@contextmanager
def reviewing(out: Path) -> Iterator[tuple[App, SocketPage]]:
    review = Reviewer(out)
    opened = review.open_first()
    guarded = serve("127.0.0.1", 0)
    app = App(guarded.server, opened, out.parent / "state", review)
    loop = threading.Thread(target=app.run, name="app")
    loop.start()
    try:
        with SocketPage(guarded.url) as page:
            settle(page)
            yield app, page
            assert loop.is_alive()
    finally:
        app.stop()
        loop.join(60.0)
        guarded.stop()


def rows_of(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def poses_of(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / "poses").glob("*.json")}


def test_an_estimate_that_was_kept_is_said(tmp_path: Path) -> None:
    scene = make_scene(tmp_path)
    start = load_pose(scene.start, 160, 120).pose
    turn = RigidTransform.from_rotation_vector([2.0, 1.0, 0.0], [0.0, 0.0, 0.0])
    turned = replace(start, camera_from_model=start.camera_from_model @ turn)
    save_pose(scene.start, PoseRecord(turned))
    row = f"{scene.photo},{scene.model},{scene.start}\n"
    (tmp_path / "jobs.csv").write_text("photo,model,start\n" + row)
    settings = FitSettings(limits=Limits(10, 600.0), keep_start=True)
    batch = open_batch(tmp_path / "jobs.csv", tmp_path / "out", settings)
    save_outcome(batch, [run_job(job, batch.plan) for job in batch.to_do])
    with reviewing(tmp_path / "out") as (app, page):
        page.wait_until(lambda: page.text_with("The start was kept: the search ended"))
        # What a person searches for is not given back.
        assert not app.session.document.settings.keep_start


@pytest.mark.slow
def test_accept_mend_and_a_draft_outlive_the_app(out: Path) -> None:
    before = poses_of(out)
    with reviewing(out) as (app, page):
        page.wait_until(lambda: page.text_with("2 of 4"))  # the first, without a photo, is skipped
        page.key("KeyA")
        page.wait_until(lambda: page.text_with("3 of 4"))
        page.wait_until(lambda: page.text_with("1 accepted"))
        page.key("ArrowRight")
        page.wait_until(lambda: page.text_with("pose changed"))
        mended = app.session.document.pose.camera_from_model.translation
        page.key("KeyA")
        page.wait_until(lambda: page.text_with("4 of 4"))
        page.key("ArrowDown")
        page.wait_until(lambda: page.text_with("pose changed"))
        draft = app.session.document.pose.camera_from_model.translation
        page.key("KeyP")
        page.wait_until(lambda: page.text_with("3 of 4"))
        page.key("KeyZ")  # undo stays in the row
        page.key("KeyN")
        page.wait_until(lambda: page.text_with("4 of 4"))
        assert app.session.document.pose.camera_from_model.translation == pytest.approx(draft)
    said = [row["review"] for row in rows_of(out)]
    assert sorted(said) == ["", "", "accepted", "mended"]
    row = next(row for row in rows_of(out) if row["review"] == "mended")
    saved = json.loads((out / row["pose"]).read_text())["camera_from_model"]["translation"]
    assert saved == pytest.approx(mended.tolist(), abs=1e-9)
    changed = [name for name, content in poses_of(out).items() if before.get(name) != content]
    assert sorted(changed) == sorted([Path(row["pose"]).name,
                                      Path(row["pose"]).stem + ".fitted.json"])  # fmt: skip
    with reviewing(out) as (app, page):  # as it was left
        page.wait_until(lambda: page.text_with("2 accepted"))
        page.wait_until(lambda: page.text_with("pose changed"))
        assert app.session.document.pose.camera_from_model.translation == pytest.approx(draft)


@pytest.mark.slow
def test_what_is_hidden_is_kept_with_the_row(out: Path) -> None:
    stroke = {"kind": "stroke", "shape": "brush", "radius": 9.0, "erase": False}
    with reviewing(out) as (app, page):
        page.wait_until(lambda: page.text_with("2 of 4"))
        page.report(**stroke, points=[40.0, 60.0, 90.0, 60.0])
        page.wait_until(lambda: page.text_with("pose changed"))
        page.key("KeyN")
        page.wait_until(lambda: page.text_with("3 of 4"))
        assert app.session.document.registration.mask is None
        page.key("KeyP")
        page.wait_until(lambda: page.text_with("2 of 4"))
        page.wait_until(lambda: page.text_with("pose changed"))
        mask = app.session.document.registration.mask
        assert mask is not None
        page.key("KeyA")
        page.wait_until(lambda: page.text_with("1 accepted"))
    row = next(row for row in rows_of(out) if row["review"] == "mended")
    path = out / row["pose"]
    saved, notes = mask_beside(path, load_pose(path, 160, 120), 160, 120)
    assert notes == ()
    assert saved is not None
    assert np.array_equal(saved.weights, mask.weights)
    assert not list((out / "review").glob("*"))


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """A batch of a BOP scene's image whose three objects were fitted together, a little."""
    scene, models = make_bop(tmp_path), tmp_path / "models"
    settings = FitSettings(limits=Limits(10, 600.0))
    options = SceneOptions(models, together=True)
    batch = open_batch(scene, tmp_path / "out", settings, None, options)
    for job in batch.to_do:
        run_job(job, batch.plan)
    save_outcome(batch, [])
    return tmp_path / "out"


@pytest.mark.slow
def test_an_image_is_shown_with_all_its_objects(image: Path) -> None:
    before, pictures = poses_of(image), pictures_of(image)
    with reviewing(image) as (app, page):
        page.wait_until(lambda: page.text_with("1 of 3"))
        document = app.session.document
        assert [one.number for one in document.objects] == [1, 2, 3]
        assert len(document.registration.others) == 2  # what they hide does not count
        assert all(one.locked for one in document.others)
        said = [one.verdict for one in document.objects]
        assert set(said) <= {"found", "doubtful", "lost"}
        assert all(page.text_with("pv-objects").count(f"<td>{word}</td>") for word in said)
        # To hide another is no change of the row's pose.
        other = document.others[0].number
        page.report(kind="object", wish="hide", number=other)
        page.wait_until(lambda: not app.session.document.standing[1:])
        assert not page.text_with("pose changed")
        page.report(kind="object", wish="unlock", number=other)
        page.wait_until(lambda: any("rows of the batch" in text for _, text in page.shown.notices))
        page.report(kind="object", wish="pick", number=other)
        page.wait_until(lambda: app.session.document.number == other)
        page.key("ArrowRight")
        page.wait_until(lambda: page.text_with("pose changed"))
        page.key("KeyA")
        page.wait_until(lambda: page.text_with("1 accepted"))
    changed = [name for name, content in poses_of(image).items() if before.get(name) != content]
    assert len(changed) == 2  # the one mended, and beside it the one that was found
    assert all(pictures_of(image)[name] != content for name, content in pictures.items())


def pictures_of(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / "pictures").glob("*.jpg")}
