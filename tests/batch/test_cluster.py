"""Batch and study on a real Dask cluster of processes, one is killed; skips without Dask."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.batch.test_batch import LONG, command, kept, wait_until
from tests.batches import write_table
from tests.commands import read_rows, refusal, run
from tests.evaluation.real_folder import write_real_folder

needs_dask = pytest.mark.skipif(find_spec("distributed") is None, reason="pip install '.[cluster]'")


class Cluster:
    """A scheduler, which comes first, and two workers of one thread, each a process."""

    def __init__(self, folder: Path) -> None:
        file = folder / "scheduler.json"
        at = ("--scheduler-file", file, "--no-dashboard")
        self.processes = [_started(folder, "dask_scheduler", "--port", 0, *at)]
        wait_until(file.exists)
        for _ in range(2):
            worker = _started(folder, "dask_worker", "--nthreads", 1, "--no-nanny", *at)
            self.processes.append(worker)
        self.address = json.loads(file.read_text())["address"]


def _started(folder: Path, name: str, *arguments: object) -> subprocess.Popen:
    line = [sys.executable, "-m", f"distributed.cli.{name}", *map(str, arguments)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), *sys.path])}
    return subprocess.Popen(line, cwd=folder, env=env, stderr=subprocess.DEVNULL)


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    cluster = Cluster(tmp_path_factory.mktemp("cluster"))
    yield cluster
    for process in cluster.processes:
        process.kill()
        process.wait()


@needs_dask
@pytest.mark.slow
@pytest.mark.long
def test_a_killed_worker_loses_nothing_and_nothing_is_done_twice(scene, tmp_path, cluster):
    table, out = write_table(scene, tmp_path, 6), tmp_path / "out"
    line = command("batch", table, "--out", out, "--scheduler", cluster.address, "--quiet", *LONG)
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True) as batch:
        wait_until(lambda: len(kept(out)) >= 2)
        cluster.processes[-1].send_signal(signal.SIGKILL)
        before = kept(out)
        _, complaints = batch.communicate(timeout=300)
        assert batch.returncode == 0, complaints
    assert 2 <= len(before) < 6
    after = kept(out)
    assert before.items() <= after.items()
    results = read_rows(out / "results.csv")
    assert [row["row"] for row in results] == [str(number) for number in range(1, 7)]
    assert all(row["reason"] == "" and (out / row["pose"]).is_file() for row in results)
    # One machine gives what the cluster gave: there is nothing left to do.
    assert run("batch", table, "--out", out, "--quiet", *LONG) == 0
    assert kept(out) == after


@needs_dask
@pytest.mark.slow
@pytest.mark.long
def test_a_study_on_a_cluster_ends_as_on_one_machine(scene, tmp_path, cluster, monkeypatch):
    monkeypatch.chdir(write_real_folder(scene))  # paths of the command line are relative to it
    line, ends = "study --real . --degrees 5 --evaluations 60 --quiet --out", []
    for name, more in ("far", f"--scheduler {cluster.address}"), ("here", "--jobs 1"):
        assert run(f"{line} {tmp_path / name} {more}") == 0
        ends.append(sorted(row["end"] for row in read_rows(tmp_path / name / "trials.csv")))
    assert ends[0] == ends[1]
    assert len(ends[0]) == 4


@needs_dask
@pytest.mark.slow
@pytest.mark.long
def test_a_scheduler_that_goes_away_is_said(scene, tmp_path, cluster, capsys):
    table, out = write_table(scene, tmp_path, 4), tmp_path / "out"

    def end() -> None:
        wait_until(lambda: len(kept(out)) >= 1)
        cluster.processes[0].send_signal(signal.SIGKILL)

    ending = threading.Thread(target=end)
    ending.start()
    line = ("batch", table, "--out", out, "--scheduler", cluster.address, "--quiet")
    assert run(*line, "--evaluations", 400) == 2
    ending.join()
    printed = capsys.readouterr().err
    assert "the Dask scheduler went away" in printed.splitlines()[-1]
    assert kept(out)


@needs_dask
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense:://", "tls://127.0.0.1:9"])
def test_a_scheduler_that_is_not_there_is_said(scene, tmp_path, address, capsys, monkeypatch):
    monkeypatch.setattr("poseviewer.cluster.CONNECT_SECONDS", 0.5)
    table, out = write_table(scene, tmp_path, 1), tmp_path / "out"
    line = ("batch", table, "--out", out, "--scheduler", address, "--quiet")
    assert "no Dask scheduler answers there" in refusal(capsys, *line)


@needs_dask
def test_a_port_that_answers_rubbish_is_said(tmp_path: Path, scene, capfd):
    table, out = write_table(scene, tmp_path, 1), tmp_path / "out"
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            with suppress(OSError), server.accept()[0] as peer:
                peer.sendall(b"\xff" * 4000)
                peer.recv(1)

        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        assert run("batch", table, "--out", out, "--scheduler", address, "--quiet") == 2
    assert "no Dask scheduler answers there" in capfd.readouterr().err


@needs_dask
@pytest.mark.slow
def test_a_cluster_without_workers_is_said(scene, tmp_path, cluster, capsys, monkeypatch):
    monkeypatch.setattr("poseviewer.cluster.WORKER_SECONDS", 1.0)
    for process in cluster.processes[1:]:
        process.kill()
        process.wait()
    table, out = write_table(scene, tmp_path, 1), tmp_path / "out"
    assert run("batch", table, "--out", out, "--scheduler", cluster.address, "--quiet") == 2
    assert "no worker joined the Dask scheduler" in capsys.readouterr().err


def test_without_dask_its_option_says_what_to_install(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)  # as if it were not installed
    table, out = write_table(scene, tmp_path, 1), tmp_path / "out"
    assert run("batch", table, "--out", out, "--scheduler", "tcp://127.0.0.1:8786") == 2
    assert "poseviewer[cluster]" in capsys.readouterr().err
