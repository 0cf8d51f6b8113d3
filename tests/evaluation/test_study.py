"""A small study from the command line to its figure, and taken up again."""

import shutil

import pytest

from poseviewer.files.photo import load_photo
from tests.commands import read_rows, run
from tests.renderers import require_opengl
from tests.vehicles import save_vehicle


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    require_opengl()
    return save_vehicle(tmp_path_factory.mktemp("model"))


def run_study(model, out, more: str = "") -> int:
    line = "study --starts 1 --deviations 1,8 --size 96x72 --evaluations 60 --kinds plain --quiet"
    return run(f"{line} --jobs 1 {more}", "--out", out, "--model", model)


@pytest.fixture(scope="module")
def study(model, tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    assert run_study(model, out) == 0
    assert run_study(model, out, "--paper") == 0
    return out


@pytest.mark.slow
@pytest.mark.long
def test_there_is_a_row_for_every_trial_and_a_report(study):
    rows = read_rows(study / "trials.csv")
    by_method = [(row["method"], row["pixels"]) for row in rows]
    assert by_method == [("default", "near")] * 4 + [("paper", "whole")] * 4
    for row, same in zip(rows[:4], rows[4:], strict=True):
        assert float(row["error_px_start"]) > 0.0
        assert int(row["evaluations"]) == 60
        assert float(row["loss_end"]) <= float(row["loss_start"])
        assert row["found"] == str(float(row["error_px_end"]) < 1.0)
        assert len(row["end"].split()) == 6
        assert row["verdict"] in ("found", "doubtful", "lost")
        assert row["error_px_start"] == same["error_px_start"]  # methods start at one pose
    written = (study / "study.md").read_text()
    assert "paper: synthetic, plain black ground, whole" in written
    assert "](reliability.png)" in written
    assert load_photo(study / "reliability.png").width > 500


@pytest.mark.slow
@pytest.mark.long
def test_a_study_that_was_cut_off_goes_on_also_in_processes(model, study, tmp_path, capsys):
    for name in ("trials.csv", "study.json"):
        shutil.copy(study / name, tmp_path)
    first, rest = (tmp_path / "trials.csv").read_bytes().splitlines(keepends=True)[:2], b"default,"
    (tmp_path / "trials.csv").write_bytes(b"".join(first) + rest)  # in the middle of a row
    assert run_study(model, tmp_path, "--jobs 2") == 0
    assert (tmp_path / "trials.csv").read_bytes().splitlines(keepends=True)[:2] == first

    def known(rows):
        """All but the seconds, in an order of their own."""
        return sorted(sorted((k, v) for k, v in row.items() if k != "seconds") for row in rows)

    assert known(read_rows(tmp_path / "trials.csv")) == known(read_rows(study / "trials.csv")[:4])
    before = (tmp_path / "trials.csv").read_bytes()
    assert run_study(model, tmp_path) == 0
    assert run_study(model, tmp_path, "--size 96x60") == 2
    assert "another study" in capsys.readouterr().err
    assert (tmp_path / "trials.csv").read_bytes() == before


@pytest.mark.slow
@pytest.mark.long
def test_real_backgrounds_and_photos_of_cars(tmp_path):
    require_opengl()
    line = "study --kinds background,photo-parallel,photo-perspective --starts 1 --deviations 4"
    more = "--jobs 1 --readings relative --size 96x72 --evaluations 25 --quiet"
    assert run(f"{line} {more}", "--out", tmp_path) == 0
    parameters = {row["set"]: len(row["end"].split()) for row in read_rows(tmp_path / "trials.csv")}
    assert parameters == {"background": 6, "photo-parallel": 6, "photo-perspective": 7}
