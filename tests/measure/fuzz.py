"""Mutants of good files, and what their readers say: ``python -m tests.measure.fuzz --seconds 60``.

``fuzz_corpus.zip`` holds ``READER/NUMBER/FILE``: small good files, the first one opened and the
others beside it. A finding is whatever is no sentence for the user (a ``PoseViewerError``): another
exception, a warning, more than 2 s of processor time, more than 1 GB, a crash. Exit code 1 on a
finding; a mutant follows from the seed, the reader's name and its number.
"""

import argparse
import multiprocessing
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from pathlib import Path, PurePosixPath
from zipfile import ZipFile

from poseviewer.app.page.reports import meaning_of
from poseviewer.app.state.edits import Edit, update
from poseviewer.batch.job_table import load_jobs
from poseviewer.errors import MeshFileError, PoseViewerError
from poseviewer.files.cameras import load_cameras
from poseviewer.files.checks import InputFile, quiet_libraries
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.marks import load_pairs
from poseviewer.files.masks import load_mask
from poseviewer.files.mesh.dae import read_dae
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.surface import as_mesh
from poseviewer.files.mesh.three_mf import read_3mf
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import load_scene
from poseviewer.files.state.session_file import load_autosave
from poseviewer.files.symmetry import load_symmetry
from poseviewer.opening import uploads
from poseviewer.opening.photo_sets import SetChoice, load_views
from poseviewer.opening.sources import files_below, sort_set
from poseviewer.scene.settings import FitSettings
from tests.app.state.documents import BUMPY, CAR, make_session
from tests.writing import write

CORPUS = Path(__file__).with_name("fuzz_corpus.zip")
MAX_SECONDS = 2
"""Processor time of a mutant, in s."""
STALL_SECONDS = 60
"""Time of a mutant, in s."""
MAX_BYTES = 1 << 30
"""Memory beyond what the process has at first."""
PHOTO_SIZE = 160, 120
NUMBER = re.compile(rb"-?\d+(\.\d*)?([eE][-+]?\d+)?")
ODD_NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e999", b"nan", b"NaN", b"Infinity", b"inf",
    b"2147483648", b"4294967295", b"9223372036854775808", b"1" + b"0" * 400, b"1e9", b"0.1",
    b"1" + b"0" * 5000, b"null", b"true", b'"1"', b"[]", b"{}",
)  # fmt: skip
ODD_BYTES = (
    b"\0", b"\xff", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x1b[2J", b"\\ud800", b"\n",
    "\u202e".encode(), b"[" * 2000, b" " * 1000, b"a" * 200_000, b"\xed\xa0\x80", b'"', b",", b"-",
)  # fmt: skip

Files = dict[str, bytes]
"""Contents by file name, the first one opened."""
Reader = Callable[[Path], object]


def read_format(name: str, in_folder: bool = False) -> Reader:
    """Reader of one of the formats of ``poseviewer convert``."""

    def read(path: Path) -> None:
        options = ConvertOptions(photo_size=PHOTO_SIZE if name == "bop" else None)
        with InputFile(path, kind=f"{name} file").naming_errors():
            FORMATS[name].read(path.parent if in_folder else path, options)

    return read


def read_report(path: Path) -> None:
    """Do what a page's script asks for."""
    meaning = meaning_of(path.read_bytes().decode("utf-8", "replace"))
    if isinstance(meaning, Edit):
        update(make_session(), meaning)


def read_model(path: Path) -> None:
    """Read a DAE, or a 3MF whose XML is given, in this process, which is quicker than its own."""
    if path.suffix == ".model":
        with ZipFile(path.with_suffix(".3mf"), "w") as archive:
            archive.write(path, "3D/3dmodel.model")
    reader = read_dae if path.suffix == ".dae" else read_3mf
    with InputFile(path, [], MeshFileError, "model file").naming_errors(), quiet_libraries():
        parts, notes, *_ = reader(path.with_suffix(".3mf" if reader == read_3mf else ".dae"))
        as_mesh(path.name, parts, notes)


READERS: dict[str, Reader] = {
    "mesh": load_mesh,
    "dae": read_model,
    "3mf": read_model,
    "photo": load_photo,
    "mask": load_mask,
    "pose": lambda path: load_pose(path, *PHOTO_SIZE),
    "scene": load_scene,
    "views": load_views,
    "views_in_folder": lambda path: load_views(path.parent),
    "views_about_object": lambda path: load_views(path.parent, SetChoice(rig_object=5)),
    "cameras": load_cameras,
    "keypoints": lambda path: load_keypoints(path.with_name("m.glb"), BUMPY),
    "symmetry": lambda path: load_symmetry(path.with_name("m.glb"), CAR),
    "pairs": load_pairs,
    "jobs": lambda path: load_jobs(path, FitSettings()),
    "autosave": load_autosave,
    "upload": lambda path: sort_set(
        files_below(uploads.keep_set(path.parent / "u", path.read_bytes()))
    ),
    "page": read_report,
    **{f"{name}_pose": read_format(name) for name in ("opencv", "nerfstudio", "gltf")},
    "meshlab_pose": read_format("meshlab"),
    "colmap_pose": read_format("colmap", in_folder=True),
    "bop_pose": read_format("bop", in_folder=True),
}


@lru_cache(maxsize=1)
def load_corpus() -> dict[str, list[Files]]:
    """Good files by the name of their reader."""
    groups: dict[tuple[str, str], Files] = {}
    with ZipFile(CORPUS) as archive:
        for name in archive.namelist():
            reader, number, *rest = PurePosixPath(name).parts
            groups.setdefault((reader, number), {})["/".join(rest)] = archive.read(name)
    corpus: dict[str, list[Files]] = {}
    for (reader, _), files in groups.items():
        corpus.setdefault(reader, []).append(files)
    return corpus


def make_mutant(name: str, seed: int, number: int) -> Files:
    """Good files of which one, mostly the first, is changed in a few ways."""
    chance = random.Random(f"{seed}/{name}/{number}")
    files = dict(chance.choice(load_corpus()[name]))
    target = next(iter(files)) if chance.random() < 0.6 else chance.choice(list(files))
    for _ in range(chance.choice((1, 1, 1, 2, 3, 8))):
        files[target] = _change(chance, files[target], list(files.values()))
    return files


def _change(chance: random.Random, data: bytes, others: list[bytes]) -> bytes:
    start = chance.randrange(len(data) + 1)
    end = start + int(2 ** chance.uniform(0, 12))
    head = data[:start]
    part = data[start:end]
    tail = data[end:]
    numbers = list(NUMBER.finditer(data[:1_000_000]))
    match chance.randrange(9):
        case 0:
            return head
        case 1:
            return head + tail
        case 2:
            return head + part * chance.choice((2, 4, 300)) + tail
        case 3:
            return head + chance.choice(ODD_BYTES) + part + tail
        case 4:
            other = chance.choice(others)
            return head + other[chance.randrange(len(other) + 1) :]
        case 5:
            return head + bytes([chance.choice((0, 1, 127, 128, 255))]) * len(part) + tail
        case 6 | 7 if numbers:
            found = chance.choice(numbers)
            return data[: found.start()] + chance.choice(ODD_NUMBERS) + data[found.end() :]
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 5, 20)) if data else 0):
        changed[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def write_files(folder: Path, files: Files) -> Path:
    """Write files into an empty folder; returns the path of the first."""
    shutil.rmtree(folder, ignore_errors=True)
    first, *_ = [write(folder / name, data) for name, data in files.items()]
    return first


def judge(read: Reader, path: Path) -> str:
    """What is wrong with how a reader takes a file; empty if nothing is."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            read(path)
        except PoseViewerError as error:
            if isinstance(error.__cause__, MemoryError):
                return f"more than {MAX_BYTES:,} bytes"
            if not (str(error).isprintable() and 10 < len(str(error)) < 1100):
                return f"no sentence: {str(error)!r}"
        except BaseException as error:  # noqa: BLE001 - that is what is looked for
            return f"{type(error).__name__}: {str(error)[:200]}"
    return f"warned: {warned[0].message}" if warned else ""


def _limit_memory() -> None:
    held = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (held + MAX_BYTES, resource.RLIM_INFINITY))


def _try_mutant(name: str, seed: int, number: int, folder: Path) -> str:
    """Judge a mutant; one that takes too long ends the process by a signal of its timers."""
    path = write_files(folder / "mutant", make_mutant(name, seed, number))
    signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
    signal.setitimer(signal.ITIMER_REAL, STALL_SECONDS)
    try:
        return judge(READERS[name], path)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)


def fuzz(name: str, seed: int, seconds: float, keep: Path | None = None) -> int:
    """Give a reader mutants, in a process of its own, and print the findings; returns how many."""
    number, findings = 0, set[str]()
    began = time.monotonic()
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as made:
        while time.monotonic() - began < seconds:
            with ProcessPoolExecutor(1, context, _limit_memory) as pool:
                finding = ""
                while time.monotonic() - began < seconds and not finding:
                    try:
                        finding = pool.submit(_try_mutant, name, seed, number, Path(made)).result()
                    except BrokenProcessPool:
                        finding = f"a crash, {MAX_SECONDS} s of computing, or {STALL_SECONDS} s"
                    number += 1
            if finding and NUMBER.sub(b"", finding.encode()).decode() not in findings:
                findings.add(NUMBER.sub(b"", finding.encode()).decode())
                print(f"{name} {number - 1}: {finding}", flush=True)
                if keep is not None:
                    files = make_mutant(name, seed, number - 1)
                    write_files(keep / f"{name}-{number - 1}", files)
    print(f"{name:16} {number:7,} mutants, {len(findings)} findings", flush=True)
    return len(findings)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--readers", nargs="*", default=READERS, choices=READERS, help="(all)")
    parser.add_argument("--seconds", type=float, default=600.0, help="for all readers together")
    parser.add_argument("--seed", type=int, help="(a new one, which is printed)")
    parser.add_argument("--keep", type=Path, help="a folder for what is found")
    options = parser.parse_args()
    uploads.MIN_UPLOADS, uploads.OLD_S = 1, 0.0  # the disk is small
    seed = random.SystemRandom().randrange(1 << 32) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    seconds = options.seconds / len(options.readers)
    found = [fuzz(name, seed, seconds, options.keep) for name in options.readers]
    return int(any(found))


if __name__ == "__main__":
    sys.exit(main())
