"""The table of frozen fits: the same again is equal, and what differs is said."""

from __future__ import annotations

import json

import pytest

from tests.measure import frozen_fits


@pytest.mark.slow
def test_fits_made_again_are_equal_and_what_differs_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("POSEVIEWER_DATA", str(tmp_path))
    table = tmp_path / "table.json"
    few = ["--only", "demo-parallel", "--evaluations", "30"]
    assert frozen_fits.main(["--write", str(table), *few]) == 0
    assert "no real data" in capsys.readouterr().out
    assert frozen_fits.main(["--compare", str(table), *few]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "equal"
    kept = json.loads(table.read_text())
    kept["demo-parallel"] |= {"loss": kept["demo-parallel"]["loss"] + 1.0, "verdict": "sure"}
    kept["demo-parallel"]["translation"][0] += 1e-9
    table.write_text(json.dumps(kept))
    assert frozen_fits.main(["--compare", str(table), *few]) == 1
    *_, head, line = capsys.readouterr().out.splitlines()
    assert head == "1 of 1 differ:"
    for words in ("demo-parallel: translation", "of the distance", "loss", "verdict sure ->"):
        assert words in line
    assert "rotation" not in line


def test_a_table_that_is_not_there_is_said(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        frozen_fits.main(["--compare", str(tmp_path / "none.json")])
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.endswith("none.json: there is no such table; make it with --write")
