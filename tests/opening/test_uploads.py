"""Uploads are kept on disk under their own names, and never outside."""

import os
import stat
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseviewer.errors import FileSetError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.scene_assets import model_file, view_of_file
from poseviewer.files.writing import safe_path
from poseviewer.opening import uploads as u
from poseviewer.opening.sources import MAX_FILES, files_below
from poseviewer.opening.uploads import (
    copy_out,
    display_name,
    keep_set,
    keep_zip,
    pack,
)
from tests.files.state.test_session_file import saved, session

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
ODD_NAMES = (
    *("../../x.obj", "/etc/x.obj", "a\0.obj", "C:\\..\\..\\x.OBJ", "x" * 5000 + ".obj", "con.obj"),
    *("модель 車 🚗.obj", "a\n\r\x1b[31m.obj", "\u202ejbo.\udc80.obj", "..", ""),
)


def zipped(files: Mapping[str, bytes]) -> bytes:
    held = BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return held.getvalue()


def keep(folder: Path, files: Mapping[str, bytes]) -> Path:
    return keep_set(folder, pack(files.items()))


def test_a_picture_of_another_name_is_taken_for_the_one_that_is_missing() -> None:
    missing = ["Oak.png", "elm.png"]
    for names, kept in (
        (["photo 1.png"], ["Oak.png"]),
        (["ELM.png"], ["ELM.png"]),
        (["a.png", "b.png"], ["a.png", "b.png"]),
    ):
        sent = pack((name, b"x") for name in names)
        assert u.call_missing(sent, missing) == pack((name, b"x") for name in kept)
    assert u.call_missing(pack([("a.png", b"x")]), []) == pack([("a.png", b"x")])


def below(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


@pytest.mark.parametrize("name", ODD_NAMES)
def test_a_name_never_leads_out(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "a" / "uploads"
    place = keep(folder, {name: TRIANGLE})
    assert place.parent == folder
    (path,) = (p for p in tmp_path.rglob("*") if p.is_file())
    assert place in path.parents
    assert path.read_bytes() == TRIANGLE
    if path.suffix:
        assert len(load_mesh(path).faces) == 1


@given(st.text(st.characters(), max_size=300))
def test_paths_of_any_text_stay_inside_and_can_be_shown(name: str) -> None:
    parts, shown = safe_path(name).parts, display_name(name)
    assert parts
    for part in parts:
        assert part.isprintable()
        assert part.strip(". ")
        assert len(part.encode()) <= 4 * 100 + 1
        assert not set(part) & set('/\\<>:"|?*')
    assert 1 <= len(shown) <= 80
    assert shown.isprintable()
    assert not set(shown) & set("/\\")


def test_names_and_folders_are_kept_as_they_are_and_files_of_one_name_too(tmp_path: Path) -> None:
    files = {"car/модель 車.obj": b"1", "car/maps/wood 1.png": b"2", "photo.jpg": b""}
    place = keep_set(tmp_path, pack([*files.items(), ("photo.jpg", b"other")]))
    assert {name: (place / name).read_bytes() for name in files} == files
    (other,) = set(below(place)) - set(files)
    assert (place / other).read_bytes() == b"other"


def test_the_same_bytes_go_to_the_same_place(tmp_path: Path) -> None:
    first = keep(tmp_path, {"a.obj": TRIANGLE})
    assert keep(tmp_path, {"a.obj": TRIANGLE}) == first
    assert keep(tmp_path, {"a.obj": TRIANGLE + b"\n"}) != first
    assert keep(tmp_path, {"b.obj": TRIANGLE}) != first


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"[]\n", b'[["a", -1]]\n', b"[" * 9000])
def test_what_no_page_of_ours_sends_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(FileSetError, match="no set of files; reload the page"):
        keep_set(tmp_path, data)
    cut_off = pack([("car.obj", TRIANGLE), ("wood.png", 1000 * b"x")])[:-1]
    with pytest.raises(FileSetError, match=r"^car\.obj: .*it was cut off, drop it again"):
        keep_set(tmp_path, cut_off)
    assert list(tmp_path.iterdir()) == []


def test_a_zip_is_unpacked_beside_the_others(tmp_path: Path) -> None:
    inside = {"car/a.obj": TRIANGLE, "car/maps/wood.png": b"2", "__MACOSX/car/._a.obj": b"3"}
    place = keep(tmp_path, {"My Car.ZIP": zipped(inside), "photo.jpg": b"4"})
    assert below(place) == ["My Car/car/a.obj", "My Car/car/maps/wood.png", "photo.jpg"]


def test_nothing_of_a_zip_is_written_outside_or_followed(tmp_path: Path) -> None:
    link, held = zipfile.ZipInfo("wood.png"), BytesIO()
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    names = ("../x.obj", "/etc/y.obj", "C:\\z.obj", "..\\..\\w.obj")
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr(link, "/etc/passwd")
        for name in names:
            archive.writestr(name, TRIANGLE)
    odd = keep(tmp_path / "a" / "uploads", {"odd.zip": held.getvalue()}) / "odd"
    files = [p for p in tmp_path.rglob("*") if p.is_file() or p.is_symlink()]
    assert len(files) == 5
    assert all(odd in path.parents and not path.is_symlink() for path in files)
    assert (odd / "wood.png").read_text() == "/etc/passwd"


def test_a_zip_of_a_file_and_a_folder_of_one_name_is_refused(tmp_path: Path) -> None:
    for names in (["a", "a/b.obj"], ["a/b.obj", "a"], ["a/b", "a/b/c/d.obj"]):
        data = zipped(dict.fromkeys(names, TRIANGLE))
        with pytest.raises(
            FileSetError, match=r"^c\.zip: a.* is a file in it, and a folder; rename"
        ):
            keep(tmp_path, {"c.zip": data})


def test_a_zip_with_a_password_is_refused_in_words(tmp_path: Path) -> None:
    data = bytearray(zipped({"a.obj": TRIANGLE}))
    for start, place in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        data[data.find(start) + place] |= 1
    with pytest.raises(FileSetError, match=r"^b\.zip: has a password; unpack it yourself"):
        keep(tmp_path, {"b.zip": bytes(data)})


def test_a_file_and_a_folder_of_one_name_that_come_together_are_kept(tmp_path: Path) -> None:
    files = {"a": b"1", "a/b.obj": TRIANGLE, "a.zip": zipped({"c.obj": TRIANGLE})}
    assert below(keep(tmp_path, files)) == ["1/a/b.obj", "2/a/c.obj", "a"]


def test_zips_that_unpack_to_too_much_are_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("poseviewer.opening.uploads.MAX_UNPACKED_BYTES", 10_000)
    half = 6000 * b"\0"
    for zips in ({"b.zip": {"a": half, "b": half}}, {"a.zip": {"a": half}, "b.zip": {"a": half}}):
        with pytest.raises(FileSetError, match=r"^b\.zip: unpacks to more than 10,000 bytes or"):
            keep(tmp_path, {name: zipped(files) for name, files in zips.items()})
    monkeypatch.setattr("poseviewer.opening.uploads.MAX_FILES", 5)
    with pytest.raises(FileSetError, match=r"^b\.zip: unpacks to more than .* or 5 files"):
        keep(tmp_path, {"b.zip": zipped({f"{i}": b"" for i in range(6)})})
    assert list(tmp_path.iterdir()) == []


def damaged_zips() -> list[bytes]:
    data = zipped({"a.obj": TRIANGLE, "b.png": np.random.default_rng(0).bytes(3000)})
    says_less = data.replace((3000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    return [b"", data[:10], data[:1500], data[:-1], says_less]


@pytest.mark.parametrize("data", damaged_zips(), ids=range(5))
def test_a_damaged_zip_is_refused_in_one_sentence(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(FileSetError, match=r"^b\.zip: not a readable zip .*Make it again"):
        keep(tmp_path, {"b.zip": data})
    assert list(tmp_path.iterdir()) == []


def test_why_a_page_sends_nothing() -> None:
    assert "b.ply: 200,000,001 bytes; up to" in u.why_unfit("a/b.ply", u.MAX_UPLOAD_BYTES + 1)
    assert "disk: more than 10,000 files; drop" in u.why_unfit("disk", 10**9, MAX_FILES + 1)
    assert u.why_unfit("fine.ply", u.MAX_UPLOAD_BYTES) == ""
    assert u.why_not_sent("new", "empty").startswith("new: an empty folder; drop one that")


def test_only_the_newest_uploads_stay(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("poseviewer.opening.uploads.MIN_UPLOADS", 3)
    (tmp_path / "notes").mkdir()
    paths = []
    for i in range(6):
        paths.append(keep(tmp_path, {"a.json": b"%d" % i}))
        os.utime(paths[-1], ns=(i * 10**9, i * 10**9))
    again = keep(tmp_path, {"a.json": b"3"})
    assert [path.exists() for path in paths] == [False, False, False, True, True, True]
    assert again == paths[3]
    keep(tmp_path, {"a.json": b"new"})
    assert [path.exists() for path in paths] == [False, False, False, True, False, True]
    assert (tmp_path / "notes").is_dir()


def test_of_old_and_broken_uploads_those_that_a_session_names_stay(tmp_path, monkeypatch):
    monkeypatch.setattr("poseviewer.opening.uploads.MIN_UPLOADS", 0)
    uploads = tmp_path / "uploads"
    used, other = (keep(uploads, {"maps/a.png": data}) for data in (b"used", b"other"))
    whole = session()
    view = view_of_file(used / "maps" / "a.png", whole.scene.views[0].camera)
    saved(tmp_path / "sessions", replace(whole, scene=replace(whole.scene, views=(view,))))
    left, under_way = uploads / "new-a", uploads / "new-b"
    for place in (left, under_way):
        (place / "set").mkdir(parents=True)
    for place in (used, other, left):
        os.utime(place, (0, 0))
    (tmp_path / "b.zip").write_bytes(zipped({"a.obj": TRIANGLE}))
    new = keep_zip(uploads, tmp_path / "b.zip")
    there = [path.exists() for path in (used, other, new, left, under_way)]
    assert there == [True, False, True, False, True]
    keep(uploads, {"a.json": b"newer"})
    assert new.exists()


def test_a_model_of_an_upload_is_copied_with_nothing_outside_or_through_a_link(tmp_path):
    private, out = tmp_path / "state", tmp_path / "here" / "out"
    out.mkdir(parents=True)
    (private / "token.mtl").parent.mkdir()
    (private / "token.mtl").write_text("newmtl red\n")
    names = "../../token.mtl", "maps/b.mtl"
    files = {"a.obj": "".join(f"mtllib {name}\n" for name in names).encode() + TRIANGLE}
    place = keep(private / "uploads", files | {"maps/b.mtl": b"newmtl b\n"})
    whole = session()
    item = replace(whole.scene.objects[0], model=model_file(place / "a.obj"))
    scene = replace(whole.scene, objects=(item,))
    (out / "a.obj").symlink_to(tmp_path / "mine")  # where nothing is yet
    with pytest.raises(FileSetError, match=r"cannot be written to"):
        copy_out(out / "s.scene.json", scene, private / "uploads")
    assert not (tmp_path / "mine").exists()
    (out / "a.obj").unlink()
    copied = copy_out(out / "s.scene.json", scene, private / "uploads")
    assert copied.objects[0].model.path == out / "a.obj"
    found = [path.relative_to(tmp_path).as_posix() for path in files_below(tmp_path / "here")]
    assert found == ["here/out/a.obj", "here/out/maps/b.mtl"]
    assert not (tmp_path / "token.mtl").exists()


def test_a_folder_that_cannot_be_made_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "uploads").write_text("a file is in the way")
    with pytest.raises(FileSetError, match=r"^a\.json: cannot be written to .*yours to write to"):
        keep(tmp_path / "uploads", {"a.json": b"{}"})


@pytest.mark.parametrize("is_large", [False, True])
def test_a_zip_of_a_huge_directory_is_refused_before_it_is_read(tmp_path, is_large):
    count = 100_000
    entry = struct.pack("<I6H3I5H2I", 0x02014B50, *[0] * 9, 9, *[0] * 6) + b"__MACOSX/"
    size, end = len(entry) * count, b""
    if is_large:
        end = struct.pack("<IQHHIIQQQQ", 0x06064B50, 44, 45, 45, 0, 0, count, count, size, 0)
        end += struct.pack("<IIQI", 0x07064B50, 0, size, 1)
    shown = (0xFFFF, 0xFFFF, 0xFFFFFFFF) if is_large else (0, 0, size)
    end += struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, *shown, 0, 0)
    (tmp_path / "a.zip").write_bytes(entry * count + end)
    with pytest.raises(FileSetError, match=r"a\.zip: a directory of 5,500,000 bytes"):
        keep_zip(tmp_path / "uploads", tmp_path / "a.zip")
