"""The app as its pages know it: what they send over the websocket, and what comes back."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from poseviewer.app.app import STOPPED_BY
from poseviewer.app.page.page import MAPS_WIDTHS, PANEL_WIDTHS
from poseviewer.app.page.scene import OUTLINE as OUTLINE_DEPTH
from poseviewer.app.page.scene import SIDE
from poseviewer.app.state.session import Preparation
from poseviewer.app.workers import tasks
from poseviewer.cli.main import main
from poseviewer.files.photo import save_image
from poseviewer.files.pose import load_pose
from poseviewer.files.state.autosave import SessionFile, load_autosave
from poseviewer.files.state.uploads import KEPT
from poseviewer.geometry.camera import Perspective
from tests.app.running_app import RunningApp, running_app, settle
from tests.app.socket_page import PHOTO, SocketPage
from tests.scene import Scene, make_scene
from tests.several import make_three

WIDTH, HEIGHT = 160, 120
MAPS = 15
"""Pairs of the free-body chart's six numbers."""
CENTRE = (86.0, 60.0)
"""A point of the photo on the model, in px."""
NOT_REPORTS = (
    "",
    "drag",
    "[1, 2]",
    "{}",
    '{"kind": 7}',
    '{"kind": "press"}',
    '{"kind": "press", "x": NaN, "y": 60}',
    '{"kind": "press", "x": 86, "y": 60, "zoom": Infinity}',
    '{"kind": "press", "x": 1e300, "y": -1e300}',
    '{"kind": "press", "x": {}, "y": []}',
    '{"kind": "press", "x": 1' + 400 * "0" + ', "y": 60}',
    '{"kind": "drag", "x": null, "y": 60}',
    '{"kind": "drag", "x": 3, "y": 60}',
    '{"kind": "release"}',
    '{"kind": "double", "x": "here", "y": 60}',
    '{"kind": "pick", "first": 0, "second": 1}',
    '{"kind": "pick", "first": Infinity, "second": 1, "u": 0.1, "v": 0.1}',
    '{"kind": "pick", "first": 77, "second": -3, "u": 0.1, "v": 0.1}',
    '{"kind": "enlarge", "first": NaN, "second": []}',
    '{"kind": "key"}',
    '{"kind": "key", "code": ["Space"]}',
    '{"kind": "key", "code": "NoSuchKey"}',
    '{"kind": "unfit"}',
    '{"kind": "unfit", "name": "a", "size": "many"}',
    '{"kind": "unfit", "name": "a", "size": 3}',
    '{"kind": "empty"}',
    '{"kind": "no such kind"}',
    200_000 * "[",
    7,
    None,
    [1.0],
    {"kind": "release"},
)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "files").mkdir()
    return make_scene(tmp_path / "files")


@pytest.fixture
def running(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    monkeypatch.chdir(tmp_path)
    with running_app(scene, tmp_path / "state") as app:
        yield app


def drag(page: SocketPage, by: tuple[float, float]) -> None:
    """Drag the model by px of the photo."""
    page.press(*CENTRE)
    page.drag(CENTRE[0] + by[0] / 2.0, CENTRE[1] + by[1])
    page.drag(CENTRE[0] + by[0], CENTRE[1] + by[1])
    page.release()


def drag_and_settle(page: SocketPage, by: tuple[float, float]) -> None:
    """Drag the model, and wait for its fine lines at another place."""
    before = page.outline()
    drag(page, by)
    page.wait_until(lambda: not np.array_equal(page.outline(), before))
    settle(page)


def outline_in_photo(page: SocketPage) -> NDArray[np.float64]:
    """(N, 2, 2): the outline in px of the photo."""
    unit = SIDE / max(WIDTH, HEIGHT) * OUTLINE_DEPTH
    return page.outline()[..., :2].astype(float) / unit + np.array([WIDTH, HEIGHT]) / 2.0


def middle(page: SocketPage) -> NDArray[np.float64]:
    """(2,): of the outline's box, in px of the photo."""
    points = outline_in_photo(page).reshape(-1, 2)
    return (points.min(axis=0) + points.max(axis=0)) / 2.0


def search_to_the_end(page: SocketPage) -> None:
    page.key("Space")
    page.wait_until(lambda: page.text_with("Converged"))


def files_below(folder: Path, but: Path) -> set[Path]:
    return {p for p in folder.rglob("*") if p.is_file() and but not in p.parents}


def test_photo_outline_and_maps_arrive(running: RunningApp) -> None:
    with running.page() as page:
        assert len(page.shown.nodes[PHOTO]["_data"]) > 1000
        assert page.shown.nodes[PHOTO]["render_width"] == SIDE
        points = outline_in_photo(page)
        assert len(points) > 50
        mesh = running.app.session.document.registration.mesh
        seen = running.pose.project(mesh.vertices)
        for found, wanted in ((points.min((0, 1)), seen.min(0)), (points.max((0, 1)), seen.max(0))):
            np.testing.assert_allclose(found, wanted, atol=0.6)
        page.wait_until(lambda: page.maps() >= MAPS)
        assert page.text_with("p.png")
        assert page.text_with("1,280 triangles")
        page.wait_until(lambda: page.text_with("at this pose"))  # another worker finds the loss


def test_drag_moves_the_outline_and_undo_brings_it_back(running: RunningApp) -> None:
    with running.page() as page:
        before, place, pose = page.outline(), middle(page), running.pose
        drag_and_settle(page, (-12.0, 7.0))
        np.testing.assert_allclose(middle(page) - place, [-12.0, 7.0], atol=0.8)
        centre = running.app.session.document.registration.mesh.centre
        np.testing.assert_allclose(
            running.pose.project(centre) - pose.project(centre), [-12.0, 7.0], atol=1e-9
        )
        after = page.outline()
        assert page.text_with("● unsaved")
        page.key("KeyZ")
        page.wait_until(lambda: np.array_equal(page.outline(), before))
        assert running.pose is pose
        page.key("KeyZ", shift=True)
        page.wait_until(lambda: np.array_equal(page.outline(), after))


def test_cancelled_drag_changes_nothing(running: RunningApp) -> None:
    with running.page() as page:
        pose = running.pose
        page.press(*CENTRE, shift=True)
        page.drag(100.0, 50.0)
        page.wait_until(lambda: running.pose is not pose)
        page.key("Escape")
        page.wait_until(lambda: running.pose is pose)
        assert running.app.session.history.past == ()


@pytest.mark.slow
def test_search_ends_at_the_command_lines_pose(running: RunningApp, tmp_path: Path) -> None:
    scene = running.scene
    saved = scene.photo.with_name("p.pose.json")
    with running.page() as page:
        assert not page.curve().size
        search_to_the_end(page)
        page.key("KeyS")
        page.wait_until(lambda: ("Saved p.pose.json", str(saved)) in page.shown.notices)
        status = page.text_with("Converged")
        _, losses = page.curve()
    assert losses.size > 2
    assert np.all(np.diff(losses) <= 0.0)
    files = [scene.photo, scene.model, "--pose", scene.start]
    assert main(["fit", *map(str, files), "--out", str(tmp_path / "fit.json"), "--quiet"]) == 0
    wanted = load_pose(tmp_path / "fit.json", WIDTH, HEIGHT)
    found = load_pose(saved, WIDTH, HEIGHT)
    assert found.pose.is_same(wanted.pose)
    assert found.loss == wanted.loss
    assert f"unexplained {wanted.unexplained:.3f}" in status


def test_space_stops_a_search(running: RunningApp) -> None:
    with running.page() as page:
        pose = running.pose
        page.key("Space")
        page.wait_until(lambda: page.text_with("evaluations"))
        page.key("Space")
        page.wait_until(lambda: page.text_with("Stopped"))
        search = running.app.session.search
        assert search is not None
        assert search.latest is not None
        assert search.latest.progress.status.name == "RUNNING"
        assert running.pose.is_same(search.latest.progress.pose)
        assert {"Keep it", "Go back"} <= page.labels()
        page.click("Go back")
        page.wait_until(lambda: running.pose is pose)
        assert not running.app._searcher.busy  # pyright: ignore[reportPrivateUsage]


def test_picked_point_of_a_map_is_the_pose(running: RunningApp) -> None:
    with running.page() as page:
        page.wait_until(lambda: page.maps() >= MAPS)
        before, pose = page.outline(), running.pose
        (latest,) = running.app.session.landscapes
        piece = next(s for s in latest.slices if (s.first, s.second) == (0, 2))
        page.report(kind="pick", first=0, second=2, u=0.75, v=0.5)
        page.wait_until(lambda: running.pose is not pose)
        x, y = piece.first_values, piece.second_values
        wanted = np.array(latest.parameters)
        wanted[0] = x[0] + 0.75 * (x[-1] - x[0])
        wanted[2] = y[0] + 0.5 * (y[-1] - y[0])
        assert running.pose.is_same(latest.case.problem.chart.to_pose(wanted))
        page.wait_until(lambda: not np.array_equal(page.outline(), before))
        page.key("KeyZ")
        page.wait_until(lambda: np.array_equal(page.outline(), before))
        assert running.pose is pose


def test_saved_pose_loads_to_the_last_digit(running: RunningApp) -> None:
    saved = running.scene.photo.with_name("p.pose.json")
    with running.page() as page:
        drag_and_settle(page, (5.3, -3.1))
        kept = running.pose
        page.key("KeyS")
        page.wait_until(lambda: page.text_with("no unsaved changes"))
        assert load_pose(saved, WIDTH, HEIGHT).pose.is_same(kept)
        drag_and_settle(page, (-9.0, 2.0))
        assert not running.pose.is_same(kept)
        page.upload("Pose file ...", "p.pose.json", saved.read_bytes())
        page.wait_until(lambda: running.pose.is_same(kept))


def test_files_that_are_none_change_nothing(running: RunningApp) -> None:
    with running.page() as page:
        document = running.app.session.document
        for label, name, data in (
            ("Photo ...", "notes.png", b"no picture"),
            ("Photo ...", "photo.exe", b"MZ"),
            ("Model ...", "empty.ply", b""),
            ("Model ...", "bad.obj", b"v 0 0 zero\n"),
            ("Pose file ...", "list.json", b"[1, 2"),
        ):
            seen = len(page.shown.notices)
            page.upload(label, name, data)
            text = page.wait_until(lambda seen=seen: failure(page, seen))
            assert text.startswith(f"{name}: ")
            assert "\n" not in text
            assert "Traceback" not in text
            assert running.app.session.document is document


@pytest.mark.slow
def test_broken_scene_files_are_said_and_change_nothing(
    running: RunningApp, tmp_path: Path
) -> None:
    folder = tmp_path / "three"
    folder.mkdir()
    scene = make_three(folder)
    beside = [(p.name, p.read_bytes()) for p in folder.iterdir() if p.suffix != ".json"]
    good = json.loads(scene.read_text())

    def changed(**objects: Any) -> bytes:
        first, *others = good["objects"]
        return json.dumps({**good, "objects": [{**first, **objects}, *others]}).encode()

    cases: tuple[tuple[bytes, list[tuple[str, bytes]], str], ...] = (
        (json.dumps(good).encode(), [], "photo.file is three.png, and there is no such file"),
        (b'{"format": "poseviewer-scene", ', beside, "JSON"),
        (json.dumps({**good, "objects": []}).encode(), beside, "wanted a list of one or more"),
        (changed(id="front"), beside, "two objects have the id 'front'"),
        (changed(model={"file": "gone.ply"}), beside, "objects[0].model.file is gone.ply"),
        (changed(pose={}), beside, "objects[0]"),
    )
    with running.page() as page:
        document = running.app.session.document
        for data, more, said in cases:
            seen = len(page.shown.notices)
            page.upload_set("Folder ...", [("s.scene.json", data), *more])
            text = page.wait_until(lambda seen=seen: failure(page, seen))
            assert text.startswith("s.scene.json")
            assert said in text
            assert str(tmp_path) not in text
            assert "uploads" not in text
            assert running.app.session.document is document
        page.upload_set("Folder ...", [("s.scene.json", json.dumps(good).encode()), *beside])
        page.wait_until(lambda: len(running.app.session.document.objects) == 3)


def test_panels_are_narrow_on_the_page_with_a_small_window_alone(running: RunningApp) -> None:
    with running.page() as page, running.page() as other:
        wide = sorted([PANEL_WIDTHS[0], MAPS_WIDTHS[0]])
        for one in (page, other):
            one.wait_until(lambda one=one: sorted(one.shown.widths) == wide)
        for height in ("high", float("nan"), -5):  # nonsense is dropped
            page.report(kind="arrange", maps="below", width=1000, height=height)
        page.report(kind="arrange", maps="beside", width=1000, height=200)
        page.wait_until(lambda: page.shown.widths[2:] == [PANEL_WIDTHS[1], MAPS_WIDTHS[1]])
        page.key("KeyB")
        other.wait_until(lambda: other.value("Photo alone (B)"))
        assert sorted(other.shown.widths) == wide
        page.key("KeyB")
        other.wait_until(lambda: not other.value("Photo alone (B)"))


def test_cameras_that_make_no_sense_are_refused_and_lose_nothing(running: RunningApp) -> None:
    with running.page() as page:
        document = running.app.session.document
        for label, value, words in (
            ("fx  (px)", 0.0, "Fx, fy = 0, "),
            ("fy  (px)", -40.0, "-40: wanted focal lengths of 1 to"),
            ("fx  (px)", math.nan, "Fx = nan: wanted a number"),
            ("cx  (px)", 1e5, "Cx, cy = 100000, "),
            ("Field of view °", 0.0, "Field of view = 0: wanted 0.5 to 170 degrees"),
            ("Field of view °", 400.0, "Field of view = 400: wanted 0.5 to 170 degrees"),
        ):
            seen, before = len(page.shown.notices), page.value(label)
            page.set(label, value)
            text = page.wait_until(lambda seen=seen: failure(page, seen))
            assert words in text
            assert text.endswith("; nothing was changed.")
            page.wait_until(lambda label=label, before=before: page.value(label) == before)
            assert running.app.session.document is document
            assert not running.app.session.history.past
        page.set("fx  (px)", 150.0)  # the fields still work
        page.wait_until(lambda: running.app.session.history.past)
        camera = running.pose.camera
        assert isinstance(camera, Perspective)
        assert camera.fx == 150.0


def failure(page: SocketPage, since: int) -> str:
    """What the first error message after ``since`` notices says."""
    found = [text for title, text in page.shown.notices[since:] if title == "That did not work"]
    return found[0] if found else ""


def test_uploaded_photo_and_model_open(running: RunningApp, tmp_path: Path) -> None:
    scene = running.scene
    other = tmp_path / "other.png"
    save_image(other, np.full((90, 200, 3), 120, np.uint8))
    with running.page() as page:
        before = page.outline()
        page.upload("Photo ...", other.name, other.read_bytes())
        page.wait_until(lambda: page.text_with("200 x 90 px") and page.text_with("other.png"))
        page.upload("Model ...", "again.ply", scene.model.read_bytes())
        page.wait_until(lambda: page.text_with("again.ply"))
        page.wait_until(lambda: len(page.outline()))
        for _ in range(2):
            page.key("KeyZ")
        page.wait_until(lambda: page.text_with("p.png") and page.text_with("m.ply"))
        page.wait_until(lambda: np.array_equal(page.outline(), before))


def test_escape_stops_what_is_being_read(
    running: RunningApp, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go = threading.Event(), threading.Event()
    keep = tasks.keep_set

    def slow(*given: Any, **more: Any) -> Path:
        begun.set()
        assert go.wait(60.0)
        return keep(*given, **more)

    other = tmp_path / "other.png"
    save_image(other, np.full((90, 200, 3), 120, np.uint8))
    monkeypatch.setattr(tasks, "keep_set", slow)
    with running.page() as page:
        document = running.app.session.document
        page.upload("Photo ...", other.name, other.read_bytes())
        assert begun.wait(60.0)
        page.wait_until(lambda: ("Reading other.png ...", STOPPED_BY) in page.shown.notices)
        page.key("Escape")
        page.upload("Pose file ...", "p.pose.json", running.scene.start.read_bytes())
        go.set()
        page.wait_until(lambda: running.app.session.document is not document)
        assert running.app.session.document.registration.photo is document.registration.photo
        page.key("KeyZ")
        page.wait_until(lambda: running.app.session.document is document)


def test_upload_writes_in_the_state_folder_alone(running: RunningApp, tmp_path: Path) -> None:
    before = files_below(tmp_path, running.state)
    picture = running.scene.photo.read_bytes()
    with running.page() as page:
        for number, name in enumerate(("../../x.png", "/tmp/x.png", "..\\..\\x.png"), start=1):
            page.upload("Photo ...", name, picture)
            page.wait_until(lambda n=number: len(running.app.session.history.past) == n)
        page.wait_until(lambda: page.text_with("**x.png**"))
        drag_and_settle(page, (3.0, 0.0))
        page.key("KeyS")
        page.wait_until(lambda: page.text_with("no unsaved changes"))
    new = files_below(tmp_path, running.state) - before
    assert [p.parent for p in new] == [tmp_path]  # the pose, where the app was started
    assert all(p.name.startswith("photo-") and p.name.endswith(".pose.json") for p in new)
    kept = (path.relative_to(running.state / "uploads") for path in running.state.rglob("*.png"))
    assert {path.parts[1:] for path in kept} == {("x.png",), ("tmp", "x.png")}


@pytest.mark.slow
def test_uploads_that_undo_can_bring_back_stay(running: RunningApp) -> None:
    uploads = running.state / "uploads"
    with running.page() as page:
        page.upload("Photo ...", "first.png", running.scene.photo.read_bytes())
        page.wait_until(lambda: page.text_with("first.png"))
        page.key("KeyZ")
        page.wait_until(lambda: page.text_with("p.png"))
        for number in range(KEPT + 2):
            page.upload("Pose file ...", f"{number}.json", b"[%d]" % number)
            page.wait_until(lambda n=number: any(f"{n}.json" in t for _, t in page.shown.notices))
        kept = [path.name for path in uploads.glob("*/*")]
        assert len(kept) == KEPT + 1
        assert "first.png" in kept
        page.key("KeyZ", shift=True)
        page.wait_until(lambda: page.text_with("first.png"))
        path = running.app.session.document.photo_path
        assert path is not None
        assert path.read_bytes() == running.scene.photo.read_bytes()


@pytest.mark.slow
def test_uploads_that_another_app_has_open_stay(running: RunningApp) -> None:
    """Two apps have one state folder; a crash of the other one would need its photo."""
    uploads = running.state / "uploads"
    with running.page() as page:
        page.upload("Photo ...", "others.png", running.scene.photo.read_bytes())
        page.wait_until(lambda: page.text_with("others.png"))
        (theirs,) = uploads.glob("*/others.png")
        page.key("ArrowLeft")
        own = page.wait_until(lambda: next(running.state.glob("sessions/*.json"), None))
        kept = load_autosave(own)
        other = SessionFile(own.parent)
        other.save(replace(kept, photo=theirs.resolve()))
        for _ in range(3):
            page.key("KeyZ")
        for number in range(5):  # until undo no longer reaches that photo
            page.upload("Photo ...", f"{number}.png", running.scene.photo.read_bytes())
            page.wait_until(lambda n=number: page.text_with(f"**{n}.png**"))
        for number in range(KEPT + 2):
            page.upload("Pose file ...", f"{number}.json", b"[%d]" % number)
            page.wait_until(lambda n=number: any(f"{n}.json" in t for _, t in page.shown.notices))
    other.close()
    assert theirs not in running.app.session.paths
    assert theirs.is_file()


def test_pages_show_the_same(running: RunningApp) -> None:
    with running.page() as one, running.page() as other:
        assert np.array_equal(one.outline(), other.outline())
        drag_and_settle(one, (8.0, 4.0))
        now = one.outline()
        other.wait_until(lambda: np.array_equal(other.outline(), now))
        drag_and_settle(other, (-3.0, -2.0))
        now = other.outline()
        one.wait_until(lambda: np.array_equal(one.outline(), now))


def test_page_that_comes_back_gets_what_is_there(running: RunningApp) -> None:
    with running.page() as page:
        drag_and_settle(page, (8.0, 4.0))
        now = page.outline()
        page.set("Seed", 7)
        page.wait_until(lambda: running.app.session.document.settings.seed == 7)
    with running.page() as page:
        page.wait_until(lambda: np.array_equal(page.outline(), now))
        page.wait_until(lambda: page.value("Seed") == 7 and page.text_with("● unsaved"))


def test_nonsense_changes_nothing(running: RunningApp) -> None:
    with running.page() as page:
        page.wait_until(lambda: page.maps() >= MAPS)
        document = running.app.session.document
        for text in NOT_REPORTS:
            page.report_text(text)
        page.report(kind="key", code="KeyG")  # answered after all of those
        page.wait_until(lambda: running.app.session.look.rings)
        assert running.app.session.document is document
        assert running.app.session.drag is None
        assert not running.app.session.searching


def test_pose_can_be_downloaded(running: RunningApp) -> None:
    with running.page() as page:
        page.click("Download pose")
        page.wait_until(lambda: any(_is_json(data) for data in page.shown.downloads.values()))
        (content,) = page.shown.downloads.values()
        path = running.state.parent / "downloaded.json"
        path.write_bytes(content)
        assert load_pose(path, WIDTH, HEIGHT).pose.is_same(running.pose)


def _is_json(data: bytes) -> bool:
    try:
        return bool(json.loads(data))
    except ValueError:
        return False


def test_why_kernels_could_not_be_compiled_is_said_and_the_model_is_still_placed(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def failing(_: object) -> Iterator[Preparation]:
        yield Preparation(0.2)
        raise OSError("no space left")

    monkeypatch.setattr("poseviewer.app.app.prepare", failing)
    with running_app(scene, tmp_path / "state") as app, SocketPage(app.url) as page:
        page.wait_until(lambda: page.text_with("no space left"))
        page.wait_until(lambda: len(page.outline()))
        before, first = app.pose, page.outline()
        page.key("Space")
        page.wait_until(lambda: any("no space left" in text for _, text in page.shown.notices))
        page.key("ArrowLeft")
        page.wait_until(lambda: not np.array_equal(page.outline(), first))
        assert not app.pose.is_same(before)
        assert "Search (space)" in page.labels()
