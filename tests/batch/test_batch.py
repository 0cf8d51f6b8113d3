"""A batch from its table to its report: all rows, in whatever order, killed and taken up again."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import psutil
import pytest

from poseviewer.batch.job_table import load_jobs
from poseviewer.batch.result_folder import LOCK, STDS, lock_folder
from poseviewer.batch.run import open_batch, run_batch
from poseviewer.cli.terminal import GOES_ON
from poseviewer.errors import BatchError
from poseviewer.files import writing
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import load_pose
from poseviewer.files.writing import OLD_PART_S, open_to_append, write_whole
from poseviewer.geometry.pose_error import pose_error
from poseviewer.scene.settings import FitSettings, Limits
from tests.batches import write_table
from tests.commands import read_rows, refusal, run
from tests.ctrl_c import ctrl_c_ends_them
from tests.scene import Scene
from tests.starts.backbone import save_random_backbone
from tests.view_sets import write_views
from tests.writing import write

QUICK = ("--evaluations", 40)
LONG = ("--evaluations", 150)


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are fitted in this process: how they are handed out to others is tested without this."""
    run_here = "poseviewer.batch.run.run_in_processes"
    monkeypatch.setattr(run_here, lambda function, jobs, *_: ((job, function(job)) for job in jobs))


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "poseviewer.cli.main", *(str(argument) for argument in arguments)]


def kept(out: Path) -> dict[str, bytes]:
    """Files of finished rows; the seconds in it differ from fit to fit."""
    results = {path.name: path.read_bytes() for path in (out / "rows").glob("[!.]*.json")}
    return {name: data for name, data in results.items() if b'"reason": ""' in data}


def wait_until(true, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def workers_of(batch: int) -> list[psutil.Process]:
    """The processes that fit."""
    children = psutil.Process(batch).children()
    return [child for child in children if "spawn_main" in " ".join(child.cmdline())]


@contextmanager
def stopped_by_ctrl_c(line: Sequence[str]) -> Iterator[subprocess.Popen]:
    """Start a command whose processes Ctrl-C ends all at once, as that of a terminal does."""
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with ctrl_c_ends_them():
        process = subprocess.Popen(line, text=True, start_new_session=True, **pipes)
    with process:
        yield process
    assert process.returncode == 130


@pytest.mark.slow
def test_rows_are_fitted_and_bad_ones_fail_with_their_reason(scene, tmp_path, capsys):
    bad = f"gone.png,{scene.model},{scene.start}\nphoto0.png,{scene.model},auto,900 0 9 9\n"
    bad += "photo0.png,,\n"
    table = write_table(scene, tmp_path, 2, bad)
    out = tmp_path / "out"
    assert run("batch", table, "--out", out, "--processes", 2, "--quiet") == 2
    printed = capsys.readouterr()
    assert "2 of 5 rows fitted, 3 failed\nrow 3: " in printed.out
    assert "gone.png: no such file" in printed.out
    assert "(2 others: see the table)" in printed.out
    assert printed.err == ""
    results = read_rows(out / "results.csv")
    assert [row["row"] for row in results] == ["1", "2", "3", "4", "5"]
    reasons = [row["reason"] for row in results]
    assert reasons[:2] == ["", ""]
    assert "gone.png: no such file" in reasons[2]
    assert "box 900,0,9,9: has no 8x8 px" in reasons[3]
    assert "no model" in reasons[4]
    mesh, truth = load_mesh(scene.model), load_pose(scene.truth, 160, 120).pose
    for row in results[:2]:
        found = load_pose(out / row["pose"], 160, 120)
        assert pose_error(mesh, found.pose, truth).reprojection_px < 1.0
        assert found.loss == float(row["loss"]) < float(row["start_loss"])
        assert found.photo.file == row["photo"]
        for name in STDS[:4]:
            deviation = found.covariance.deviations[name.removesuffix("_std")]
            assert float(row[name]) == pytest.approx(deviation, rel=1e-12)  # of a read matrix
            assert deviation > 0.0
        assert [row[name] for name in STDS[4:]] == [""] * 4  # nothing to be searched for
    assert [row["px_std"] for row in results[2:]] == [""] * 3


@pytest.mark.usefixtures("one_process")
def test_the_report_stands_alone_and_starts_with_the_worst(scene, tmp_path):
    table = write_table(scene, tmp_path, 1, f"<b>.png,{scene.model},{scene.start}\n"
                        f"photo0.png,{scene.model},{scene.truth}\n")  # fmt: skip
    out = tmp_path / "out"
    run("batch", table, "--out", out, "--quiet", *QUICK)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "<script" not in page
    assert "http" not in page
    assert "<b>.png" not in page
    assert page.count("data:image/jpeg;base64,") == 2
    # The failed one, then the one that is likelier to be wrong: not that which began at the truth.
    likely = [float(row["probability"] or 0.0) for row in read_rows(out / "results.csv")]
    assert likely[0] < likely[2]
    places = [page.index(f'<td class="number">{row}</td>') for row in (2, 1, 3)]
    assert places == sorted(places)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("one_process")
def test_a_second_run_does_only_what_is_new_or_broken_and_rows_alike_once(scene, tmp_path, capsys):
    table, out = write_table(scene, tmp_path, 6), tmp_path / "out"
    line = ("batch", table, "--out", out, *QUICK)
    assert run(*line) == 0
    before = kept(out)
    names = {json.loads(data)["pose"][6:12]: name for name, data in before.items()}
    for number, damage in enumerate((b"", b'{"row": 1}', b"[]", b'{"status": ' + b"[" * 100_000)):
        (out / "rows" / names[f"photo{number}"]).write_bytes(damage)
    picture = out / json.loads(before[names["photo4"]])["picture"]
    picture.unlink()
    with table.open("a") as file:
        file.write(f"photo5.png,{scene.model},{scene.start}\ngone.png,,\n")
    capsys.readouterr()
    assert run(*line) == 2
    assert "2 of 8 rows were done before" in capsys.readouterr().err
    assert picture.is_file()
    assert kept(out).keys() == before.keys()
    assert kept(out)[names["photo5"]] == before[names["photo5"]]
    reasons = [row["reason"] for row in read_rows(out / "results.csv")]
    assert [bool(reason) for reason in reasons] == [False] * 7 + [True]
    shutil.copy(scene.photo, tmp_path / "photo5.png")  # of a new time: it may have changed
    assert run(*line) == 2
    assert len(kept(out)) == 7


@pytest.mark.slow
@pytest.mark.long
def test_a_killed_batch_goes_on_and_a_worker_that_dies_takes_no_row_along(scene, tmp_path):
    table, out = write_table(scene, tmp_path, 8), tmp_path / "out"
    line = command("batch", table, "--out", out, "--processes", 2, "--quiet", *LONG)
    with subprocess.Popen(line) as process:
        wait_until(lambda: len(kept(out)) >= 2)
        workers = workers_of(process.pid)
        process.kill()
    assert len(workers) == 2
    psutil.wait_procs(workers, 120)
    assert not any(worker.is_running() for worker in workers)
    before = kept(out)
    assert 2 <= len(before) < 8
    with subprocess.Popen(line) as process:
        wait_until(lambda: len(kept(out)) > len(before))
        workers_of(process.pid)[0].kill()
        before.update(kept(out))
        assert process.wait(120) == 0
    assert before.items() <= kept(out).items()
    assert [row["reason"] for row in read_rows(out / "results.csv")] == [""] * 8


@pytest.mark.skipif(sys.platform == "win32", reason="folders are not locked there")
def test_two_batches_in_one_folder_are_told_apart(scene, tmp_path, capsys):
    """The second is refused while the first is at work, and changes nothing; then it goes on."""
    out, line = tmp_path / "out", ("batch", tmp_path / "jobs.csv", "--out", tmp_path / "out")
    batch = open_batch(write_table(scene, tmp_path, 1), out, FitSettings())
    table = write_table(scene, tmp_path, 2)
    assert not (out / LOCK).exists()
    with lock_folder(out):  # as a batch holds it
        manifest = (out / "batch.json").read_bytes()
        assert run(*line) == 2
        assert "another batch is at work in it" in capsys.readouterr().err
        with pytest.raises(BatchError, match="another batch"):
            next(run_batch(batch, batch.jobs))
    assert (out / "batch.json").read_bytes() == manifest
    assert open_batch(table, out, FitSettings()).jobs != batch.jobs
    assert not (out / LOCK).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="folders are not locked there")
def test_a_lock_that_is_removed_before_it_is_taken_is_not_held(tmp_path, monkeypatch):
    """Another batch begins meanwhile, whose lock is a new file."""

    def open_as_the_holder_ends(path: Path) -> IO[bytes]:
        monkeypatch.undo()
        with lock_folder(tmp_path):
            return open_to_append(path)

    monkeypatch.setattr(writing, "open_to_append", open_as_the_holder_ends)
    with pytest.raises(BatchError, match="another batch"), lock_folder(tmp_path):
        pass
    with lock_folder(tmp_path):
        pass


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for one process there")
def test_ctrl_c_keeps_what_is_finished(scene, tmp_path):
    table, out = write_table(scene, tmp_path, 8), tmp_path / "out"
    line = command("batch", table, "--out", out, "--processes", 1, "--quiet", *LONG)
    with stopped_by_ctrl_c(line) as process:
        wait_until(lambda: len(kept(out)) >= 1)
        os.killpg(process.pid, signal.SIGINT)
        printed, complaints = process.communicate(timeout=60)
    assert "run it again to go on" in printed
    assert complaints == ""
    assert 1 <= len(read_rows(out / "results.csv")) == len(kept(out)) < 8


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for one process there")
@pytest.mark.parametrize("wait_s", [0.3, 1.0])
def test_ctrl_c_at_the_beginning_is_said_in_a_line(scene, tmp_path, wait_s: float):
    table, out = write_table(scene, tmp_path, 8), tmp_path / "out"
    # What comes before the command line's first step is Python's.
    begin = "from poseviewer.cli.main import main; print(flush=True); raise SystemExit(main())"
    for_long = "--evaluations", 5_000
    line = command("batch", table, "--out", out, "--processes", 2, "--quiet", *for_long)
    line[1:3] = ["-c", begin]
    with stopped_by_ctrl_c(line) as process:
        process.stdout.readline()
        time.sleep(wait_s)  # somewhere in it: no file says where
        os.killpg(process.pid, signal.SIGINT)
        try:
            _, complaints = process.communicate(timeout=5)
        except subprocess.TimeoutExpired:  # it fell into a callback, where Python drops it
            os.killpg(process.pid, signal.SIGINT)
            _, complaints = process.communicate(timeout=60)
            complaints = complaints[complaints.rfind("poseviewer: ") :]
    said = [f"poseviewer: stopped; {text}.\n" for text in ("nothing was written", GOES_ON)]
    assert complaints in ("", *said)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "an empty file"),
        (b"photo,model,start\n", "no rows"),
        (b"photo,model\na,b\n", "no column 'start'"),
        (b"photo,model,start,Photo\na,b,c,d\n", "two columns are called 'photo'"),
        (b"\xff\xfe\x00p\x00", "not a text in UTF-8"),
        (b'photo,model,start\n"' + b"x" * 200_000 + b'",b,c\n', "not a readable table of jobs"),
    ],
    ids=["empty", "no rows", "no start", "twice", "binary", "huge field"],
)
def test_a_table_that_cannot_be_used_is_said(tmp_path, content, words, capsys):
    table = write(tmp_path / "jobs.csv", content)
    assert words in refusal(capsys, "batch", table, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_empty_row_of_a_table_is_none(tmp_path):
    text = ", ,\nphoto,model,start\n\na,b,c\n,,\n ,\t, \nd,e,f\n,\n"
    table = write(tmp_path / "jobs.csv", text)
    assert [(job.row, job.photo) for job in load_jobs(table, FitSettings())] == [(1, "a"), (2, "d")]


def test_a_table_of_very_many_columns_is_read(tmp_path):
    table = tmp_path / "jobs.csv"
    many = ",".join(f"c{number}" for number in range(100_000))
    table.write_text(f"photo,model,start,{many}\n" + "p.png,m.ply,s.json\n" * 1000)
    assert len(load_jobs(table, FitSettings())) == 1000


@pytest.mark.usefixtures("one_process")
def test_results_hold_no_formula_and_no_file_from_elsewhere(scene, tmp_path):
    table, out = write_table(scene, tmp_path, 1, "=1+1,@a,-b\n"), tmp_path / "out"
    line = ("batch", table, "--out", out, "--quiet", *QUICK)
    assert run(*line) == 2
    row = read_rows(out / "results.csv")[1]
    assert [row[name] for name in ("photo", "model", "start")] == ["'=1+1", "'@a", "'-b"]
    (row,) = (path for path in (out / "rows").iterdir() if b'"reason": ""' in path.read_bytes())
    result, secret = json.loads(row.read_bytes()), tmp_path / "secret"
    secret.write_text("secret")
    (out / "pictures/link.jpg").symlink_to(secret)
    for picture in (str(secret), "../secret", "pictures/link.jpg"):
        row.write_text(json.dumps(result | {"picture": picture}))
        assert len(open_batch(table, out, FitSettings(limits=Limits(40))).rows()) == 1
    assert run(*line) == 2
    assert b"c2VjcmV0" not in (out / "report.html").read_bytes()
    assert json.loads(row.read_bytes())["picture"] == result["picture"]


def test_a_batch_whose_list_of_rows_is_damaged_is_said(scene, tmp_path, capsys):
    out = tmp_path / "out"
    open_batch(write_table(scene, tmp_path, 1), out, FitSettings())
    path = write(out / "batch.json", '{"jobs": ' + "[" * 100_000)
    assert "batch.json: cannot be used" in refusal(capsys, "review", out, "--no-browser")
    path.unlink()
    os.mkfifo(path)
    assert "batch.json: cannot be used" in refusal(capsys, "review", out, "--no-browser")


def test_a_table_of_a_spreadsheet_is_read(tmp_path):
    table = tmp_path / "jobs.csv"
    table.write_text("Start; Photo ;Model;note\np.json;a b.jpg;m.ply;x\n", encoding="utf-8-sig")
    (job,) = load_jobs(table, FitSettings())
    assert (job.photo, job.model, job.start) == ("a b.jpg", "m.ply", "p.json")
    assert job.path(job.photo) == tmp_path / "a b.jpg"


@pytest.mark.slow
@pytest.mark.long
def test_a_row_can_be_a_set_of_photos(tmp_path: Path):
    of_set, model, start = write_views(tmp_path)
    table, out = tmp_path / "jobs.csv", tmp_path / "results"
    rows = [of_set.name, model.name, start.name], [of_set.name, model.name, "auto"]
    table.write_text("photo,model,start\n" + "\n".join(",".join(row) for row in rows) + "\n")
    assert run("batch", table, "--out", out, "--quiet", *QUICK) == 2
    found, refused = read_rows(out / "results.csv")
    data = json.loads((out / found["pose"]).read_text())
    assert [Path(one["photo"]["file"]).name for one in data["views"]] == ["a.png", "b.png", "c.png"]
    assert found["verdict"]
    assert float(found["unexplained"]) < float(found["start_unexplained"])
    assert "with a set of photos" in refused["reason"]


@pytest.mark.slow
@pytest.mark.long
def test_a_network_proposes_rectangles_to_rows_without_a_start(
    scene: Scene, tmp_path: Path, capsys
):
    """Random weights propose something; whether it is right is tested with a trained network."""
    weights = tmp_path / "model.safetensors"
    save_random_backbone(weights)
    table = write_table(scene, tmp_path, 0, f"{scene.photo},{scene.model},auto,\n")
    line = ("batch", table, "--out", tmp_path / "out", "--processes", 1, "--quiet", *QUICK)
    assert run(*line) == 2
    (row,) = read_rows(tmp_path / "out" / "results.csv")
    assert "was not found in the photo by its texture" in row["reason"]
    assert run(*line, "--features", weights) == 0
    capsys.readouterr()
    given = write_table(scene, tmp_path, 1)
    refused = refusal(capsys, "batch", given, "--out", tmp_path / "none", "--features", weights)
    assert "features with jobs.csv, where no row has the start auto without a box" in refused
    assert not (tmp_path / "none").exists()


def test_what_a_kill_left_half_written_goes_with_the_next_writing(tmp_path: Path):
    old, new, other = (tmp_path / f".{name}.part" for name in ("a.json.0", "a.json.1", "b.json.0"))
    for path in (old, new, other):
        path.write_text("half")
        if path != new:
            os.utime(path, (0.0, time.time() - 2.0 * OLD_PART_S))
    write_whole(tmp_path / "a.json", b"whole", BatchError)
    assert {path.name for path in tmp_path.iterdir()} == {"a.json", new.name, other.name}
