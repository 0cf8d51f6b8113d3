"""A batch on a real Dask cluster of processes, one of which is killed; skips without Dask."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import pytest

from poseviewer.cli import main as cli
from poseviewer.files.pose import load_pose
from tests.batch.test_batch import command, kept, read_results, wait_until, write_table

needs_dask = pytest.mark.skipif(
    find_spec("distributed") is None, reason="Dask is not installed: pip install '.[cluster]'"
)


class Cluster:
    """A scheduler and two workers of one thread, each a process."""

    def __init__(self, stack: ExitStack, folder: Path, port: int = 0) -> None:
        self._stack, self._file = stack, folder / "scheduler.json"
        where = ("--scheduler-file", self._file)
        self.scheduler = self._start(
            folder, "dask_scheduler", "--port", port, "--no-dashboard", *where
        )
        wait_until(self._file.exists)
        self.workers = [
            self._start(folder, "dask_worker", "--nthreads", 1, "--no-nanny", "--no-dashboard",
                        *where) for _ in range(2)
        ]  # fmt: skip

    @property
    def address(self) -> str:
        return json.loads(self._file.read_text())["address"]

    def _start(self, folder: Path, name: str, *arguments: object) -> subprocess.Popen:
        line = [sys.executable, "-m", f"distributed.cli.{name}", *map(str, arguments)]
        path = os.pathsep.join([str(Path.cwd()), *sys.path])
        process = subprocess.Popen(
            line, cwd=folder, env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.DEVNULL
        )
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One for all tests; whichever needs two workers takes care that one is left."""
    with ExitStack() as stack:
        yield Cluster(stack, tmp_path_factory.mktemp("cluster"))


@needs_dask
@pytest.mark.slow
def test_a_killed_worker_loses_nothing_and_nothing_is_done_twice(scene, tmp_path, cluster):
    table, out = write_table(scene, tmp_path, 6), tmp_path / "out"
    with ExitStack() as stack:
        line = command("batch", table, "--out", out, "--scheduler", cluster.address, "--quiet",
                       "--evaluations", 150)  # fmt: skip
        batch = stack.enter_context(subprocess.Popen(line, stderr=subprocess.PIPE, text=True))
        wait_until(lambda: len(kept(out)) >= 2)
        cluster.workers[0].send_signal(signal.SIGKILL)
        before = kept(out)
        _, complaints = batch.communicate(timeout=300)
        assert batch.returncode == 0, complaints
    assert 2 <= len(before) < 6
    assert before.items() <= kept(out).items()
    results = read_results(out)
    assert [row["row"] for row in results] == [str(number) for number in range(1, 7)]
    assert all(row["reason"] == "" and (out / row["pose"]).is_file() for row in results)
    # One machine gives what the cluster gave: there is nothing left to do.
    assert cli.main(["batch", str(table), "--out", str(out), "--evaluations", "400",
                     "--quiet"]) == 0  # fmt: skip
    assert before.items() <= kept(out).items()


@needs_dask
@pytest.mark.slow
def test_a_scheduler_that_goes_away_and_comes_back_is_given_the_rest(scene, tmp_path):
    table, out = write_table(scene, tmp_path, 6), tmp_path / "out"
    with ExitStack() as stack:
        first = Cluster(stack, made(tmp_path / "first"))
        line = command("batch", table, "--out", out, "--scheduler", first.address, "--quiet",
                       "--evaluations", 400)  # fmt: skip
        batch = stack.enter_context(subprocess.Popen(line, stderr=subprocess.PIPE, text=True))
        wait_until(lambda: len(kept(out)) >= 2)
        for process in (first.scheduler, *first.workers):
            process.send_signal(signal.SIGKILL)
        before = kept(out)
        Cluster(stack, made(tmp_path / "second"), int(first.address.rpartition(":")[2]))
        _, complaints = batch.communicate(timeout=300)
        assert (batch.returncode, complaints) == (0, "")
    assert 2 <= len(before) < 6
    assert before.items() <= kept(out).items()
    assert [row["reason"] for row in read_results(out)] == [""] * 6


@needs_dask
@pytest.mark.slow
def test_a_scheduler_that_goes_away_for_good_is_said(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("poseviewer.batch.cluster.CONNECT_SECONDS", 0.5)
    table, out = write_table(scene, tmp_path, 4), tmp_path / "out"
    with ExitStack() as stack:
        cluster = Cluster(stack, made(tmp_path / "cluster"))

        def end() -> None:
            wait_until(lambda: len(kept(out)) >= 1)
            cluster.scheduler.send_signal(signal.SIGKILL)

        ending = threading.Thread(target=end)
        ending.start()
        assert cli.main(["batch", str(table), "--out", str(out), "--scheduler", cluster.address,
                         "--evaluations", "400", "--quiet"]) == 2  # fmt: skip
        ending.join()
    printed = capsys.readouterr().err
    assert "no Dask scheduler answers there" in printed.splitlines()[-1]
    assert kept(out)


def made(folder: Path) -> Path:
    folder.mkdir()
    return folder


@needs_dask
@pytest.mark.slow
@pytest.mark.usefixtures("one_process")
def test_a_series_starts_each_row_where_the_one_above_ended(scene, tmp_path, cluster):
    row = f"photo0.png,{scene.model},last\n"
    table = write_table(scene, tmp_path, 1, more=2 * row)
    ends = {}
    for name, more in (("cluster", ["--scheduler", cluster.address]), ("here", [])):
        out = tmp_path / name
        assert cli.main(["batch", str(table), "--out", str(out), "--evaluations", "150",
                         "--quiet", *more]) == 0  # fmt: skip
        rows = sorted(read_results(out), key=lambda result: int(result["row"]))
        poses = [out / result["pose"] for result in rows]
        ends[name] = [load_pose(path, 160, 120) for path in poses]
    # So few evaluations end nowhere: the rows after the first go on, and get nearer.
    losses = [record.loss for record in ends["cluster"]]
    assert losses == [record.loss for record in ends["here"]]
    assert losses[0] > losses[2]
    assert losses == sorted(losses, reverse=True)


@needs_dask
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense:://"])
def test_a_scheduler_that_is_not_there_is_said(scene, tmp_path, address, capsys, monkeypatch):
    monkeypatch.setattr("poseviewer.batch.cluster.CONNECT_SECONDS", 0.5)
    table = write_table(scene, tmp_path, 1)
    assert cli.main(["batch", str(table), "--out", str(tmp_path / "out"), "--scheduler", address,
                     "--quiet"]) == 2  # fmt: skip
    printed = capsys.readouterr().err
    assert "no Dask scheduler answers there" in printed
    assert printed.count("\n") == 1, printed


def test_without_dask_its_option_says_what_to_install(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)  # as if it were not installed
    table = write_table(scene, tmp_path, 1)
    assert cli.main(["batch", str(table), "--out", str(tmp_path / "out"), "--scheduler",
                     "tcp://127.0.0.1:8786", "--quiet"]) == 2  # fmt: skip
    assert "poseviewer[cluster]" in capsys.readouterr().err
