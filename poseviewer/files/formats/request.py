"""What a user asks of a conversion besides the pose, what came of it, and checks of all formats."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import Reading
from poseviewer.files.pose import ModelReference, PhotoReference, PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.lens import Lens, Undistortion

METRES = {"km": 1000.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Length units by name, in metres."""


@dataclass(frozen=True, slots=True)
class Request:
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


@dataclass(frozen=True, slots=True)
class Written:
    """What a writer wrote."""

    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    """What the user should know about it."""


def refuse_existing(request: Request, *paths: Path) -> None:
    """Raise PoseFileError where a path is taken, unless the user wants it overwritten."""
    for path in paths:
        if path.is_dir():
            raise PoseFileError(f"{path}: is a folder; name a file in it.")
        if path.exists() and not request.overwrite:
            raise PoseFileError(
                f"{path}: is there already and was not touched; name another, or add --overwrite."
            )


def write_new(request: Request, contents: Mapping[Path, str | bytes], *notes: str) -> Written:
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


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, unless it is there; raises PoseFileError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PoseFileError(
            f"{folder}: cannot be made ({error.strerror}); name a folder of yours."
        ) from error


def require_perspective(record: PoseRecord, tool: str) -> Perspective:
    """The record's camera, pixel centres at i + 0.5.

    Raises:
        PoseFileError: the projection is parallel, which this tool's files cannot say.
    """
    if isinstance(record.pose.camera, Perspective):
        return record.pose.camera
    raise PoseFileError(
        f"The pose is one of parallel projection, which {tool} files cannot hold; convert it to "
        "matrices, gltf or blender, or fit it in perspective."
    )


def refuse_lens(record: PoseRecord, tool: str) -> None:
    """Raise PoseFileError where the pose is one in an undistorted photo, and the file would name
    the photo as taken.
    """
    if record.undistortion is not None:
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
    """The size of a length unit; raises PoseFileError where nobody here knows it."""
    if unit not in METRES:
        raise PoseFileError(
            f"The model's unit is {unit!r}; wanted one of {', '.join(METRES)}, say it with --unit."
        )
    return METRES[unit]


def unit_of(record: PoseRecord, request: Request) -> str | None:
    """The model's unit: what the user says, else what the pose file says."""
    return request.unit or (record.model.unit if record.model else None)


def photo_name(record: PoseRecord) -> str | None:
    """The name of the photo's file, where the pose has it."""
    return record.photo.file if record.photo else None


def size_of(
    reading: Reading, request: Request, width: Any = None, height: Any = None
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
    reading: Reading, request: Request, kind: str, names: Sequence[str], *entries: Sequence[Any]
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
