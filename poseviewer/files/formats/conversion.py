"""What a format is, what a user asks of a conversion besides the pose, checks of all formats, and
which photo the numbers of a file belong to.

Where the photo was undistorted for the pose, a tool that has the photo's lens model gets camera and
lens of the photo as taken: the same polynomials under its own names. Every other gets the
undistorted photo, written beside its file, and the pinhole camera of that.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PhotoFileError, PoseFileError, PoseViewerError
from poseviewer.files.checks import Reading, checked_camera
from poseviewer.files.photo import SAME, load_photo, photo_text, pixels_for, save_image, undistorted
from poseviewer.files.pose import ModelReference, PhotoReference, PoseRecord
from poseviewer.files.writing import sha256_of, write_whole
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.photo import Photo

METRES = {"km": 1000.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Length units by name, in metres."""


@dataclass(frozen=True, slots=True)
class ConvertOptions:
    """What is not in the file that is read, or is to be other than it says."""

    photo: Path | None = None
    """The photo's file."""
    model: Path | None = None
    """The model's file."""
    photo_size: tuple[int, int] | None = None
    """Width and height of the photo in px, for files that do not say it."""
    unit: str | None = None
    """The model's length unit, a key of ``METRES``."""
    image: str | None = None
    """Which image of a file with several: its name, or its number (BOP)."""
    object_id: int | None = None
    """Which object (BOP)."""
    overwrite: bool = False
    undistorted_photo: Path | None = None
    """Where to write the undistorted photo, which the pose is then written for."""
    others: tuple[tuple[PoseRecord, ConvertOptions], ...] = ()
    """Of a pose in a set of photos: the same in each of the others, and what is known of that."""


@dataclass(frozen=True, slots=True)
class Written:
    """What a writer wrote."""

    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    """What the user should know about it."""
    undistorted_photo: Path | None = None
    """The photo that all belongs to, where it was written as well."""


Beside = Callable[[PoseRecord, ConvertOptions], Path]
"""Where the undistorted photo of a pose goes, that no user has named a place for."""
LensAs = Callable[[Lens | None], tuple[str, Any] | None]
"""A format's name for a lens (None: a pinhole) and its parameters there; None: it has not that."""


@dataclass(frozen=True, slots=True)
class Format:
    """One format. Both functions raise PoseFileError where a file cannot be used or written, or
    the format cannot say the pose.
    """

    write: Callable[[PoseRecord, Path, ConvertOptions], Written]
    """Pose, where to, and what else is known."""
    read: Callable[[Path, ConvertOptions], PoseRecord] | None
    parallel: bool = False
    """Whether it can say parallel projection."""
    lens_as: LensAs | None = None
    several: bool = True
    """Whether it can say the cameras of several photos."""
    both_photos: bool = False
    """Whether it says of the photo as taken and the undistorted one what belongs to which."""

    def held(self, record: PoseRecord) -> str | None:
        """What it calls the lens of a pose's photo; None where there is none, or it has not that
        lens; or where the pose has another camera than that of the undistorted photo (a focal
        length that was found): no lens model says that.
        """
        undistortion, camera = record.undistortion, record.pose.camera
        if undistortion is None or self.both_photos:
            return None if undistortion is None else "both"
        if self.lens_as is None or not isinstance(camera, Perspective):
            return None
        same = np.allclose(astuple(camera), astuple(undistortion.camera), rtol=SAME)
        found = self.lens_as(undistortion.lens) if same else None
        return None if found is None else found[0]

    def convert(
        self, record: PoseRecord, out: Path, request: ConvertOptions, beside: Beside
    ) -> Written:
        """Write a pose for the photo as taken where the format has its lens, else for the
        undistorted photo, which is written to ``request.undistorted_photo`` or ``beside``, and
        taken away again where what follows fails; so with the other photos of a set.

        Raises:
            PoseViewerError: the pose cannot be written; the photo is not known or unusable; a file
                is in the way; there is nothing to undistort.
        """
        if record.undistortion is None and request.undistorted_photo is not None:
            raise PoseFileError(
                "--undistorted-photo, and the pose is one in the photo as taken, without a "
                "lens; leave it out."
            )
        if not request.others:
            return self._convert_one(record, out, request, beside)
        if not self.several:
            left = f"It holds one photo: the other {len(request.others)} of the set are left out."
            written = self._convert_one(record, out, replace(request, others=()), beside)
            return replace(written, notes=(*written.notes, left))
        others, notes, new = [], [], []
        try:
            for other, asked in request.others:
                if other.undistortion is None or self.held(other) is not None:
                    others.append((other, asked))
                elif asked.photo is None:
                    notes.append(f"{photo_name(other)} is not there to be undistorted: left out.")
                else:
                    path = beside(other, asked)
                    new += [path] * _write(path, _undistorted(other, asked), asked)
                    others.append((_of_undistorted(other, path), replace(asked, photo=path)))
            of_all = replace(request, others=tuple(others))
            written = self._convert_one(record, out, of_all, beside)
        except PoseViewerError:
            for path in new:
                path.unlink()
            raise
        return replace(written, files=(*written.files, *new), notes=(*written.notes, *notes))

    def _convert_one(
        self, record: PoseRecord, out: Path, request: ConvertOptions, beside: Beside
    ) -> Written:
        if record.undistortion is None:
            return self.write(record, out, request)
        held, name = self.held(record), photo_name(record) or "the photo"
        if held is not None and request.undistorted_photo is None:
            note = f"Camera and lens ({held}) are those of {name} as taken."
            if held == "both":
                note = (
                    "The pose and its camera belong to the undistorted photo; the file's "
                    "distortion block says how that is made of the photo as taken."
                )
            written = self.write(record, out, request)
            return replace(written, notes=(note, *written.notes))
        path = request.undistorted_photo or beside(record, request)
        is_new = _write(path, _undistorted(record, request), request)
        note = (
            f"All numbers belong to {path.name}, the undistorted photo, which is written; not to "
            f"{name} as taken."
        )
        # BOP numbers its images by the names of their files.
        asked = replace(request, photo=path, image=request.image or photo_name(record))
        try:
            written = self.write(_of_undistorted(record, path), out, asked)
        except PoseViewerError:
            if is_new:
                path.unlink()
            raise
        return Written(written.files, (note, *written.notes), path)


def _of_undistorted(record: PoseRecord, path: Path) -> PoseRecord:
    """The same of the undistorted photo alone, which lies there."""
    camera = record.pose.camera
    photo = PhotoReference(path.name, camera.width, camera.height, sha256_of(path))
    return replace(record, undistortion=None, photo=photo)


def refuse_existing(request: ConvertOptions, *paths: Path) -> None:
    """Raise PoseFileError where a path is taken, unless the user wants it overwritten."""
    for path in paths:
        if path.is_dir():
            raise PoseFileError(f"{path}: is a folder; name a file in it.")
        if path.exists() and not request.overwrite:
            raise PoseFileError(
                f"{path}: is there already and was not touched; name another, or add --overwrite."
            )


def write_new(
    request: ConvertOptions, contents: Mapping[Path, str | bytes], *notes: str
) -> Written:
    """Write files that are not there yet, or that the user wants overwritten; all or none.

    Raises:
        PoseFileError: a path is taken, or cannot be written to.
    """
    refuse_existing(request, *contents)
    for path, content in contents.items():
        write_whole(
            path, content if isinstance(content, bytes) else content.encode(), PoseFileError
        )
    return Written(tuple(contents), notes)


def json_text(data: Mapping[str, Any]) -> str:
    """JSON to be read by people as well."""
    return json.dumps(data, indent=2) + "\n"


def require_pinhole(record: PoseRecord, tool: str) -> Perspective:
    """The record's camera, pixel centres at i + 0.5.

    Raises:
        PoseFileError: the projection is parallel, or the photo as taken has a lens, which this
            tool's files cannot say.
    """
    refuse_lens(record, tool)
    return _perspective(record, tool)


def _perspective(record: PoseRecord, tool: str) -> Perspective:
    if isinstance(record.pose.camera, Perspective):
        return record.pose.camera
    raise PoseFileError(
        f"The pose is one of parallel projection, which {tool} files cannot hold; convert it to "
        "matrices, gltf or blender, or fit it in perspective."
    )


def refuse_lens(record: PoseRecord, tool: str, lens: Any = None) -> None:
    """Raise PoseFileError where the pose is one in an undistorted photo, and the file would name
    the photo as taken, without saying its ``lens``.
    """
    if record.undistortion is not None and lens is None:
        raise PoseFileError(
            f"The pose is one in an undistorted photo, and {tool} files cannot hold its lens; "
            "write it for the undistorted photo, with --undistorted-photo FILE."
        )


def require_file(path: Path | None, what: str, tool: str) -> Path:
    """A photo or model that a format cannot do without.

    Raises:
        PoseFileError: none is known, or there is no such file.
    """
    if path is None:
        raise PoseFileError(f"{tool} files name the {what}, and none is known; add --{what} FILE.")
    if not path.is_file():
        raise PoseFileError(f"{path}: no such file; name the {what} with --{what} FILE.")
    return path


def metres_per_unit(unit: str) -> float:
    """The size of a length unit; raises PoseFileError where it is unknown."""
    if unit not in METRES:
        raise PoseFileError(
            f"The model's unit is {unit!r}; wanted one of {', '.join(METRES)}, say it with --unit."
        )
    return METRES[unit]


def unit_of(record: PoseRecord, request: ConvertOptions) -> str | None:
    """The model's unit: what the user says, else what the pose file says."""
    return request.unit or (record.model.unit if record.model else None)


def photo_name(record: PoseRecord) -> str | None:
    """The name of the photo's file, where the pose has it."""
    return record.photo.file if record.photo else None


def size_of(
    reading: Reading, request: ConvertOptions, width: Any = None, height: Any = None
) -> tuple[int, int]:
    """Width and height of the photo in px: what the file says (unchecked), else what the user says.

    Raises:
        PoseFileError: neither says it, they differ, or it is no size.
    """
    found = reading.size(width, "the photo's width"), reading.size(height, "the photo's height")
    if found[0] is None or found[1] is None:
        if request.photo_size is None:
            wanted = "add --photo-size WIDTHxHEIGHT"
            raise reading.error("it does not say how large the photo is", wanted)
        return request.photo_size
    if request.photo_size not in (None, found):
        asked = "x".join(map(str, request.photo_size or ()))
        raise reading.error(f"it is for a photo of {found[0]}x{found[1]} px", f"not of {asked} px")
    return found[0], found[1]


def the_one(
    reading: Reading,
    request: ConvertOptions,
    kind: str,
    names: Sequence[str],
    *entries: Sequence[Any],
) -> Any:
    """The entry that ``request.image`` names, or the only one; ``names`` of all ``kind``.

    ``entries``: further lists, in which it may have other names; the last one holds what is wanted.

    Raises:
        PoseFileError: there is none, or more than one.
    """
    columns = list(zip(names, *entries, strict=True))
    chosen = [row[-1] for row in columns if request.image is None or request.image in row[:-1]]
    if len(chosen) != 1:
        meant = repr(request.image) if request.image else "meant"
        raise reading.error(
            f"{len(chosen)} of its {len(columns)} {kind} are {meant}",
            "wanted one, choose it with --image NAME",
        )
    return chosen[0]


def make_record(
    reading: Reading,
    pose: Pose,
    photo: str | None = None,
    unit: str | None = None,
    lens: Lens | None = None,
) -> PoseRecord:
    """The record of a pose that was read from another tool's file.

    With a ``lens``, the pose's camera is that of the photo as taken, and the record is one of the
    undistorted photo.
    """
    undistortion = None
    pose = replace(pose, camera=checked_camera(reading, pose.camera))
    if lens is not None and isinstance(pose.camera, Perspective):
        undistortion = Undistortion.of(lens, pose.camera)
        pose = replace(pose, camera=undistortion.camera)
    return PoseRecord(
        pose,
        PhotoReference(photo, pose.camera.width, pose.camera.height),
        ModelReference(unit=unit) if unit else None,
        undistortion=undistortion,
        warnings=tuple(reading.warnings),
    )


def seen_as_taken(record: PoseRecord, tool: str, lens_as: LensAs) -> tuple[Perspective, Any]:
    """Camera (pixel centres at i + 0.5) of the photo as taken, and what the tool makes of its lens.

    Raises:
        PoseFileError: the projection is parallel, or the tool does not have the lens.
    """
    camera, lens = _perspective(record, tool), None
    if record.undistortion is not None:
        camera, lens = record.undistortion.taken, record.undistortion.lens
    found = lens_as(lens)
    refuse_lens(record, tool, found)
    return camera, found


def _undistorted(record: PoseRecord, request: ConvertOptions) -> Photo:
    if request.photo is None:
        raise PoseFileError(
            "The pose is one in the undistorted photo, which has to be written for it, and the "
            "photo as taken is not known; add --photo FILE."
        )
    photo = load_photo_of(record, request.photo)
    known = record.photo.sha256 if record.photo else None
    if known and known.lower() != photo.sha256:
        raise PhotoFileError(
            f"{photo.name}: not the photo that the pose was found on (the fingerprints differ); "
            "name that one with --photo, or this one if you mean it."
        )
    assert record.undistortion is not None  # asked for such poses alone
    return undistorted(photo, record.undistortion)


def load_photo_of(record: PoseRecord, path: Path) -> Photo:
    """The photo of a pose.

    Raises:
        PhotoFileError: it cannot be read, or has another size than the pose's.
    """
    photo, camera = load_photo(path), record.pose.camera
    if (photo.width, photo.height) != (camera.width, camera.height):
        raise PhotoFileError(
            f"{photo.name}: {photo.width}x{photo.height} px, and the pose is one for "
            f"{camera.width}x{camera.height} px; name the photo of the pose with --photo."
        )
    return photo


def _write(path: Path, picture: Photo, request: ConvertOptions) -> bool:
    """Write the picture; False where a file was there already, with just these pixels or to be
    replaced.
    """
    there = path.exists()
    if there and request.photo is not None and path.samefile(request.photo):
        raise PhotoFileError(
            f"{path}: is the photo as taken, which is never replaced; name another file with "
            "--undistorted-photo."
        )
    if there and not request.overwrite:
        if path.is_file() and np.array_equal(load_photo(path).pixels, picture.pixels):
            return False
        raise PhotoFileError(
            f"{path}: is there already and was not touched; name another for the undistorted "
            "photo with --undistorted-photo, or add --overwrite."
        )
    save_image(path, pixels_for(path, picture), photo_text(picture))
    return not there
