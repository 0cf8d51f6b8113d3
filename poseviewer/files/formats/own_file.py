"""poseviewer's own pose file, as one of the formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from poseviewer.files.formats.request import Request, Written, refuse_existing, size_of
from poseviewer.files.pose.checks import Reading, read_json
from poseviewer.files.pose.file import PhotoReference, PoseRecord, record_from_json, save_pose


def write_own(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a pose file.

    Raises:
        PoseFileError: the file is there already, or cannot be written.
    """
    refuse_existing(request, out)
    save_pose(out, record)
    return Written((out,))


def read_own(path: Path, request: Request) -> PoseRecord:
    """Read a pose file, which often says the photo's size; if not, the request must.

    Raises:
        PoseFileError: it does not hold a pose.
    """
    reading = Reading(path.name, [])
    data = reading.object(read_json(path), "its content")
    photo = data.get("photo")
    sides = (photo.get("width"), photo.get("height")) if isinstance(photo, dict) else (None, None)
    found = (reading.size(sides[0], "photo.width"), reading.size(sides[1], "photo.height"))
    width, height = size_of(reading, request, found)
    record = record_from_json(reading, data, width, height)
    known = record.photo or PhotoReference()
    return replace(record, photo=replace(known, width=width, height=height))
