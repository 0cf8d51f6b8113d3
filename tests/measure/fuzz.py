"""Mutants of good inputs, and what the readers make of them: ``python -m tests.measure.fuzz``.

Each reader (``fuzz_readers``) gets ``--count`` mutants, or as many as fit in its share of
``--seconds``. What is no sentence for the user (``PoseViewerError``) is a finding: another
exception, a warning, more than 2 s of processor time, more than 1 GB, a crash. Findings are kept in
``--keep``; a mutant is made from the seed, the reader's name and its own number alone.

With ``--guided`` what is tried next goes by what the tries before reached in our code and in
trimesh (atheris, an extra: ``pip install -e '.[fuzz]'``).
"""

from __future__ import annotations

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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType, FunctionType
from typing import Any

from poseviewer.errors import PoseViewerError
from tests.measure.fuzz_readers import Files, Reader, make_readers

MOST_S, MOST_BYTES = 2.0, 1 << 30
"""Processor time of one mutant, and memory beside what the process has at first."""
PATIENCE_S = 60.0
"""A reader that says nothing for so long is ended from outside."""
NUMBER = re.compile(rb"-?\d+(\.\d*)?([eE][-+]?\d+)?")
WATCHED = "poseviewer.files", "trimesh.exchange"
"""Modules whose branches guide what is tried next."""
ODD_NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e999", b"nan", b"NaN", b"Infinity", b"inf",
    b"2147483648", b"4294967295", b"9223372036854775808", b"1" + b"0" * 400, b"1e9", b"0.1",
    b"1" + b"0" * 5000, b"null", b"true", b'"1"', b"[]", b"{}",
)  # fmt: skip
ODD_BYTES = (
    b"\0", b"\xff", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x1b[2J", b"\\ud800", b"\n",
    "\u202e".encode(), b"[" * 2000, b" " * 1000, b"a" * 200_000, b"\xed\xa0\x80", b'"', b",", b"-",
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """A mutant that a reader made something else of than it should."""

    reader: str
    number: int
    found: str


def mutant(seeds: Sequence[Files], name: str, seed: int, number: int) -> Files:
    """The files of a mutant; the first is the one that was changed."""
    chance = random.Random(f"{seed}/{name}/{number}")
    files = dict(chance.choice(seeds))
    first = next(iter(files))
    data = files[first]
    for _ in range(chance.choice((1, 1, 1, 2, 3, 8))):
        data = _changed(chance, data, files)
    files[first] = data
    return files


def _changed(chance: random.Random, data: bytes, files: Files) -> bytes:
    at = chance.randrange(len(data) + 1)
    end = min(len(data), at + int(2 ** chance.uniform(0, 12)))
    match chance.randrange(10):
        case 0:
            return data[:at]
        case 1:
            return data[:at] + data[end:]
        case 2:
            return data[:end] + data[at:end] * chance.choice((1, 1, 3, 300)) + data[end:]
        case 3:
            return data[:at] + chance.choice(ODD_BYTES) + data[at:]
        case 4:
            other = chance.choice(list(files.values()))
            return data[:at] + other[chance.randrange(len(other) + 1) :]
        case 5 | 6:
            numbers = list(NUMBER.finditer(data[:1_000_000]))
            if numbers:
                found = chance.choice(numbers)
                odd = chance.choice(ODD_NUMBERS)
                return data[: found.start()] + odd + data[found.end() :]
        case 7:
            odd = chance.choice((0, 1, 127, 128, 255, chance.randrange(256)))
            return data[:at] + bytes([odd]) * (end - at) + data[end:]
        case _:
            pass
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        if changed:
            changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


class TooLongError(BaseException):
    """No ``Exception``: what reads is not to catch it."""


def _stop(number: int, frame: FrameType | None) -> None:
    del number, frame
    raise TooLongError


def _write(folder: Path, files: Files) -> None:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def judge(reader: Reader, files: Files, folder: Path) -> str:
    """What is wrong with what the reader makes of the files, written into ``folder``; "" if
    nothing is.
    """
    shutil.rmtree(folder, ignore_errors=True)
    _write(folder, files)
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            signal.setitimer(signal.ITIMER_PROF, MOST_S)
            try:
                reader.read(folder / next(iter(files)))
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
    except PoseViewerError as error:
        sentence = str(error)
        if isinstance(error.__cause__, MemoryError):
            return f"more than {MOST_BYTES:,} bytes"
        if not (sentence.isprintable() and 10 < len(sentence) < 1100):
            return f"no sentence: {sentence!r}"
    except TooLongError:
        return f"more than {MOST_S:g} s"
    except BaseException as error:  # noqa: BLE001 - that is what is looked for
        return f"{type(error).__name__}: {str(error)[:200]}"
    return f"warned: {warned[0].message}" if warned else ""


def _work(
    name: str, reader: Reader, seed: int, numbers: range, until: float, folder: Path,
    news: Connection,
) -> None:  # fmt: skip
    """Judge mutants, in a process of its own; say which one is under way, and what was found."""
    signal.signal(signal.SIGPROF, _stop)
    held = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (held + MOST_BYTES, resource.RLIM_INFINITY))
    for number in numbers:
        if time.monotonic() > until:
            break
        news.send((number, None))
        files = mutant(reader.seeds, name, seed, number)
        found = judge(reader, files, folder / "mutant")
        if found:
            news.send((number, found))
    news.send((-1, None))


def fuzz(
    name: str, reader: Reader, seed: int, count: int, seconds: float, keep: Path | None = None
) -> list[Finding]:
    """Give a reader its mutants; prints what is found, and how many there were."""
    findings: list[Finding] = []

    def note(number: int, found: str) -> None:
        files = mutant(reader.seeds, name, seed, number)
        findings.append(_kept(Finding(name, number, found), files, keep))

    done, start, until = 0, time.monotonic(), time.monotonic() + seconds
    context = multiprocessing.get_context("fork")  # what reads need not be imported each time
    while 0 <= done < count and time.monotonic() < until:
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            ours, theirs = context.Pipe(duplex=False)
            numbers = range(done, count)
            process = context.Process(
                target=_work, args=(name, reader, seed, numbers, until, folder, theirs)
            )
            process.start()
            theirs.close()
            try:
                while ours.poll(PATIENCE_S):
                    number, found = ours.recv()
                    if number < 0:
                        count = done
                        break
                    done = number + 1
                    if found:
                        note(number, found)
                else:
                    note(done - 1, "no end")
            except EOFError:
                process.join()
                ended = f"the process ended ({process.exitcode})"
                note(done - 1, ended)
            process.kill()
            process.join()
    spent = time.monotonic() - start
    print(f"{name:16} {done:7,} mutants, {len(findings)} findings, {spent:.0f} s", flush=True)
    return findings


def fuzz_guided(
    name: str, reader: Reader, seed: int, count: int, seconds: float, keep: Path | None = None
) -> list[Finding]:
    """Give a reader mutants of its first files that reach ever more of the code."""
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as made:
        ours, theirs = context.Pipe(duplex=False)
        folder = Path(made)
        arguments = (reader, seed, count, seconds, folder, theirs)
        process = context.Process(target=_work_guided, args=arguments)
        process.start()
        theirs.close()
        findings, known, done = [], set[str](), 0
        while True:
            try:
                done, found, files = ours.recv()
            except EOFError:
                break
            if found and NUMBER.sub(b"", found.encode()).decode() not in known:
                known.add(NUMBER.sub(b"", found.encode()).decode())
                findings.append(_kept(Finding(name, done, found), files, keep))
        process.join()
        for left in sorted(folder.glob("artifact-*")):  # of a try that the fuzzer ended itself
            ended = f"the process ended ({process.exitcode})"
            files = {**reader.seeds[0], next(iter(reader.seeds[0])): left.read_bytes()}
            findings.append(_kept(Finding(name, done, ended), files, keep))
    print(f"{name:16} {done:7,} guided mutants, {len(findings)} findings", flush=True)
    return findings


def _work_guided(
    reader: Reader, seed: int, count: int, seconds: float, folder: Path, news: Connection
) -> None:
    """In a process of its own, which the fuzzer ends."""
    atheris: Any = import_module("atheris")  # an extra

    signal.signal(signal.SIGPROF, _stop)
    for function in _functions():
        atheris.instrument_func(function)
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, files in enumerate(reader.seeds):
        (corpus / f"{number}").write_bytes(next(iter(files.values())))
    first, *_ = reader.seeds
    done = 0

    def one(data: bytes) -> None:
        nonlocal done
        done += 1
        files = {**first, next(iter(first)): data}
        found = judge(reader, files, folder / "mutant")
        if found or done % 100 == 0:
            news.send((done, found, files if found else {}))

    limits = f"-max_total_time={max(round(seconds), 1)}", f"-runs={count}", "-max_len=20000"
    quiet = "-verbosity=0", "-rss_limit_mb=0", "-timeout=60", f"-artifact_prefix={folder}/artifact-"
    atheris.Setup([sys.argv[0], str(corpus), f"-seed={seed % (1 << 31)}", *limits, *quiet], one)
    atheris.Fuzz()


def _functions() -> Iterator[FunctionType]:
    """Those of the ``WATCHED`` modules, and of their classes."""
    for name, module in list(sys.modules.items()):
        if not name.startswith(WATCHED):
            continue
        for held in [*vars(module).values()]:
            inside = vars(held).values() if isinstance(held, type) else (held,)
            for one in inside:
                function = one.__func__ if isinstance(one, classmethod | staticmethod) else one
                if type(function) is FunctionType and function.__module__ == name:
                    yield function


def _kept(found: Finding, files: Files, keep: Path | None) -> Finding:
    print(f"{found.reader} {found.number}: {found.found}", flush=True)
    if keep is not None:
        place = keep / f"{found.reader.replace(' ', '-')}-{found.number}"
        _write(place, files)
    return found


def main() -> int:
    """Fuzz; exit code 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--readers", nargs="*", help="(all)")
    parser.add_argument("--count", type=int, default=20_000, help="of each reader")
    parser.add_argument("--seconds", type=float, help="for all readers together")
    parser.add_argument("--seed", type=int, help="(a new one, which is printed)")
    parser.add_argument("--guided", action="store_true", help="by what is reached (atheris)")
    parser.add_argument("--keep", type=Path, help="a folder for what is found")
    options = parser.parse_args()
    seed = random.SystemRandom().randrange(1 << 32) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        readers = make_readers(Path(folder))
    names = options.readers or list(readers)
    end = time.monotonic() + (options.seconds or float("inf"))
    findings: list[Finding] = []
    for at, name in enumerate(names):
        share = (end - time.monotonic()) / (len(names) - at)
        run = fuzz_guided if options.guided else fuzz
        findings += run(name, readers[name], seed, options.count, share, options.keep)
    return int(bool(findings))


if __name__ == "__main__":
    sys.exit(main())
