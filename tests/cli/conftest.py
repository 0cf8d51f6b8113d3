"""A folder with inputs of every kind, in which commands are run."""

import shutil
from pathlib import Path

import pytest

from poseviewer.files.pose import save_pose
from tests.files.formats.cases import perspective_record, write_files
from tests.scene import make_scene
from tests.several import make_three
from tests.view_sets import write_views


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of ``make_scene`` and ``make_three``, ``set/``, and ``named.json`` of others beside."""
    folder = tmp_path_factory.mktemp("inputs")
    make_scene(folder)
    make_three(folder)
    (folder / "set").mkdir()
    write_views(folder / "set")
    write_files(folder)
    save_pose(folder / "named.json", perspective_record())
    (folder / "jobs.csv").write_text("photo,model,start\np.png,m.ply,start.json\n")
    (folder / "bad.scene.json").write_text('{"format": "poseviewer-scene"}')
    return folder


@pytest.fixture
def folder(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the inputs, as the working folder."""
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
