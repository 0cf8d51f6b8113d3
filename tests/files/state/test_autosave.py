from __future__ import annotations

import dataclasses
import json
import logging
import os
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
    discard,
    left_behind,
    load_autosave,
    process_start,
    save_autosave,
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
        model_sha256=SHA[::-1],
        pose=record(),
        start=record(turn=0.4),
        settings={"restarts": 8, "loss": "invariant", "limits": [0.1, 0.2], "mask": None},
        unsaved=True,
        saved_at=1.7e9 + 1.0 / 3.0,
        process=os.getpid(),
    )
    return dataclasses.replace(whole, **changes)


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
    assert_same(load_autosave(save_autosave(tmp_path / "new", whole)), whole)
    empty = session(
        photo=None, photo_sha256=None, model=None, model_sha256=None, settings={}, unsaved=False
    )
    assert_same(load_autosave(save_autosave(tmp_path, empty)), empty)


def test_all_objects_of_a_session_come_back_to_the_last_digit(tmp_path: Path) -> None:
    others = (
        session(number=1, name="Straße", pose=record(turn=1.3)),
        session(number=7, hidden=True, locked=True),
    )
    whole = session(number=4, others=others)
    back = load_autosave(save_autosave(tmp_path, whole))
    assert len(back.others) == 2
    for one, other in zip(back.others, others, strict=True):
        assert_same(one, other)
    assert_same(dataclasses.replace(back, others=others), whole)


def test_sessions_of_earlier_versions_have_one_object_and_no_candidates(tmp_path: Path) -> None:
    path = save_autosave(tmp_path, session())
    content = json.loads(path.read_text())
    for name in ("number", "name", "hidden", "locked", "others"):
        del content[name]
    path.write_text(json.dumps(content))
    back = load_autosave(path)
    assert (back.candidates, back.number, back.others) == ((), 1, ())
    assert (back.name, back.hidden, back.locked) == ("", False, False)


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
    saved = session(pose=pose)
    assert_same(load_autosave(save_autosave(folder, saved)), saved)


def test_paths_that_are_no_text_come_back(tmp_path: Path) -> None:
    odd = session(photo=Path(os.fsdecode(b"/photos/\xff\xfe.jpg")), photo_name="a? .jpg")
    assert_same(load_autosave(save_autosave(tmp_path, odd)), odd)


def test_one_file_for_each_process(tmp_path: Path) -> None:
    first = save_autosave(tmp_path, session())
    assert save_autosave(tmp_path, session(unsaved=False)) == first
    assert list(tmp_path.iterdir()) == [first]
    assert not load_autosave(first).unsaved


CHILD = """
import os, sys
from dataclasses import replace
from pathlib import Path
from poseviewer.files.state.autosave import load_autosave, save_autosave
like = load_autosave(Path(sys.argv[2]))
print(save_autosave(Path(sys.argv[1]), replace(like, process=os.getpid())), flush=True)
sys.stdin.read()
"""


def test_a_killed_process_leaves_its_session_behind(tmp_path: Path) -> None:
    like = save_autosave(tmp_path / "other", session())
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
        assert left_behind(folder) == []
        child.kill()
        child.wait(60)
        assert left_behind(folder) == [path]
    assert_same(load_autosave(path), session(process=child.pid))
    discard(path)
    discard(path)
    assert left_behind(folder) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_a_process_that_nobody_has_collected_yet_has_ended() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        assert process_start(child.pid) == process_start(child.pid) is not None
        child.kill()
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
        assert process_start(child.pid) is None
    assert process_start(-1) is process_start(0) is None


def test_a_number_that_was_given_again_is_not_taken_for_alive(tmp_path: Path) -> None:
    """This process lives, but started at another time than the file's mark says."""
    path = save_autosave(tmp_path, session())
    assert left_behind(tmp_path) == []
    earlier = path.with_name(f"session-{os.getpid()}-{'ab' * 8}.json")
    path.rename(earlier)
    assert left_behind(tmp_path) == [earlier]
    assert save_autosave(tmp_path, session()) == path
    assert left_behind(tmp_path) == [earlier]


def dead_process() -> int:
    with subprocess.Popen([sys.executable, "-c", ""]) as child:
        pass
    return child.pid


def test_the_newest_comes_first(tmp_path: Path) -> None:
    parameters = []
    for age in (2.0, 3.0, 1.0):
        process = dead_process()
        parameters.append(process)
        save_autosave(tmp_path, session(process=process, saved_at=1.7e9 - age))
    found = [load_autosave(path).process for path in left_behind(tmp_path)]
    assert found == [parameters[2], parameters[0], parameters[1]]


def test_no_folder_no_sessions(tmp_path: Path) -> None:
    assert left_behind(tmp_path / "nothing") == []


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
        ("version", 2),
        ("photo", 5),
        ("unsaved", "yes"),
        ("settings", [1]),
        ("saved_at", None),
        ("process", "1"),
        ("pose", None),
        ("start.file", {}),
        ("pose.exact", None),
        ("pose.exact.width", 0),
        ("pose.exact.cx", float("nan")),
        ("pose.exact.cx", 301.5),
        ("pose.exact.rotation", [[1, 0, 0], [0, 1, 0]]),
        ("pose.exact.rotation", [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ("pose.file.camera.cx", None),
    ],
)
def test_damaged_sessions_are_left_out_with_a_sentence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, where: str, value: Any
) -> None:
    good = save_autosave(tmp_path, session(process=dead_process()))
    bad = good.with_name(f"session-1-{'ab' * 8}.json")
    bad.write_text(_changed(json.loads(good.read_text()), where, value))
    with pytest.raises(AutosaveError, match=rf"^{bad.name}: .* cannot be used \(.*left out\.$"):
        load_autosave(bad)
    with caplog.at_level(logging.WARNING):
        assert left_behind(tmp_path) == [good]
    assert bad.name in caplog.text


@pytest.mark.parametrize("data", [b"", b"{", b"[1]", bytes(1000), b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_session_is_left_out(tmp_path: Path, data: bytes) -> None:
    bad = tmp_path / f"session-1-{'ab' * 8}.json"
    bad.write_bytes(data)
    (tmp_path / "session-notes.json").write_bytes(data)
    (tmp_path / f"session-2-{'ab' * 8}.json").mkdir()
    assert left_behind(tmp_path) == []
    with pytest.raises(AutosaveError, match=r"^session-1-"):
        load_autosave(bad)


def test_what_json_cannot_hold_is_not_kept(tmp_path: Path) -> None:
    for settings in ({"x": float("nan")}, {"x": np.zeros(3)}):
        with pytest.raises(AutosaveError, match="holds what JSON cannot"):
            save_autosave(tmp_path, session(settings=settings))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_to_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(AutosaveError, match=r"cannot be written to .*yours to write to\.$"):
        save_autosave(tmp_path / "file", session())


@pytest.mark.skipif(sys.platform == "win32", reason="folders have no such mode")
def test_a_read_only_folder_gives_a_sentence(tmp_path: Path) -> None:
    path = save_autosave(tmp_path, session())
    tmp_path.chmod(0o500)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)  # root may write everywhere
    try:
        with pytest.raises(AutosaveError, match=r"cannot be written to .*yours to write to\.$"):
            save_autosave(tmp_path, session())
        with pytest.raises(AutosaveError, match=r"cannot be removed from .*by hand\.$"):
            discard(path)
    finally:
        if root:
            os.seteuid(0)
        tmp_path.chmod(0o700)
    assert path.is_file()
