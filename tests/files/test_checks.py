"""Files are opened, numbers taken, and errors worded alike by all readers."""

import logging
import struct
import sys
from pathlib import Path

import pytest

from poseviewer.errors import MAX_MESSAGE as MAX_S
from poseviewer.errors import PoseFileError, PoseViewerError, printable, sentence_of
from poseviewer.files.checks import InputFile, kind_of

NASTY = "a\x1b[2Jb\x07\u202ec\udce4\n d\x9b31m"


def test_names_do_no_harm_to_a_terminal() -> None:
    assert printable(NASTY) == "a?[2Jb??c? d?31m"
    assert printable("Straße 道  x") == "Straße 道  x"
    assert len(printable("x" * 5000, 80)) <= 80


def test_every_error_is_one_bounded_line() -> None:
    text = str(PoseViewerError(NASTY + "x" * 100_000))
    assert text.isprintable()
    assert len(text) <= MAX_S
    text.encode()


@pytest.mark.parametrize(("error", "words"), [
    (PoseFileError("p.json: an empty file; copy it again."), "p.json: an empty file"),
    (MemoryError(), "not enough memory"),
    (OSError(28, "No space left on device", "/x/\x1b"), "/x/?: No space left"),
    (KeyError("x" * 100_000), "Something went wrong inside (KeyError: 'xxx"),
])  # fmt: skip
def test_every_error_becomes_a_sentence(error: Exception, words: str) -> None:
    text = sentence_of(error)
    assert words in text
    assert text.isprintable()
    assert text.endswith(".")
    assert len(text) < 500


def test_what_nobody_foresaw_names_the_file_and_is_in_the_log(tmp_path, caplog):
    caplog.set_level(logging.DEBUG, "poseviewer")
    with (
        pytest.raises(PoseFileError, match=r"^p\.json: not a readable pose file; .*\.$"),
        InputFile(tmp_path / "p.json").naming_errors(),
    ):
        raise IndexError("boom")
    assert "IndexError: boom" in caplog.text
    assert caplog.records[0].exc_info


@pytest.mark.parametrize("error", [
    IndexError("list index out of range"), KeyError("K"), struct.error("cannot fit 'int' into"),
    ValueError("could not convert string to float: 'a'"), TypeError("'int' object"),
    ValueError("not enough values to unpack (expected 2, got 1)"), ZeroDivisionError("division"),
])  # fmt: skip
def test_what_python_says_never_reaches_the_user(tmp_path, error):
    with pytest.raises(PoseFileError) as raised, InputFile(tmp_path / "p.json").naming_errors():
        raise error
    assert str(raised.value) == "p.json: not a readable pose file; is it whole? Make it again."


@pytest.mark.skipif(sys.platform == "win32", reason="no such devices")
@pytest.mark.parametrize("path", ["/dev/zero", "/dev/stdin", "/dev/null"])
def test_devices_are_not_read(path: str) -> None:
    with pytest.raises(PoseFileError, match=r"a pipe or a device|an empty file"):
        InputFile(Path(path)).load_bytes()


def test_names_that_no_file_can_have(tmp_path: Path) -> None:
    for name in ("x" * 100_000, "a\0b", "d\udce4.json"):
        with pytest.raises(PoseFileError, match=r"no such file|cannot be read") as caught:
            InputFile(tmp_path / name).load_bytes()
        assert len(str(caught.value)) < 600


def test_values_are_quoted_in_short() -> None:
    for value in ("x" * 100_000, 10**5000, [1] * 100_000, {"a": 1}, NASTY):
        assert len(kind_of(value)) < 100
        assert kind_of(value).isprintable()
