"""The random driver of the page drives, and finds what is wrong."""

import logging

import pytest

from tests.measure import drive


@pytest.mark.slow
def test_a_warning_in_the_log_is_found(monkeypatch) -> None:
    def warn(_: drive.Driver) -> str:
        logging.getLogger("poseviewer").warning("a worker failed")
        return "warned"

    monkeypatch.setattr(drive, "ACTS", {"warn": (1, warn)})
    monkeypatch.setattr(drive, "ROUND_ACTS", 1)
    assert drive.drive(seed=1, seconds=0.0, on="still") == ["the log says: a worker failed"]


def test_values_that_differ_are_found() -> None:
    assert drive.unlike({"a": "1", "b": True}, {"a": "1", "b": True, "c": "2"}) == []
    assert drive.unlike({"a": "1", "b": True}, {"a": "2", "b": True}) == ["a: '1', '2'"]
