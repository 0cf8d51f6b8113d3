"""Files that come from a browser: checked, and kept as the sets that they came in."""

import hashlib
import json
import os
import re
import shutil
import tempfile
import time
import zipfile
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from io import BytesIO
from itertools import accumulate, count
from os.path import lexists
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from poseviewer.errors import FileSetError, printable
from poseviewer.files.checks import InputFile
from poseviewer.files.mesh.load import READERS
from poseviewer.files.mesh.named import bare_name, plain_name
from poseviewer.files.photo import ENDINGS
from poseviewer.files.state.session_file import files_of_sessions
from poseviewer.files.video import VIDEOS
from poseviewer.files.writing import safe_path, sha256_of, writing_to
from poseviewer.opening.sources import MAX_FILES, ModelFiles, is_of_system, model_files
from poseviewer.scene.types import Scene

MAX_UPLOAD_BYTES = 200_000_000
"""Bytes: viser holds an upload in memory."""
MAX_UNPACKED_BYTES = 1_000_000_000
MAX_DIRECTORY_BYTES = 4_000_000
"""Bytes of a zip's directory: twice ``MAX_FILES`` entries with names of 150 bytes have fewer."""
MAX_END_BYTES = 65_535 + 22 + 20 + 56
"""Bytes at the end of a zip that say where its directory is, with the longest comment."""
ENCRYPTED = 1
"""Flag of an entry of a zip that has a password."""
UNPACK = "unpack it yourself and start poseviewer with the path of what is needed"
MIN_UPLOADS = 20
"""Number of the newest uploads that stay at any age."""
OLD_S = 3600.0
"""Age (s) at which others go."""
BEGUN = "new-"
"""A set that is not whole yet has such a name."""
MAX_NAME_LETTERS = 80
Entries: Any = Annotated[list[tuple[str, Annotated[int, Meta(ge=0)]]], Meta(min_length=1)]
"""Names and sizes (bytes) of the files that a page sends."""
OUR_NAME = re.compile(rf"[0-9a-f]{{16}}|{BEGUN}.*")
ACCEPTED = {
    "photo": (*ENDINGS, *VIDEOS, ".json", ".yml", ".yaml", ".xml", ".zip"),
    "model": (*READERS, ".mtl", ".bin", *ENDINGS, ".json", ".zip"),
    "pose": (".json", ".png"),
}
"""Endings that a file chooser offers first."""


def pack(files: Iterable[tuple[str, bytes]]) -> bytes:
    """Files as a page sends them: a line of JSON, a list of [path, bytes], then all the bytes."""
    files = list(files)
    head = json.dumps([[name, len(data)] for name, data in files]).encode()
    return b"\n".join([head, b"".join(data for _, data in files)])


def keep_set(folder: Path, data: bytes) -> Path:
    """Keep files that a page sent (see ``pack``), zips unpacked; the same bytes in one folder."""
    files = _unpack(data)
    shown = display_name(files[0][0]) if len(files) == 1 else f"{len(files)} files"
    return _keep(folder, data, files, shown)


def call_missing(data: bytes, missing: Sequence[str]) -> bytes:
    """Files as a page sent them; a sole one, unless it is ``missing``, is called as the first that
    is.
    """
    files = _unpack(data)
    is_known = {plain_name(name) for name, _ in files} & {*map(plain_name, missing)}
    is_other = len(files) == 1 and missing and not is_known
    return pack([(missing[0], bytes(files[0][1]))]) if is_other else data


def keep_zip(folder: Path, path: Path) -> Path:
    """Unpack a zip of the disk as ``keep_set`` does."""
    file = InputFile(path, [], FileSetError, "zip", MAX_UNPACKED_BYTES)
    with file.naming_errors():
        file.check_size()
        marks = f"{path.name} {sha256_of(path)}".encode()
    return _keep(folder, marks, [(path.name, path)], path.name)


def gather(folder: Path, model: ModelFiles) -> Path:
    """The model where it lies, or copied with all it names into ``folder``, as by ``keep_set``."""
    if not model.scattered:
        return model.path
    files = {PurePosixPath(model.path.name): model.path}
    for written, path in model.named.items():
        inside = safe_path(written)
        # Material files lie beside the model: what they name is sought from where they lie.
        is_bare = path.suffix.lower() == ".mtl" or str(inside) != written.replace("\\", "/")
        files.setdefault(safe_path(bare_name(written)) if is_bare else inside, path)
    with InputFile(model.path, error_type=FileSetError, kind="model").naming_errors():
        marks = "\n".join(f"{name} {sha256_of(path)}" for name, path in files.items())
    copies = [(str(name), path) for name, path in files.items()]
    return _keep(folder, marks.encode(), copies, model.path.name) / model.path.name


def copy_out(path: Path, scene: Scene, private: Path) -> Scene:
    """Copy a scene's files from the folder ``private`` beside the scene file at ``path``; frames
    into a folder ``.frames`` there.

    Raises:
        FileSetError: the folder cannot be written to.
    """

    def copy(own: Path | None) -> Path | None:
        if own is None or private.resolve() not in own.resolve().parents:
            return own
        named = model_files(own, ()).named.values() if own.suffix.lower() in READERS else ()
        inside, files = own.parent.resolve(), {Path(own.name): own}
        below = (old.resolve() for old in named if inside in old.resolve().parents)
        files |= {old.relative_to(inside): old for old in below}
        stem = path.name.removesuffix(".json").removesuffix(".scene")
        beside = path.with_name(f"{stem}.frames") if own in frames else path.parent
        for number in count(1):
            place = beside if number == 1 else path.with_name(f"{path.stem}.{number}")
            pairs = [(old, place / name) for name, old in files.items()]
            if all(not lexists(new) or sha256_of(new) == sha256_of(old) for old, new in pairs):
                break
        for old, new in pairs:
            new.parent.mkdir(parents=True, exist_ok=True)
            if not lexists(new):
                shutil.copyfile(old, new)
        return pairs[0][1]

    frames = {frame.file.path for frame in scene.frames}
    with writing_to(path.parent, f"{path.name}, with its photos and models", FileSetError):
        known = (replace(f, file=replace(f.file, path=copy(f.file.path))) for f in scene.frames)
        scene = replace(scene, frames=tuple(known))
        views = [replace(v, file=replace(v.file, path=copy(v.path))) for v in scene.views]
        items = [replace(o, model=replace(o.model, path=copy(o.model.path))) for o in scene.objects]
    return replace(scene, views=tuple(views), objects=tuple(items))


def why_unfit(name: str, size: int, count: int = 1) -> str:
    """Say why ``count`` files of ``size`` bytes together are not taken; "" where they are."""
    found = wanted = ""
    if count > MAX_FILES:
        found = f": more than {MAX_FILES:,} files"
        wanted = "drop those alone that belong to one photo and its model"
    elif size > MAX_UPLOAD_BYTES:
        found = f"{f' ({count:,} files)' if count > 1 else ''}: {size:,} bytes"
        wanted = f"up to {MAX_UPLOAD_BYTES:,} can be uploaded, start poseviewer with its path"
    return f"{display_name(name)}{found}; {wanted}." if found else ""


def why_not_sent(name: str, trouble: Literal["unreadable", "empty", "cut off"]) -> str:
    """Say why a page sends nothing, or not all, of what was dropped on it."""
    words = {
        "cut off": "the upload was cut off; nothing was changed, drop it again",
        "empty": "an empty folder; drop one that holds a photo, a model or a pose",
        "unreadable": "cannot be read any more; is it still there? Drop it again",
    }
    return f"{display_name(name)}: {words[trouble]}."


def display_name(name: str) -> str:
    """A name from a browser as text that is safe to show: one line, at most 80 characters."""
    return printable(re.split(r"[/\\]", name)[-1].strip(), MAX_NAME_LETTERS) or "unnamed"


def _unpack(data: bytes) -> list[tuple[str, memoryview]]:
    head, rest = data.partition(b"\n")[0], memoryview(data)[data.find(b"\n") + 1 :]
    try:
        entries = msgspec.convert(json.loads(head), Entries)
    except (ValueError, msgspec.ValidationError, RecursionError):
        found = "The upload is no set of files"
        raise FileSetError(f"{found}; reload the page and try again.") from None
    names, ends = [name for name, _ in entries], [*accumulate(size for _, size in entries)]
    if ends[-1] != len(rest):
        found = f"{len(rest):,} bytes came, and {ends[-1]:,} were announced"
        raise FileSetError(f"{display_name(names[0])}: {found}; it was cut off, drop it again.")
    if len(names) > MAX_FILES:
        raise FileSetError(why_unfit(names[0], len(rest), len(names)))
    return [(name, rest[i:j]) for name, i, j in zip(names, [0, *ends], ends, strict=False)]


def _unzip(packed: Path | BytesIO, name: str, place: Path, room: int) -> int:
    file = InputFile(Path(name), error_type=FileSetError, kind="zip")
    with file.naming_errors():
        _check_directory(file, packed)
    with file.naming_errors(), zipfile.ZipFile(packed) as archive:
        entries = [entry for entry in archive.infolist() if _is_wanted(entry)]
        size = sum(entry.file_size for entry in entries)
        if size > room or len(entries) > MAX_FILES:
            found = f"unpacks to more than {MAX_UNPACKED_BYTES:,} bytes or {MAX_FILES:,} files"
            raise file.error(found, UNPACK)
        if any(entry.flag_bits & ENCRYPTED for entry in entries):
            raise file.error("has a password", UNPACK)
        paths = [place / safe_path(entry.filename) for entry in entries]
        _check_folders(file, place, paths)
        for entry, path in zip(entries, paths, strict=True):
            with archive.open(entry) as source, writing_to(place, name, FileSetError):
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("wb") as target:
                    shutil.copyfileobj(source, target)
    return size


def _check_folders(file: InputFile, place: Path, paths: Sequence[Path]) -> None:
    """Raise where a path is that of a file, or a link, and of a folder."""
    folders = {folder for path in paths for folder in path.parents}
    if (both := next((path for path in paths if path in folders), None)) is not None:
        name = printable(str(both.relative_to(place)), MAX_NAME_LETTERS)
        raise file.error(f"{name} is a file in it, and a folder", f"rename one, or {UNPACK}")


def _check_directory(file: InputFile, packed: Path | BytesIO) -> None:
    """Raise where a zip's directory is very large: it is read before the first entry is seen."""
    with packed.open("rb") if isinstance(packed, Path) else nullcontext(packed) as source:
        source.seek(max(0, source.seek(0, os.SEEK_END) - MAX_END_BYTES))
        end = source.read()
    sizes = [0]
    for start, place, length in ((b"PK\5\6", 12, 4), (b"PK\6\6", 40, 8)):
        if (at := end.rfind(start)) >= 0:
            sizes.append(int.from_bytes(end[at + place : at + place + length], "little"))
    largest = max(size for size in sizes if size != 0xFFFFFFFF)  # then the other one says it
    if largest > MAX_DIRECTORY_BYTES:
        raise file.error(f"a directory of {largest:,} bytes", UNPACK)


def _is_wanted(entry: zipfile.ZipInfo) -> bool:
    parts = re.split(r"[/\\]", entry.filename)
    return not (entry.is_dir() or any(is_of_system(part) for part in parts if part != ".."))


def _keep(
    folder: Path, marks: bytes, files: Sequence[tuple[str, memoryview | Path]], shown: str
) -> Path:
    """The folder of these ``files``, which ``marks`` tell apart; filled whole or not at all."""
    place = folder / hashlib.sha256(marks).hexdigest()[:16]
    with writing_to(folder, shown, FileSetError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not place.is_dir():
            with tempfile.TemporaryDirectory(dir=folder, prefix=BEGUN) as new:
                (Path(new) / "set").mkdir()
                _fill(Path(new) / "set", files)
                (Path(new) / "set").rename(place)
        place.touch()
        _remove_old(folder)
    return place


def _fill(place: Path, files: Sequence[tuple[str, memoryview | Path]]) -> None:
    room = MAX_UNPACKED_BYTES
    for number, (name, content) in enumerate(files):
        path = place / safe_path(name)
        is_zip = path.suffix.lower() == ".zip"
        folders = [*path.parents, path.with_suffix("")] if is_zip else path.parents
        if any(folder.is_file() for folder in folders):
            path = place / str(number) / safe_path(name)
        elif path.exists():
            path = path.parent / str(number) / path.name
        path.parent.mkdir(parents=True, exist_ok=True)
        if is_zip:
            file = content if isinstance(content, Path) else BytesIO(content)
            room -= _unzip(file, display_name(name), path.with_suffix(""), room)
        elif isinstance(content, Path):
            shutil.copyfile(content, path)
        else:
            path.write_bytes(content)


def _remove_old(folder: Path) -> None:
    ours = [p for p in folder.iterdir() if OUR_NAME.fullmatch(p.name) and not p.is_symlink()]
    ours.sort(key=lambda p: (p.name.startswith(BEGUN), -p.stat().st_mtime_ns))  # begun ones last
    surplus = [p for i, p in enumerate(ours) if i >= MIN_UPLOADS or p.name.startswith(BEGUN)]
    old = [p for p in surplus if time.time() - p.stat().st_mtime > OLD_S]
    used = files_of_sessions(folder.with_name("sessions")) if old else ()
    for place in old:
        if not any(place in file.parents for file in used):
            shutil.rmtree(place, ignore_errors=True)
