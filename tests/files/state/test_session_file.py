"""Sessions: written and read back, left behind by a killed process, damaged."""

import logging
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import AutosaveError
from poseviewer.files.scene_assets import frame_file, model_file, view_of_file
from poseviewer.files.scene_json import form_of
from poseviewer.files.state.session_file import (
    AutosavedSession,
    SessionFile,
    discard,
    files_of_sessions,
    find_abandoned,
    load_autosave,
)
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.scene.sequence import show_frame, store_key, with_frames
from poseviewer.scene.types import Frame, InView, Scene, SceneObject, SearchResult
from tests.several import CAMERA, IDS, STARTS
from tests.writing import edit

ODD = os.fsdecode("/photos/Straße 道".encode() + b"\xff\xfe.jpg")
"""A path that is no text."""


def session(**changes: Any) -> AutosavedSession:
    """A session of three objects, with a mask and a photo that is oddly called."""
    mask = Mask.of(np.tri(240, 320))
    view, objects = view_of_file(Path(ODD), CAMERA, "0" * 64, mask=mask), []
    for number, (name, placed) in enumerate(zip(IDS, STARTS, strict=True), 1):
        model = model_file(Path(f"/photos/three/{name}.ply"))
        place = view.world_from_model(placed.pose)
        objects.append(SceneObject(id=str(number), model=model, world_from_model=place))
    own = InView(mask=mask, region=Rectangle(1.0, 2.0, 3.0, 4.5), is_compared=False)
    sure = PoseCovariance(STARTS[0].pose, np.zeros(3), np.eye(6), 0.5)
    objects[0] = replace(
        objects[0], in_views=(own,), locked=True, start=objects[1].world_from_model,
        start_cameras=(replace(CAMERA, fx=1.0),), result=SearchResult(covariance=sure, seen=(0.5,)),
    )  # fmt: skip
    scene = Scene(views=(view,), objects=tuple(objects))
    shown: Any = {"active_object": "1", "active_view": 0, "photo_names": ("three.png",)}
    return AutosavedSession(saved_at=1.7e9 + 1.0 / 3.0, scene=scene, **(shown | changes))


def as_json(kept: AutosavedSession) -> Any:
    """All that a session says."""
    return msgspec.to_builtins(form_of(AutosavedSession).encode(kept))


def require_left(folder: Path) -> tuple[Path, Any]:
    """The newest file that was left behind, and what it says."""
    path, kept = find_abandoned(folder) or pytest.fail("none was left behind")
    return path, as_json(kept)


def saved(folder: Path, session: AutosavedSession) -> Path:
    """The file of a session that was left behind."""
    file = SessionFile(folder)
    file.save(session)
    file.close()
    return file.path


def test_sessions_come_back_to_the_last_digit(tmp_path: Path) -> None:
    whole = session(active_object="2")
    again = load_autosave(saved(tmp_path, whole))
    assert as_json(again) == as_json(whole)
    assert again.scene.objects[0].start_cameras[0].width == CAMERA.width
    assert (whole.photo_name, whole.model_name) == ("three.png", "front.ply")
    models = {Path(f"/photos/three/{name}.ply") for name in IDS}
    assert files_of_sessions(tmp_path) == {Path(ODD), *models}


CHILD = """
import sys
from pathlib import Path
from poseviewer.files.state.session_file import SessionFile, load_autosave
file = SessionFile(Path(sys.argv[1]))
file.save(load_autosave(Path(sys.argv[2])))
print(file.path, flush=True)
sys.stdin.read()
"""


def test_a_killed_process_leaves_its_session_behind(tmp_path: Path) -> None:
    like = saved(tmp_path / "other", session())
    folder = tmp_path / "sessions"
    line = [sys.executable, "-c", CHILD, str(folder), str(like)]
    pipe = subprocess.PIPE
    with subprocess.Popen(line, stdin=pipe, stdout=pipe, text=True) as child:
        path = Path(child.stdout.readline().strip())
        assert path.is_file()
        assert find_abandoned(folder) is None
        child.kill()
        child.wait(60)
    assert require_left(folder) == (path, as_json(session()))
    discard(path)
    discard(path)
    assert list(folder.iterdir()) == []
    assert find_abandoned(folder) is find_abandoned(tmp_path / "nothing") is None


def test_the_newest_is_the_one_left_behind(tmp_path: Path) -> None:
    paths = [saved(tmp_path, replace(session(), saved_at=1.7e9 - age)) for age in (2.0, 1.0, 3.0)]
    assert require_left(tmp_path)[0] == paths[1]
    os.utime(paths[1], (0.0, 0.0))
    assert require_left(tmp_path)[0] == paths[0]
    assert not paths[1].exists()


def test_a_session_is_saved_though_its_folder_was_removed(tmp_path: Path) -> None:
    file = SessionFile(tmp_path)
    file.save(session())
    shutil.rmtree(tmp_path)
    file.save(session(active_object="2"))
    assert find_abandoned(tmp_path) is None
    file.close()
    assert require_left(tmp_path) == (file.path, as_json(session(active_object="2")))


def sequence(count: int) -> AutosavedSession:
    """A session of a sequence, with a key in the first frame."""
    still = session()
    view = still.scene.views[0]
    paths = (Path(f"/photos/f{index}.jpg") for index in range(count))
    frames = [Frame(file=frame_file(path, view), time_s=0.1) for path in paths]
    return replace(still, scene=store_key(with_frames(still.scene, frames), 0))


def with_key(kept: AutosavedSession, frame_index: int) -> AutosavedSession:
    return replace(kept, scene=store_key(show_frame(kept.scene, frame_index), 0))


def test_frames_that_change_are_added_alone(tmp_path: Path) -> None:
    file, kept = SessionFile(tmp_path), sequence(2000)
    log = file.path.with_suffix(".frames")
    file.save(kept)
    whole = log.stat().st_size
    for index in range(1, 4):
        kept = with_key(kept, index)
        file.save(kept)
    assert whole < log.stat().st_size < 1.02 * whole
    assert file.path.stat().st_size < 20_000
    assert as_json(load_autosave(file.path)) == as_json(kept)
    assert Path("/photos/f1999.jpg") in files_of_sessions(tmp_path)
    file.save(session())
    assert not log.exists()
    file.save(sequence(3))
    file.close()
    assert require_left(tmp_path) == (file.path, as_json(sequence(3)))
    discard(file.path)
    assert not any(tmp_path.iterdir())


def test_a_session_is_removed_with_no_file_that_it_names(tmp_path: Path) -> None:
    kept, names = sequence(2), [tmp_path / "f0.jpg", tmp_path / "f1.jpg", tmp_path / "a.ply"]
    for path in names:
        path.write_bytes(b"mine")
    view = kept.scene.views[0]
    frames = [
        replace(f, file=frame_file(p, view))
        for f, p in zip(kept.scene.frames, names[:2], strict=True)
    ]
    item = replace(kept.scene.objects[0], model=model_file(names[2]))
    scene = replace(kept.scene, objects=(item,), frames=tuple(frames))
    path = saved(tmp_path / "sessions", replace(kept, scene=scene))
    os.utime(path, (0.0, 0.0))
    assert find_abandoned(path.parent) is None
    assert list(path.parent.iterdir()) == []
    assert [name.read_bytes() for name in names] == [b"mine"] * 3


def test_a_log_of_frames_is_written_anew_and_may_be_broken_off(tmp_path: Path) -> None:
    file, kept = SessionFile(tmp_path), sequence(3)
    log = file.path.with_suffix(".frames")
    for index in [0, 1, 2] * 4:
        kept = with_key(kept, index)
        file.save(kept)
        assert len(log.read_text().splitlines()) <= 9
    file.close()
    before = as_json(kept)
    with log.open("ab") as stream:
        stream.write(log.read_bytes().splitlines()[0][:-7])
    kept = load_autosave(file.path)
    assert as_json(replace(kept, notes=())) == before
    (note,) = kept.notes
    assert note.startswith("Changes of frames that were cut off as they were saved, left out: 1;")
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[-3:]).replace(b"[0", b"[5"))
    with pytest.raises(AutosaveError, match="frames are missing"):
        load_autosave(file.path)


def test_a_disk_that_fills_in_the_middle_of_a_frame_leaves_no_half_line(tmp_path: Path) -> None:
    resource: Any = pytest.importorskip("resource")
    file, kept = SessionFile(tmp_path), sequence(3)
    log = file.path.with_suffix(".frames")
    file.save(kept)
    before = log.read_bytes()
    kept, (soft, hard) = with_key(kept, 1), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 40, hard))
    try:
        with pytest.raises(AutosaveError, match="check that there is room"):
            file.save(kept)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert log.read_bytes() == before
    file.save(kept)
    file.close()
    assert require_left(tmp_path) == (file.path, as_json(kept))


@pytest.mark.parametrize(("where", "value"), [
    ("format", "poseviewer-pose"),
    ("version", 1),
    ("scene", None),
    ("active_object", "gone"),
    ("active_view", 1),
    ("scene.views.0.photo.file", 5),
    ("scene.views.0.mask", "data:image/png;base64,AAAA"),
    ("scene.objects.0.world_from_model.rotation.0", [1.0, 1.0, 1.0]),
    ("scene.objects.1.id", "1"),
    ("scene.objects.0.start_cameras", [{"fx": 1.0, "fy": 1.0, "cx": 0, "cy": 0}] * 2),
])  # fmt: skip
def test_damaged_sessions_are_left_out_with_a_sentence(tmp_path, caplog, where, value):
    good = saved(tmp_path, session())
    bad = Path(shutil.copy(good, good.with_name(f"session-1-{'ab' * 8}.json")))
    *path, last = (int(key) if key.isdecimal() else key for key in where.split("."))
    edit(bad, lambda data: reduce(getitem, path, data).__setitem__(last, value))
    with pytest.raises(AutosaveError, match=rf"^{bad.name}: .* cannot be used \(.*left out\.$"):
        load_autosave(bad)
    with caplog.at_level(logging.WARNING):
        assert require_left(tmp_path)[0] == good
    assert bad.name in caplog.text


@pytest.mark.parametrize("data", [b"", b"[1]", b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_session_is_left_out(tmp_path: Path, data: bytes) -> None:
    bad = tmp_path / "session-1.json"
    bad.write_bytes(data)
    (tmp_path / "session-2.json").mkdir()
    assert find_abandoned(tmp_path) is None
    with pytest.raises(AutosaveError, match=r"^session-1"):
        load_autosave(bad)


def test_what_cannot_be_written_or_removed_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(AutosaveError, match=r"cannot be written to .*yours to write to\.$"):
        saved(tmp_path / "file", session())
    (tmp_path / "session-1.json").mkdir()
    with pytest.raises(AutosaveError, match=r"cannot be removed from .*by hand\.$"):
        discard(tmp_path / "session-1.json")
