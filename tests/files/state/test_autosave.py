"""Sessions: written and read back, left behind by a killed process, damaged."""

import json
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from poseviewer.errors import AutosaveError
from poseviewer.files.masks import mask_text
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import InViewRecord, ObjectRecord, SceneRecord, ViewRecord
from poseviewer.files.state.autosave import (
    AutosavedSession,
    SessionFile,
    discard,
    files_of_sessions,
    left_behind,
    load_autosave,
)
from poseviewer.geometry.mask import Mask
from tests.several import CAMERA, IDS, STARTS

ODD = os.fsdecode("/photos/Straße 道".encode() + b"\xff\xfe.jpg")
"""A path that is no text."""


def session(**changes: Any) -> AutosavedSession:
    """A session of three objects, with a mask and a photo that is oddly called."""
    mask = mask_text(Mask.of(np.tri(240, 320)))
    view, objects = ViewRecord.of(Path(ODD), CAMERA, "0" * 64, mask=Path(mask)), []
    for number, (name, placed) in enumerate(zip(IDS, STARTS, strict=True), 1):
        model = Path(f"/photos/three/{name}.ply")
        objects.append(ObjectRecord.of(str(number), model, PoseRecord.of(placed.pose), view))
    own = InViewRecord(mask, (1.0, 2.0, 3.0, 4.5), False)
    objects[0] = structs.replace(objects[0], in_views=(own,), locked=True)
    scene = SceneRecord(views=(view,), objects=tuple(objects))
    kept = AutosavedSession(
        saved_at=1.7e9 + 1.0 / 3.0, active_object="1", photo_names=("three.png",), scene=scene
    )
    return structs.replace(kept, **changes)


def saved(folder: Path, session: AutosavedSession) -> Path:
    """The file of a session that was left behind."""
    file = SessionFile(folder)
    file.save(session)
    file.close()
    return file.path


def test_sessions_come_back_to_the_last_digit(tmp_path: Path) -> None:
    whole = session(active_object="2")
    assert load_autosave(saved(tmp_path, whole)) == whole
    assert (whole.photo_name, whole.model_name) == ("three.png", "front.ply")
    models = {Path(f"/photos/three/{name}.ply") for name in ("ball", "front", "apart")}
    assert files_of_sessions(tmp_path) == {Path(ODD), *models}


CHILD = """
import sys
from pathlib import Path
from poseviewer.files.state.autosave import SessionFile, load_autosave
file = SessionFile(Path(sys.argv[1]))
file.save(load_autosave(Path(sys.argv[2])))
print(file.path, flush=True)
sys.stdin.read()
"""


def test_a_killed_process_leaves_its_session_behind(tmp_path: Path) -> None:
    like = saved(tmp_path / "other", session())
    folder = tmp_path / "sessions"
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, str(folder), str(like)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as child:
        assert child.stdout is not None
        path = Path(child.stdout.readline().strip())
        assert path.is_file()
        assert left_behind(folder) is None
        child.kill()
        child.wait(60)
    assert left_behind(folder) == (path, session())
    discard(path)
    discard(path)
    assert list(folder.iterdir()) == []
    assert left_behind(folder) is left_behind(tmp_path / "nothing") is None


def test_the_newest_is_the_one_left_behind(tmp_path: Path) -> None:
    paths = [
        saved(tmp_path, structs.replace(session(), saved_at=1.7e9 - age)) for age in (2.0, 1.0, 3.0)
    ]
    assert (left_behind(tmp_path) or (None,))[0] == paths[1]
    os.utime(paths[1], (0.0, 0.0))
    assert (left_behind(tmp_path) or (None,))[0] == paths[0]
    assert not paths[1].exists()


def test_a_session_is_saved_though_its_folder_was_removed(tmp_path: Path) -> None:
    file = SessionFile(tmp_path)
    file.save(session())
    shutil.rmtree(tmp_path)
    file.save(session(active_object="1"))
    assert left_behind(tmp_path) is None
    file.close()
    assert left_behind(tmp_path) == (file.path, session(active_object="1"))


def _changed(data: dict[str, Any], where: str, value: Any) -> str:
    *path, last = where.split(".")
    place: Any = data
    for key in path:
        place = place[int(key) if key.isdecimal() else key]
    place[int(last) if last.isdecimal() else last] = value
    return json.dumps(data)


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("format", "poseviewer-pose"),
        ("version", 1),
        ("scene", None),
        ("active_object", "gone"),
        ("active_view", 1),
        ("scene.views.0.photo.file", 5),
        ("scene.views.0.mask", "data:image/png;base64,AAAA"),
        ("scene.objects.0.world_from_model.rotation.0", [1.0, 1.0, 1.0]),
        ("scene.objects.1.id", "1"),
    ],
)
def test_damaged_sessions_are_left_out_with_a_sentence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, where: str, value: Any
) -> None:
    good = saved(tmp_path, session())
    bad = good.with_name(f"session-1-{'ab' * 8}.json")
    bad.write_text(_changed(json.loads(good.read_text()), where, value))
    with pytest.raises(AutosaveError, match=rf"^{bad.name}: .* cannot be used \(.*left out\.$"):
        load_autosave(bad)
    with caplog.at_level(logging.WARNING):
        assert (left_behind(tmp_path) or (None,))[0] == good
    assert bad.name in caplog.text


@pytest.mark.parametrize("data", [b"", b"[1]", b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_session_is_left_out(tmp_path: Path, data: bytes) -> None:
    bad = tmp_path / "session-1.json"
    bad.write_bytes(data)
    (tmp_path / "session-2.json").mkdir()
    assert left_behind(tmp_path) is None
    with pytest.raises(AutosaveError, match=r"^session-1"):
        load_autosave(bad)


def test_what_cannot_be_written_or_removed_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(AutosaveError, match=r"cannot be written to .*yours to write to\.$"):
        saved(tmp_path / "file", session())
    (tmp_path / "session-1.json").mkdir()
    with pytest.raises(AutosaveError, match=r"cannot be removed from .*by hand\.$"):
        discard(tmp_path / "session-1.json")
