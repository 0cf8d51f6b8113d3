import os
import stat
import sys

import platformdirs
import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.state.folder import state_folder


def test_it_is_made_and_closed_to_others_or_a_sentence_says_why_not(tmp_path, monkeypatch):
    wanted = tmp_path / "a" / "b"
    monkeypatch.setenv("POSEVIEWER_STATE", str(wanted))
    assert state_folder() == wanted
    assert state_folder() == wanted
    if sys.platform != "win32":
        assert stat.S_IMODE(wanted.stat().st_mode) == 0o700
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path / "file" / "state"))
    with pytest.raises(SettingsError, match=r"cannot be made .* set POSEVIEWER_STATE to another"):
        state_folder()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="XDG folders are Linux's")
def test_without_the_variable_it_is_the_users_own(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEVIEWER_STATE", "")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / "state" / "poseviewer"
    assert state_folder() == platformdirs.user_state_path("poseviewer")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs a second user")
def test_another_users_folder_is_refused(tmp_path, monkeypatch):
    os.chown(tmp_path, 65534, 65534)
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path))
    with pytest.raises(SettingsError, match="belongs to another user"):
        state_folder()
