"""Frames of a sequence: images in the order of their numbers, or a video's, kept as JPEGs."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.errors import PhotoFileError, list_names
from poseviewer.files.photo import ENDINGS, photo_size
from poseviewer.files.video import VIDEOS, extract_frames, load_record

MAX_NAMED = 5


@dataclass(frozen=True, slots=True)
class ImageSequence:
    """Images of one camera in order; none is read but for its header."""

    name: str
    """Name of the folder or the video."""
    paths: tuple[Path, ...]
    times_s: tuple[float | None, ...]
    """Time stamps from the first frame, s; None: not known."""
    sha256s: tuple[str | None, ...]
    """Fingerprints of the files; None: not known."""
    notes: tuple[str, ...] = ()


def load_sequence(
    source: str | Path | Sequence[Path] | ImageSequence, every: int = 1, folder: Path | None = None,
    progress: Callable[[float], object] | None = None,
) -> ImageSequence:  # fmt: skip
    """Load the frames of a sequence. An image that cannot be read is left out with a note.

    Args:
        source: folder of images, their files, a video, or a sequence, which is returned as it is.
        every: take the first frame, and every N-th after it.
        folder: where a video's frames are kept; None: as of ``extract_frames``.
        progress: is given the share of a video that has been read, now and then.

    Raises:
        PhotoFileError: there are no frames, or they differ in size or orientation.
    """
    if isinstance(source, ImageSequence):
        return source
    if not isinstance(source, str | Path):
        paths = sorted((path.absolute() for path in source), key=natural_order)
        if paths[0].suffix.lower() not in VIDEOS:
            return _of_images(paths[0].parent.name, paths, every)
        source = paths[0]
    path = Path(source).absolute()
    if path.suffix.lower() in VIDEOS and not path.is_dir():
        folder, record = extract_frames(path, every, folder, progress)
        names = record.names(every)
        times = tuple(record.times_s[name] for name in names)
        paths = tuple(folder.absolute() / name for name in names)
        known = tuple(record.sha256s.get(name) for name in names)
        return ImageSequence(path.name, paths, times, known, record.notes)
    if not path.is_dir():
        wanted = f"wanted a folder of images, or a video ({', '.join(VIDEOS)})"
        raise PhotoFileError(f"{path.name}: no such folder, and no video; {wanted}.")
    return _of_images(path.name, images_in(path), every)


def images_in(folder: Path) -> list[Path]:
    """List the images in a folder, but not below it, in natural order."""
    images = (
        path
        for path in folder.iterdir()
        if path.suffix.lower() in ENDINGS and not path.name.startswith(".") and path.is_file()
    )
    return sorted(images, key=natural_order)


def natural_order(path: Path) -> list[str | int]:
    """Return the key that sorts ``frame_2`` before ``frame_10``."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [int(part) if index % 2 else part for index, part in enumerate(parts)]


def _of_images(name: str, paths: Sequence[Path], every: int) -> ImageSequence:
    if not paths:
        wanted = f"a folder of images ({', '.join(ENDINGS)})"
        raise PhotoFileError(f"{name}: no image in it; wanted {wanted}.")
    kept, errors = list[Path](), list[PhotoFileError]()
    first = None
    for path in paths[::every]:
        try:
            size = photo_size(path)
        except PhotoFileError as error:
            errors.append(error)
            continue
        first = first or size
        if size[:2] != first[:2]:
            found = f"{size[0]}x{size[1]} px, and {kept[0].name} has {first[0]}x{first[1]} px"
            raise PhotoFileError(f"{path.name}: {found}; give frames of one size.")
        if size[2] != first[2]:
            found = f"its EXIF turns it otherwise than {kept[0].name}"
            raise PhotoFileError(f"{path.name}: {found}; give frames of a camera held one way.")
        kept.append(path)
    if not kept:
        raise errors[0]
    notes = _gap_notes(paths)
    if errors:
        reasons = list_names([str(error).rstrip(".") for error in errors], MAX_NAMED)
        notes += (f"{len(errors)} of {len(paths[::every])} frames are left out: {reasons}.",)
    record = load_record(paths[0].parent)
    times, known = (record.times_s, record.sha256s) if record else ({}, {})
    times_s = tuple(times.get(path.name) for path in kept)
    sha256s = tuple(known.get(path.name) for path in kept)
    return ImageSequence(name, tuple(kept), times_s, sha256s, notes)


def _gap_notes(paths: Sequence[Path]) -> tuple[str, ...]:
    """Return a sentence on numbers that are missing from the files' names, or none."""
    numbers = [match[-1] for path in paths if (match := re.findall(r"\d+", path.stem))]
    if len(numbers) < max(len(paths), 3):
        return ()
    steps = np.diff(np.array(numbers, float))
    gaps = np.flatnonzero(steps > np.median(steps))
    if not 0 < len(gaps) <= 0.1 * len(paths) + 1:  # else the numbers count something else
        return ()
    before, after = (paths[int(gaps[0]) + one].name for one in (0, 1))
    more = f", and at {len(gaps) - 1} more places" if len(gaps) > 1 else ""
    return (f"A frame is missing between {before} and {after}{more}; the others go on after it.",)
