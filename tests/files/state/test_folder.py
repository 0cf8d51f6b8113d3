import os
import stat
import sys
from pathlib import Path

import platformdirs
import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.state.folder import (
    KEPT,
    TOKEN,
    forget_token,
    kept_token,
    new_token,
    state_folder,
)


def test_it_is_made_and_closed_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = tmp_path / "a" / "b"
    monkeypatch.setenv("POSEVIEWER_STATE", str(wanted))
    assert state_folder() == wanted
    assert state_folder() == wanted
    if sys.platform != "win32":
        assert stat.S_IMODE(wanted.stat().st_mode) == 0o700


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="XDG folders are Linux's")
def test_without_the_variable_it_is_the_users_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("POSEVIEWER_STATE", "")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / "state" / "poseviewer"
    assert state_folder() == platformdirs.user_state_path("poseviewer")


def test_a_file_in_the_way_gives_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path / "file" / "state"))
    with pytest.raises(SettingsError, match=r"cannot be made .* set POSEVIEWER_STATE to another"):
        state_folder()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs a second user")
def test_another_users_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.chown(tmp_path, 65534, 65534)
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path))
    with pytest.raises(SettingsError, match="belongs to another user"):
        state_folder()


ADDRESS = ("0.0.0.0", 8080)


def test_a_token_is_kept_for_its_address_alone(tmp_path: Path) -> None:
    token = kept_token(tmp_path, *ADDRESS)
    assert TOKEN.fullmatch(token)
    assert kept_token(tmp_path, *ADDRESS) == token
    others = {kept_token(tmp_path, *other) for other in (("0.0.0.0", 8081), ("::", 8080))}
    assert len(others | {token, new_token()}) == 4
    forget_token(tmp_path, *ADDRESS)
    forget_token(tmp_path, *ADDRESS)  # gone already
    assert kept_token(tmp_path, *ADDRESS) not in {token, *others}


def test_a_host_never_becomes_a_path(tmp_path: Path) -> None:
    kept_token(tmp_path / "state", "../../../elsewhere", 8080)
    assert [path.name for path in tmp_path.iterdir()] == ["state"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_a_token_that_others_could_read_is_replaced(tmp_path: Path) -> None:
    token = kept_token(tmp_path, *ADDRESS)
    (file,) = (tmp_path / "tokens").iterdir()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    file.chmod(0o644)
    fresh = kept_token(tmp_path, *ADDRESS)
    assert fresh != token
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert kept_token(tmp_path, *ADDRESS) == fresh


@pytest.mark.parametrize("text", ["", "short", "a" * 31 + "\n", "a" * 31 + ";", "ä" * 32])
def test_what_is_no_token_is_replaced(tmp_path: Path, text: str) -> None:
    kept_token(tmp_path, *ADDRESS)
    (file,) = (tmp_path / "tokens").iterdir()
    file.write_text(text, encoding="utf-8")
    token = kept_token(tmp_path, *ADDRESS)
    assert TOKEN.fullmatch(token)
    assert file.read_text(encoding="ascii") == token


def test_only_the_newest_stay(tmp_path: Path) -> None:
    for port in range(1, KEPT + 4):
        kept_token(tmp_path, "0.0.0.0", port)
        for age, file in enumerate(sorted((tmp_path / "tokens").iterdir(), key=_port)):
            os.utime(file, (1e9 + age, 1e9 + age))
    left = sorted(_port(file) for file in (tmp_path / "tokens").iterdir())
    assert left == list(range(4, KEPT + 4))


def test_a_state_folder_that_cannot_be_written_still_gives_a_token(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "tokens").write_text("a file in the way")
    assert TOKEN.fullmatch(kept_token(tmp_path, *ADDRESS))
    assert "the address's token is not kept" in caplog.text


def _port(file: Path) -> int:
    return int(file.name.rpartition("-")[2])
