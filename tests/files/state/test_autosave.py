from __future__ import annotations

import dataclasses
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
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poseviewer.errors import AutosaveError
from poseviewer.files.pose import ChartParameters, ModelReference, PhotoReference, PoseRecord
from poseviewer.files.state.autosave import (
    AutosavedSession,
    SessionFile,
    discard,
    left_behind,
    load_autosave,
)
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform

PARALLEL = Parallel(123.45678901234567, 300.1, 200.2, 640, 480)
SHA = "0123456789abcdef" * 4


def record(camera: Camera = PARALLEL, turn: float = 0.3) -> PoseRecord:
    transform = RigidTransform.from_rotation_vector([turn, -1.1, 2.0], [0.1, -2.5, 1.0 / 3.0])
    return PoseRecord(
        Pose(camera, transform),
        PhotoReference("Straße 道.jpg", 640, 480, SHA),
        ModelReference("car.glb", SHA[::-1], "m"),
        ChartParameters("vehicle", ("x", "y"), (1.0 / 7.0, -2e-17)),
        0.1 + 0.2,
        {"restarts": 8},
    )


def session(**changes: Any) -> AutosavedSession:
    whole = AutosavedSession(
        photo=Path("/photos/Straße 道.jpg"),
        photo_name="Straße 道.jpg",
        photo_sha256=SHA,
        model=Path("car.glb"),
        model_name="car.glb",
        pose=record(),
        start=record(turn=0.4),
        settings={"restarts": 8, "loss": "invariant", "limits": [0.1, 0.2], "mask": None},
        saved_at=1.7e9 + 1.0 / 3.0,
    )
    return dataclasses.replace(whole, **changes)


def saved(folder: Path, session: AutosavedSession) -> Path:
    """The file of a session that was left behind."""
    file = SessionFile(folder)
    file.save(session)
    file.close()
    return file.path


def parameters(record: PoseRecord) -> bytes:
    """All numbers of a pose, bit by bit."""
    camera, transform = record.pose.camera, record.pose.camera_from_model
    values = [*dataclasses.astuple(camera), *transform.rotation.ravel(), *transform.translation]
    return np.array(values, dtype=np.float64).tobytes()


def assert_same(a: AutosavedSession, b: AutosavedSession) -> None:
    for which in ("pose", "start"):
        x, y = getattr(a, which), getattr(b, which)
        assert type(x.pose.camera) is type(y.pose.camera)
        assert parameters(x) == parameters(y)
        assert dataclasses.replace(x, pose=y.pose) == y
    assert dataclasses.replace(a, pose=b.pose, start=b.start) == b


def test_sessions_come_back_to_the_last_digit(tmp_path: Path) -> None:
    whole = session()
    assert_same(load_autosave(saved(tmp_path / "new", whole)), whole)
    empty = session(photo=None, photo_sha256=None, model=None, settings={})
    assert_same(load_autosave(saved(tmp_path, empty)), empty)


def test_all_objects_of_a_session_come_back_to_the_last_digit(tmp_path: Path) -> None:
    others = (
        session(number=1, name="Straße", pose=record(turn=1.3)),
        session(number=7, hidden=True, locked=True),
    )
    whole = session(number=4, others=others)
    back = load_autosave(saved(tmp_path, whole))
    assert len(back.others) == 2
    for one, other in zip(back.others, others, strict=True):
        assert_same(one, other)
    assert_same(dataclasses.replace(back, others=others), whole)


finite = st.floats(-1e6, 1e6)
positive = st.floats(1e-3, 1e6)
cameras = st.builds(
    Perspective, positive, positive, finite, finite, st.integers(1, 20000), st.integers(1, 20000)
) | st.builds(Parallel, positive, finite, finite, st.integers(1, 20000), st.integers(1, 20000))
angles = st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3)


@given(cameras, angles, st.lists(finite, min_size=3, max_size=3), st.floats(-1e-8, 1e-8))
def test_any_pose_comes_back_to_the_last_digit(
    tmp_path_factory: pytest.TempPathFactory,
    camera: Camera,
    turn: list[float],
    place: list[float],
    slack: float,
) -> None:
    """Also a rotation that rounding has worn, which a pose file would mend."""
    worn = Rotation.from_rotvec(turn).as_matrix() * (1.0 + slack)
    pose = PoseRecord(Pose(camera, RigidTransform(worn, np.array(place))))
    folder = tmp_path_factory.getbasetemp()
    worn_session = session(pose=pose)
    assert_same(load_autosave(saved(folder, worn_session)), worn_session)


def test_paths_that_are_no_text_come_back(tmp_path: Path) -> None:
    odd = session(photo=Path(os.fsdecode(b"/photos/\xff\xfe.jpg")), photo_name="a? .jpg")
    assert_same(load_autosave(saved(tmp_path, odd)), odd)


def test_a_session_stays_with_its_app_until_that_ends(tmp_path: Path) -> None:
    file = SessionFile(tmp_path)
    file.save(session())
    shutil.rmtree(tmp_path)
    file.save(session(name="again"))
    assert left_behind(tmp_path) is None
    assert list(tmp_path.glob("*.json")) == [file.path]
    file.close()
    assert list(tmp_path.iterdir()) == [file.path]
    found = left_behind(tmp_path)
    assert found is not None
    assert found[0] == file.path
    assert found[1].name == "again"


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
    found = left_behind(folder)
    assert found is not None
    assert found[0] == path
    assert_same(found[1], session())
    discard(path)
    discard(path)
    assert list(folder.iterdir()) == []
    assert left_behind(folder) is left_behind(tmp_path / "nothing") is None


def test_the_newest_is_the_one_left_behind(tmp_path: Path) -> None:
    paths = [saved(tmp_path, session(saved_at=1.7e9 - age)) for age in (2.0, 1.0, 3.0)]
    found = left_behind(tmp_path)
    assert found is not None
    assert found[0] == paths[1]


def _changed(data: dict[str, Any], where: str, value: Any) -> str:
    *path, last = where.split(".")
    place = data
    for key in path:
        place = place[key]
    place[last] = value
    return json.dumps(data)


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("format", "poseviewer-pose"),
        ("photo", 5),
        ("hidden", "yes"),
        ("saved_at", None),
        ("start.file", {}),
        ("pose.exact.width", 0),
        ("pose.exact.cx", float("nan")),
        ("pose.exact.cx", 301.5),
        ("pose.file.camera.cx", None),
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
        found = left_behind(tmp_path)
    assert found is not None
    assert found[0] == good
    assert bad.name in caplog.text


@pytest.mark.parametrize("data", [b"", b"{", b"[1]", bytes(1000), b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_session_is_left_out(tmp_path: Path, data: bytes) -> None:
    bad = tmp_path / "session-1.json"
    bad.write_bytes(data)
    (tmp_path / "session-2.json").mkdir()
    assert left_behind(tmp_path) is None
    with pytest.raises(AutosaveError, match=r"^session-1"):
        load_autosave(bad)


def test_a_folder_that_cannot_be_written_to_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(AutosaveError, match=r"cannot be written to .*yours to write to\.$"):
        saved(tmp_path / "file", session())


def test_a_session_that_cannot_be_removed_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "session-1.json").mkdir()
    with pytest.raises(AutosaveError, match=r"cannot be removed from .*by hand\.$"):
        discard(tmp_path / "session-1.json")
