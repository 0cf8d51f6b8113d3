"""Frames of a sequence: images in the order of their numbers, or a video's, kept as JPEGs."""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from poseviewer.errors import PhotoFileError, PoseFileError, list_names
from poseviewer.files.checks import InputFile
from poseviewer.files.photo import (
    ENDINGS,
    PAGED_ENDINGS,
    PhotoHeader,
    count_pages,
    load_header,
    refuse_frames,
)
from poseviewer.files.video import VIDEOS, extract_frames, load_record

MAX_NAMED = 5
COUNTS, SECONDS = re.compile(r"(\d+)"), re.compile(r"(\d+(?:\.\d+)?)")
"""Numbers in names: whole ones, and those of seconds with a fraction."""
MIN_KIND = 0.5
"""Share of the largest kind of names that another has at least, to be frames as well."""
MIN_TOLD = 0.6
"""Share of all names that such kinds have, if names tell kinds apart."""


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
        source: folder of images, their files, a video, a picture of several pages, or a sequence,
            which is returned as it is.
        every: take the first frame, and every N-th after it.
        folder: where a video's frames are kept; None: as of ``extract_frames``.
        progress: is given the share of a video that has been read, now and then.

    Raises:
        PhotoFileError: there are no frames, or they differ in size or orientation.
    """
    if isinstance(source, ImageSequence):
        return source
    if not isinstance(source, str | Path):
        paths = sort_frames([path.absolute() for path in source])
        is_video = paths[0].suffix.lower() in VIDEOS
        if not is_video and (len(paths) > 1 or not _has_frames(paths[0])):
            return _of_images(paths[0].parent.name, paths, every)
        source = paths[0]
    path = Path(source).absolute()
    if not path.is_dir() and _has_frames(path):
        folder, record = extract_frames(path, every, folder, progress)
        names = record.names(every)
        times = tuple(record.times_s[name] for name in names)
        if len(times) > 1 and not any(times):  # pages without times
            times = (None,) * len(times)
        paths = tuple(folder.absolute() / name for name in names)
        known = tuple(record.sha256s.get(name) for name in names)
        return ImageSequence(path.name, paths, times, known, record.notes)
    if not path.is_dir():
        wanted = f"wanted a folder of images, or a video ({', '.join(VIDEOS)})"
        raise PhotoFileError(f"{path.name}: no such folder, and no video; {wanted}.")
    return _of_images(path.name, images_in(path), every)


def _has_frames(path: Path) -> bool:
    """Tell whether a file holds frames: it is a video, or a picture of several pages."""
    suffix = path.suffix.lower()
    return suffix in VIDEOS or (suffix in PAGED_ENDINGS and count_pages(path) > 1)


def poses_named(sequence: ImageSequence, folder: Path) -> dict[int, Path]:
    """Return the pose files in a folder by the indices of the frames that they are named as:
    ``FRAME.pose.json`` or ``FRAME.json``.

    Raises:
        PoseFileError: there is none, or one that is named as no frame.
    """
    index_of = {path.stem: index for index, path in enumerate(sequence.paths)}
    files = sorted(path for path in folder.glob("*.json") if not path.name.startswith("."))
    stems = {path: path.name.removesuffix(".json").removesuffix(".pose") for path in files}
    strange = [path.name for path, stem in stems.items() if stem not in index_of]
    if strange or not files:
        found = list_names(strange, MAX_NAMED) or "no pose file in it"
        wanted = f"wanted names of frames, such as {sequence.paths[0].stem}.pose.json"
        raise PoseFileError(f"{folder.name}: {found}; {wanted}.")
    return {index_of[stem]: path for path, stem in stems.items()}


def images_in(folder: Path) -> list[Path]:
    """List the images in a folder, but not below it, in the order of frames."""
    return sort_frames([
        path
        for path in folder.iterdir()
        if path.suffix.lower() in ENDINGS and not path.name.startswith(".") and path.is_file()
    ])  # fmt: skip


def sort_frames(paths: Sequence[Path]) -> list[Path]:
    """Sort files by the numbers in their names: 2 before 10, and as seconds 12.45 before 12.5."""
    numbers = _numbers_of(paths)

    def order(path: Path) -> list[str | tuple[int, str]]:
        parts = numbers.split(path.stem.lower())
        ordered = [_as_number(part) if index % 2 else part for index, part in enumerate(parts)]
        return [*ordered, path.suffix.lower()]

    return sorted(paths, key=order)


def _as_number(text: str) -> tuple[int, str]:
    """Whole part of a number, and its fraction, by whose digits it is ordered."""
    whole, _, fraction = text.partition(".")
    return int(whole), fraction


def _numbers_of(paths: Sequence[Path]) -> re.Pattern[str]:
    """Return what is a number in names: with a fraction, unless they count 1.9, 1.10."""
    found = (text for path in paths for text in SECONDS.findall(path.stem))
    fractions = [fraction for text in found if (fraction := text.partition(".")[2])]
    has_all_digits = len({len(fraction) for fraction in fractions}) < 2
    counts = any(len(fraction) > 1 and fraction.endswith("0") for fraction in fractions)
    return SECONDS if has_all_digits or not counts else COUNTS


def _kinds_of(paths: Sequence[Path]) -> list[list[Path]]:
    """Tell files apart that lie side by side: colour and depth, left and right, copies.

    A kind has one name around its numbers, one ending where the numbers are there twice, and one
    number of a camera.
    """
    pattern = _numbers_of(paths)
    kinds = list[list[Path]]()
    for own in _grouped(paths, lambda path: pattern.sub("#", path.stem.lower())):
        numbers = {path: tuple(pattern.findall(path.stem)) for path in own}
        if len(set(numbers.values())) < len(own):
            kinds += _grouped(own, lambda path: path.suffix.lower())
            continue
        columns = list(zip(*numbers.values(), strict=True))
        if len(columns) > 1:
            counting = max(range(len(columns)), key=lambda at: (len(set(columns[at])), at))
            others = {p: n[:counting] + n[counting + 1 :] for p, n in numbers.items()}
            split = _grouped(own, others.__getitem__)
            seen = [{numbers[path][counting] for path in one} for one in split]
            if len(split) > 1 and min(map(len, seen)) > 1 and seen[0] & seen[1]:
                kinds += split
                continue
        kinds.append(own)
    return kinds


def _grouped(paths: Sequence[Path], key: Callable[[Path], object]) -> list[list[Path]]:
    groups = dict[object, list[Path]]()
    for path in paths:
        groups.setdefault(key(path), []).append(path)
    return list(groups.values())


def _of_one_kind(paths: Sequence[Path]) -> tuple[list[Path], tuple[str, ...]]:
    """Take the files of one kind of names, those in colour first; also return a note on others."""
    kinds = _kinds_of(paths)
    most = max(map(len, kinds))
    large = [kind for kind in kinds if len(kind) >= MIN_KIND * most]
    if len(kinds) == 1 or most == 1 or sum(map(len, large)) < MIN_TOLD * len(paths):
        return [*paths], ()
    chosen = min(large, key=lambda kind: _rank(kind[0]))
    taken = set(chosen)
    others = [path.name for path in paths if path not in taken]
    found = f"{len(others):,} of {len(paths):,} images are left out, as their names are of another"
    names = list_names(others, MAX_NAMED)
    return chosen, (f"{found} kind than {chosen[0].name}, the first frame: {names}.",)


def _rank(path: Path) -> int:
    """Rank of a kind's first image: 0 for a picture in colour, 1 for grey, 2 for depth."""
    with suppress(PhotoFileError):
        header = load_header(path)
        return 0 if header.has_colour else 1 if header.bits == 8 else 2
    return 2


def _of_images(name: str, paths: Sequence[Path], every: int) -> ImageSequence:
    if not paths:
        wanted = f"a folder of images ({', '.join(ENDINGS)})"
        raise PhotoFileError(f"{name}: no image in it; wanted {wanted}.")
    paths, notes = _of_one_kind(paths)
    headers, errors = dict[Path, PhotoHeader](), list[PhotoFileError]()
    for path in paths[::every]:
        try:
            headers[path] = load_header(path)
        except PhotoFileError as error:
            errors.append(error)
    if not headers:
        raise errors[0]
    flat = {path: one for path, one in headers.items() if one.bits == 8}
    if 0 < len(flat) < len(headers):
        names = list_names([path.name for path in headers if path not in flat], MAX_NAMED)
        found = f"{len(headers) - len(flat):,} images of 16 bits among others are left out"
        headers, notes = flat, (*notes, f"{found}: {names}.")
    kept = list(headers)
    first = headers[kept[0]]
    refuse_frames(InputFile(kept[0], [], PhotoFileError), first.width, first.height)
    for path, one in headers.items():
        if (one.width, one.height) != (first.width, first.height):
            sides = f"{one.width}x{one.height} px"
            found = f"{sides}, and {kept[0].name} has {first.width}x{first.height} px"
            raise PhotoFileError(f"{path.name}: {found}; give frames of one size.")
        if one.orientation != first.orientation:
            found = f"its EXIF turns it otherwise than {kept[0].name}"
            raise PhotoFileError(f"{path.name}: {found}; give frames of a camera held one way.")
    notes += _gap_notes(paths)
    if errors:
        reasons = list_names([str(error).rstrip(".") for error in errors], MAX_NAMED)
        notes += (f"{len(errors)} of {len(paths[::every])} frames are left out: {reasons}.",)
    record = load_record(paths[0].parent)
    times, known = (record.times_s, record.sha256s) if record else ({}, {})
    times_s = tuple(times.get(path.name) for path in kept) if record else _seconds_of(kept)
    sha256s = tuple(known.get(path.name) for path in kept)
    return ImageSequence(name, tuple(kept), times_s, sha256s, notes)


def _seconds_of(paths: Sequence[Path]) -> tuple[float | None, ...]:
    """Times from the first frame, s, where the names are numbers of seconds with a fraction."""
    pattern = _numbers_of(paths)
    numbers = [pattern.findall(path.stem) for path in paths]
    if any(len(own) != 1 for own in numbers) or not any("." in own for (own,) in numbers):
        return (None,) * len(paths)
    first = Decimal(numbers[0][0])
    times = [float(Decimal(own) - first) for (own,) in numbers]
    return tuple(times) if np.all(np.diff(times) > 0.0) else (None,) * len(paths)


def _gap_notes(paths: Sequence[Path]) -> tuple[str, ...]:
    """Return a sentence on numbers that are missing from the files' names, or none."""
    pattern = _numbers_of(paths)
    found = [pattern.findall(path.stem) for path in paths]
    numbers = [own[-1] for own in found if own and "." not in own[-1]]
    if len(numbers) < max(len(paths), 3):
        return ()
    steps = np.diff(np.array(numbers, float))
    gaps = np.flatnonzero(steps > np.median(steps))
    if not 0 < len(gaps) <= 0.1 * len(paths) + 1:  # else the numbers count something else
        return ()
    before, after = (paths[int(gaps[0]) + one].name for one in (0, 1))
    more = f", and at {len(gaps) - 1} more places" if len(gaps) > 1 else ""
    return (f"A frame is missing between {before} and {after}{more}; the others go on after it.",)
