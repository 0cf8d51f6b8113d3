"""A small study from the command line to its figure, and taken up again."""

from __future__ import annotations

import csv
import shutil

import pytest

from poseviewer.cli import main as cli
from poseviewer.files.photo import load_photo
from tests.opengl import require_opengl
from tests.vehicles import save_vehicle

OUTPUTS = ("trials.csv", "study.md", "study.png", "study.json")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    require_opengl()
    return save_vehicle(tmp_path_factory.mktemp("model"))


def run(model, out, *more) -> int:
    options = ["--starts", 1, "--deviations", "1,8", "--size", "96x72", "--evaluations", 60,
               "--model", model, "--kinds", "plain", "--quiet", "--jobs", 1]  # fmt: skip
    return cli.main([str(x) for x in ("study", "--out", out, *options, *more)])


def rows_of(out) -> list[dict[str, str]]:
    with (out / "trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def known(rows):
    """All but how long it took, in an order of their own."""
    return sorted(sorted((k, v) for k, v in row.items() if k != "seconds") for row in rows)


@pytest.fixture(scope="module")
def study(model, tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    assert run(model, out) == 0
    assert run(model, out, "--method", "paper") == 0
    assert {row["pixels"] for row in rows_of(out)} == {"near", "whole"}
    assert run(model, out, "--method", "paper", "--pixels", "clip") == 0
    return out


@pytest.mark.slow
def test_there_is_a_row_for_every_trial(study):
    rows = rows_of(study)
    by_method = [(row["method"], row["pixels"]) for row in rows]
    assert len(rows) == 12
    assert {pair: by_method.count(pair) for pair in by_method} == {
        ("default", "near"): 4, ("paper", "whole"): 4, ("paper", "clip"): 4,
    }  # fmt: skip
    for row in rows:
        assert float(row["error_px_start"]) > 0.0
        assert int(row["evaluations"]) == 60
        assert float(row["loss_end"]) <= float(row["loss_start"])
        assert row["found"] == str(float(row["error_px_end"]) < 1.0)
        assert len(row["start"].split()) == len(row["truth"].split()) == 6
        assert row["verdict"] in ("found", "doubtful", "lost")


@pytest.mark.slow
def test_methods_start_at_the_same_places(study):
    starts: dict[tuple[str, ...], set[str]] = {}
    for row in rows_of(study):
        where = row["reading"], row["percent"], row["draw"]
        starts.setdefault(where, set()).add(row["start"])
    assert len(starts) == 4
    assert all(len(found) == 1 for found in starts.values())


def test_starts_are_as_far_off_as_is_said(study):
    for row in rows_of(study):
        if row["reading"] == "relative":
            pairs = zip(row["start"].split(), row["truth"].split(), strict=True)
            share = float(row["percent"]) / 100.0
            assert all(abs(float(a) / float(b) - 1.0) <= share + 1e-12 for a, b in pairs)


def test_it_ends_in_a_table_and_a_figure(study):
    assert {name for name in OUTPUTS if (study / name).is_file()} == set(OUTPUTS)
    text = (study / "study.md").read_text()
    assert "paper: synthetic, plain black ground, whole" in text
    assert "study.png" in text
    assert load_photo(study / "study.png").width > 1000


def test_rows_that_are_there_are_not_run_again(model, study, capsys):
    before = (study / "trials.csv").read_bytes()
    assert run(model, study) == 0
    assert (study / "trials.csv").read_bytes() == before
    assert "default: synthetic, plain black ground" in capsys.readouterr().out


@pytest.mark.slow
def test_a_study_that_was_cut_off_goes_on_where_it_was_also_in_processes(model, study, tmp_path):
    for name in ("trials.csv", "study.json"):
        shutil.copy(study / name, tmp_path)
    whole = b"".join((tmp_path / "trials.csv").read_bytes().splitlines(keepends=True)[:5])
    kept = whole[: whole.index(b"\n", len(whole) // 2) - 5]  # in the middle of a row
    (tmp_path / "trials.csv").write_bytes(kept)
    lines = kept.count(b"\n")
    assert 1 < lines < 4
    assert run(model, tmp_path, "--jobs", 2) == 0
    after = (tmp_path / "trials.csv").read_bytes()
    assert after.splitlines()[:lines] == kept.splitlines()[:lines]
    assert known(rows_of(tmp_path)) == known(rows_of(study)[:4])


def test_more_starts_are_added_to_those_there(model, tmp_path):
    few = ["--deviations", "2", "--readings", "absolute"]
    assert run(model, tmp_path, *few) == 0
    first = rows_of(tmp_path)
    assert run(model, tmp_path, *few, "--starts", 3) == 0
    assert rows_of(tmp_path)[:1] == first
    assert [row["draw"] for row in rows_of(tmp_path)] == ["0", "1", "2"]


@pytest.mark.slow
def test_real_backgrounds_and_photos_of_cars(tmp_path):
    require_opengl()
    assert cli.main(["study", "--out", str(tmp_path), "--kinds",
                     "plain,background,photo-parallel,photo-perspective", "--starts", "1",
                     "--deviations", "4", "--readings", "relative", "--size", "96x72",
                     "--evaluations", "25", "--jobs", "1", "--quiet"]) == 0  # fmt: skip
    rows = {row["kind"]: row for row in rows_of(tmp_path)}
    assert len(rows) == 4
    assert rows["photo-perspective"]["names"].split()[-1] == "width_per_focal"
    assert len(rows["photo-parallel"]["names"].split()) == 6


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--size", "96x60"], "another study"),
        (["--seed", 3], "another study"),
        (["--kinds", "plain,snow"], "snow"),
        (["--readings", "both"], "both"),
        (["--deviations", "1,150"], "150"),
        (["--size", "10x10"], "--size"),
        (["--model", "none.ply"], "none.ply"),
        (["--backgrounds", "none"], "none"),
        (["--cars", "none"], "none"),
        (["--degrees", "5"], "--real"),
        (["--real", "none", "--photos", "3"], "--starts"),
        (["--method", "paper", "--pixels", "near"], "--pixels"),
    ],
)
def test_what_cannot_work_is_said_in_a_line(model, study, capsys, more, said):
    before = (study / "trials.csv").read_bytes()
    assert run(model, study, *more) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert said in message
    assert (study / "trials.csv").read_bytes() == before


@pytest.mark.parametrize("wrong", [["--starts", "0"], ["--deviations", "1,x"], ["--size", "9"]])
def test_wrong_numbers_are_refused(tmp_path, wrong):
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "--out", str(tmp_path), *wrong])
    assert stop.value.code == 2
