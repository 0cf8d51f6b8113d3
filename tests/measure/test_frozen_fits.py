"""The table of frozen fits: the same again is equal, and what differs is said."""

import json

import pytest

from tests.measure import frozen_fits


@pytest.mark.slow
def test_fits_made_again_are_equal_and_what_differs_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(frozen_fits, "DATA", tmp_path)
    table = tmp_path / "table.json"
    few = ["--only", "demo-perspective-grey"]
    assert frozen_fits.main(["--write", str(table), *few]) == 0
    assert frozen_fits.main(["--compare", str(table), *few]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "equal"
    kept = json.loads(table.read_text())
    (ending,) = kept.values()
    ending |= {"loss": ending["loss"] + 1.0, "verdict": "sure"}
    ending["translation"][0] += 1e-9
    table.write_text(json.dumps(kept))
    assert frozen_fits.main(["--compare", str(table), *few]) == 1
    *_, head, line = capsys.readouterr().out.splitlines()
    assert head == "1 of 1 differ:"
    for words in (
        "demo-perspective-grey: translation",
        "of the distance",
        "loss",
        "verdict sure ->",
    ):
        assert words in line
    assert "rotation" not in line
