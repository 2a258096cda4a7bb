"""Sweeps in processes of their own: killed, interrupted, on a cluster."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from invoking import invoke
from sweep_files import LONG, SMALL, written
from waiting import TIMEOUT, until

import forcebound as fb
from forcebound.lab.sweep.plan import load_sweep
from forcebound.lab.sweep.runner import run_file, run_sweep


def words(file: Path, result: Path, *options: str) -> list[str]:
    return ["sweep", str(file), "-o", str(result), *options]


@contextlib.contextmanager
def started(file: Path, result: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A sweep in a process of its own, of which two parts are done."""
    parts = result.with_name(result.name + ".parts")
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as `&` in a script does
    of_terminal = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    process = subprocess.Popen(
        [sys.executable, "-m", "forcebound", *words(file, result, *options)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    signal.signal(signal.SIGINT, before)
    signal.signal(signal.SIGHUP, of_terminal)
    try:
        while len(list(parts.glob("0*.json"))) < 2:
            with contextlib.suppress(subprocess.TimeoutExpired):
                assert process.wait(0.005) is None, "it was done before it could be interrupted"
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_sweep_killed_halfway_gives_the_same_file_as_one_that_was_not(tmp_path: Path) -> None:
    file = written(tmp_path, LONG)
    whole, cut = tmp_path / "whole.parquet", tmp_path / "cut.parquet"
    assert run_file(str(file), output=whole, workers=0)["cases"] == 640
    parts = cut.with_name("cut.parquet.parts")
    with started(file, cut, "--workers", "1") as process:
        process.send_signal(signal.SIGKILL)
    assert parts.exists()
    assert not cut.exists()
    document = json.loads(invoke(*words(file, cut, "--workers", "1", "--json")).stdout)
    assert 0 < document["resumed"] < document["cases"]
    assert cut.read_bytes() == whole.read_bytes()
    assert not parts.exists()


@pytest.mark.live
@pytest.mark.xdist_group("processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_sweep_says_how_to_go_on(tmp_path: Path, number: signal.Signals) -> None:
    file = written(tmp_path, LONG.replace("count: 320", "count: 3200"))
    with started(file, tmp_path / "cut.parquet", "--workers", "2") as process:
        process.send_signal(number)
        _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 130
    assert "the same command continues" in errors.splitlines()[-2]
    assert "Traceback" not in errors
    assert "leaked" not in errors


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_worker_that_is_killed_ends_the_sweep_with_one_line(tmp_path: Path) -> None:
    file = written(tmp_path, LONG.replace("count: 320", "count: 3200"))
    with started(file, tmp_path / "cut.parquet", "--workers", "1") as process:
        for worker in workers_of(process.pid):
            os.kill(worker, signal.SIGKILL)
        _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 1
    assert errors.splitlines()[-1].startswith("forcebound: a worker process ended")
    assert "Traceback" not in errors


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of a sweep, without multiprocessing's resource tracker."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [
        int(child)
        for child in children
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]


@contextlib.contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler on this machine, with workers; its address and its process."""
    note = folder / "scheduler.json"
    common = ["--scheduler-file", str(note), "--host", "127.0.0.1", "--no-dashboard"]
    with contextlib.ExitStack() as running:

        def start(*arguments: str) -> subprocess.Popen[bytes]:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments, *common],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=folder,
                env={**os.environ, "TMPDIR": str(folder)},  # a killed one leaves its scratch space
            )
            running.callback(process.wait)
            running.callback(process.kill)
            return process

        scheduler = start("scheduler", "--port", "0")
        for _ in range(workers):
            start("worker", "--nthreads", "1", "--no-nanny")
        until(lambda: note.exists() and note.read_text().endswith("}"), "the scheduler")
        yield json.loads(note.read_text())["address"], scheduler


def held(run: fb.Run) -> float:
    return NEWTON * 5.0


NEWTON = 1.0
held.__module__ = "__main__"  # as in a script, which no worker can import


def of_a_module(run: fb.Run) -> float:
    return 1.0


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_cluster_gives_the_same_file_and_its_end_ends_a_sweep_with_one_line(
    tmp_path: Path,
) -> None:
    file = written(tmp_path, SMALL.replace("count: 3", "count: 40"))
    here, there = tmp_path / "here.parquet", tmp_path / "there.parquet"
    run_sweep(load_sweep(file), here)
    with dask_cluster(tmp_path, workers=2) as (address, scheduler):
        done = invoke(*words(file, there, "--cluster", address, "--json"))
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["cases"] == 80
        assert there.read_bytes() == here.read_bytes()
        measured = fb.sweep("stiff_wall", seed=[1, 2], cluster=address, measures={"held": held})
        assert measured["held"].tolist() == [5.0, 5.0]
        with pytest.raises(fb.errors.RunError, match="test_sweep_live"):
            fb.sweep("stiff_wall", seed=[1], cluster=address, measures={"of_a_module": of_a_module})
        file = written(tmp_path, LONG.replace("count: 320", "count: 3200"))
        with started(file, tmp_path / "cut.parquet", "--cluster", address) as process:
            scheduler.kill()
            _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 1
    assert errors.splitlines()[-1] == "forcebound: the cluster has ended, or has dropped the work"
    assert "Traceback" not in errors
    assert "ERROR" not in errors
