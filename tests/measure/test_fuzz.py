"""The corpus is good, and what is no sentence for the user is a finding."""

import warnings
from pathlib import Path

import pytest

from poseviewer.errors import PoseFileError
from tests.measure.fuzz import READERS, fuzz, judge, load_corpus, write_files


@pytest.mark.parametrize("name", READERS)
def test_good_files_are_read(tmp_path: Path, name: str) -> None:
    for number, files in enumerate(load_corpus()[name]):
        READERS[name](write_files(tmp_path / str(number), files))
    assert load_corpus().keys() == READERS.keys()


def raise_error(error: Exception) -> None:
    raise error


@pytest.mark.parametrize(
    ("read", "finding"),
    [
        (lambda _: None, ""),
        (lambda path: raise_error(PoseFileError(f"{path.name}: is no pose; name another")), ""),
        (lambda _: raise_error(PoseFileError("no")), "no sentence"),
        (lambda _: raise_error(KeyError("camera")), "KeyError: 'camera'"),
        (lambda _: warnings.warn("divided by zero", RuntimeWarning, 1), "warned: divided by zero"),
    ],
)
def test_a_finding_is_what_is_no_sentence(tmp_path: Path, read, finding: str) -> None:
    said = judge(read, tmp_path / "a.json")
    assert said.startswith(finding)
    assert bool(said) == bool(finding)


@pytest.mark.slow
def test_a_reader_that_does_not_end_is_found(monkeypatch, capsys) -> None:
    def spin(path: Path) -> None:
        while path:
            pass

    monkeypatch.setitem(READERS, "pose", spin)
    assert fuzz("pose", 1, 1.0) == 1
    assert "2 s of computing" in capsys.readouterr().out
