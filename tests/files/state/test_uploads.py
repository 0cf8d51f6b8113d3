from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseviewer.errors import MeshFileError, PhotoFileError, PoseFileError, PoseViewerError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.state.uploads import (
    ENDINGS,
    LARGEST_UPLOAD,
    Kind,
    display_name,
    keep_upload,
    why_unfit,
)

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
ODD_NAMES = (
    "../../x.obj",
    "/etc/x.obj",
    "a\0.obj",
    "C:\\x.obj",
    "C:\\..\\..\\x.OBJ",
    "x" * 5000 + ".obj",
    "модель 車 🚗.obj",
    "con.obj",
    ".obj",
    "a.png.obj",
    "a\n\r\x1b[31m.obj",
    "\u202ejbo.\udc80.obj",
    "<script>alert(1)</script>.obj",
)


@pytest.mark.parametrize("name", ODD_NAMES)
def test_an_uploaded_name_never_becomes_a_path(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "a" / "uploads"
    path = keep_upload(folder, name, TRIANGLE, "model")
    assert path.parent.parent == folder
    assert path.name == "model.obj"
    assert path.read_bytes() == TRIANGLE
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [path]
    assert len(load_mesh(path).faces) == 1


@pytest.mark.parametrize("kind", ["photo", "model", "pose"])
def test_every_ending_keeps_its_kind(tmp_path: Path, kind: Kind) -> None:
    for ending in ENDINGS[kind]:
        path = keep_upload(tmp_path, f"thing{ending.upper()}", b"some bytes", kind)
        assert path.name == f"{kind}{ending}"


def test_the_same_bytes_go_to_the_same_place(tmp_path: Path) -> None:
    first = keep_upload(tmp_path, "a.obj", TRIANGLE, "model")
    assert keep_upload(tmp_path, "b.obj", TRIANGLE, "model") == first
    assert keep_upload(tmp_path, "b.obj", TRIANGLE + b"\n", "model") != first
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("name", "data", "kind", "error", "text"),
    [
        ("car.obj", b"", "model", MeshFileError, "car.obj: an empty file; wanted a model"),
        ("car.obj", b"12345678901", "model", MeshFileError, "car.obj: 11 bytes; up to 10 can be"),
        ("car.exe", b"1", "model", MeshFileError, "ends in .obj, .ply, .stl, .off, .glb, .gltf"),
        ("car", b"1", "model", MeshFileError, "car: not the name of a model file"),
        ("", b"1", "model", MeshFileError, "unnamed: not the name of a model file"),
        ("car.obj/", b"1", "model", MeshFileError, "unnamed: not the name"),
        ("car.png\0", b"1", "photo", PhotoFileError, "car.png: not the name of a photo file"),
        ("car.obj", b"1", "photo", PhotoFileError, "ends in .jpg, .jpeg, .png"),
        ("pose.txt", b"1", "pose", PoseFileError, "ends in .json."),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(
    tmp_path: Path, name: str, data: bytes, kind, error: type[PoseViewerError], text: str
) -> None:
    with pytest.raises(error) as caught:
        keep_upload(tmp_path, name, data, kind, largest_bytes=10)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_what_is_unfit_is_said_before_it_is_sent() -> None:
    assert why_unfit("a/b.ply", LARGEST_UPLOAD + 1).startswith("b.ply: 200,000,001 bytes; up to")
    assert why_unfit("notes.txt", 5).startswith("notes.txt: not the name of a photo, a model or")
    for ending in (".jpg", ".glb", ".json"):
        assert ending in why_unfit("notes.txt", 5)


def test_the_largest_size_itself_is_kept(tmp_path: Path) -> None:
    assert keep_upload(tmp_path, "a.json", b"{}" * 5, "pose", largest_bytes=10).exists()


def test_only_the_newest_uploads_stay(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    paths = []
    for i in range(6):
        paths.append(keep_upload(tmp_path, "a.json", b"%d" % i, "pose", kept=3))
        # Clocks of file systems are coarse: age what is there by hand.
        os.utime(paths[-1].parent, ns=(i * 10**9, i * 10**9))
    again = keep_upload(tmp_path, "a.json", b"3", "pose", kept=3)
    assert [path.exists() for path in paths] == [False, False, False, True, True, True]
    assert again == paths[3]
    keep_upload(tmp_path, "a.json", b"new", "pose", kept=2)
    assert [path.exists() for path in paths] == [False, False, False, True, False, False]
    assert (tmp_path / "notes").is_dir()


def test_uploads_in_use_stay(tmp_path: Path) -> None:
    used = keep_upload(tmp_path, "a.json", b"used", "pose")
    os.utime(used.parent, ns=(0, 0))
    other = keep_upload(tmp_path, "a.json", b"other", "pose")
    os.utime(other.parent, ns=(1, 1))
    new = keep_upload(tmp_path, "a.json", b"new", "pose", kept=0, in_use=[used])
    assert [path.exists() for path in (used, other, new)] == [True, False, True]


def test_a_folder_that_cannot_be_made_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "uploads").write_text("a file is in the way")
    with pytest.raises(PoseFileError, match=r"^a\.json: cannot be kept in .*yours to write to"):
        keep_upload(tmp_path / "uploads", "a.json", b"{}", "pose")


@given(st.text(st.characters(), max_size=300))
def test_names_to_show_are_short_and_plain(name: str) -> None:
    shown = display_name(name)
    assert 1 <= len(shown) <= 80
    assert shown.isprintable()
    assert not set(shown) & set("/\\")
    assert display_name(shown) == shown


def test_names_to_show_keep_what_a_user_knows() -> None:
    assert display_name("C:\\my files\\car 1.obj") == "car 1.obj"
    assert display_name("../модель 車.obj") == "модель 車.obj"
    assert display_name("x" * 500 + ".obj").endswith("xxx.obj")
