"""Sets and scenes of many photos, which are read one at a time."""

from pathlib import Path

import numpy as np
import pytest

from poseviewer.errors import PoseViewerError
from poseviewer.files import scene_assets
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.scene_json import load_scene, save_scene
from poseviewer.geometry.lens import Lens
from poseviewer.opening.photo_sets import SetChoice, load_views
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.types import MANY_VIEWS
from tests.many_views import CAMERA, COUNT, NAMES, write_many, write_two_in_many


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the photos whose pixels were read."""
    names = list[str]()

    def load(path: Path) -> object:
        names.append(Path(path).name)
        return load_photo(path)

    monkeypatch.setattr(scene_assets, "load_photo", load)
    return names


def test_photos_of_many_views_are_read_when_they_are_asked_for(tmp_path: Path, read: list[str]):
    loaded = load_views(write_many(tmp_path))
    assert (len(loaded.views), read) == (COUNT, [])
    view = loaded.views[3]
    assert (view.file.width, view.file.height) == (CAMERA.width, CAMERA.height)
    photo = view.photo
    assert (view.photo is photo, photo.camera, photo.sha256) == (True, CAMERA, view.file.sha256)
    assert read == [NAMES[3]]
    # A handle at rest is equal to the one that was read, and keeps nothing.
    rest = view.file.at_rest
    assert rest == view.file
    assert "photo" not in vars(rest)
    assert rest.photo is not photo
    # Of few, all are read at once.
    read.clear()
    few = load_views(tmp_path / "set.json", SetChoice(photos=NAMES[:MANY_VIEWS]))
    assert len(few.views) == MANY_VIEWS
    assert read == [*NAMES[:MANY_VIEWS]]


def test_a_scene_of_many_views_opens_and_is_saved_without_reading_them(tmp_path, read: list[str]):
    scene = open_scene(Sources(scene=write_two_in_many(tmp_path)))
    assert read == []
    assert all(view.file.sha256 for view in scene.views)
    save_scene(tmp_path / "again.json", scene)
    assert read == []
    again = load_scene(tmp_path / "again.json")
    assert [view.file.sha256 for view in again.views] == [v.file.sha256 for v in scene.views]
    (tmp_path / NAMES[5]).write_bytes((tmp_path / NAMES[6]).read_bytes())
    notes = open_scene(Sources(scene=tmp_path / "again.json")).notes
    assert any(NAMES[5] in note and "fingerprints differ" in note for note in notes)


def test_a_lens_is_undone_where_a_photo_is_read(tmp_path: Path):
    lens = Lens("opencv", (-0.1, 0.02, 0.0, 0.0))
    view = load_views(write_many(tmp_path, lens=lens)).views[0]
    assert view.file.undistortion is not None
    assert view.photo.undistortion == view.file.undistortion
    assert not np.array_equal(view.photo.pixels, load_photo(tmp_path / NAMES[0]).pixels)


@pytest.mark.parametrize("trouble", ["gone", "twice", "size"])
def test_what_is_wrong_with_one_of_many_is_said_at_once(tmp_path: Path, trouble: str):
    path, last = write_many(tmp_path), tmp_path / NAMES[-1]
    if trouble == "gone":
        last.unlink()
    elif trouble == "twice":
        last.write_bytes((tmp_path / NAMES[0]).read_bytes())
    else:
        save_image(last, np.zeros((60, 80, 3), np.uint8))
    said = {"gone": "no such file", "twice": "one photo twice", "size": "80x60 px"}[trouble]
    with pytest.raises(PoseViewerError, match=f"{NAMES[-1]}.*{said}"):
        load_views(path)
