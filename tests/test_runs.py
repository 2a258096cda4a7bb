import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from forcebound.errors import ConfigError
from forcebound.launch.live import RUN_FILE, RunDocument
from forcebound.running.runs import find, running


def make_run(folder: Path, name: str, launcher: int | None = None) -> Path:
    run_dir = folder / f"forcebound-{name}"
    run_dir.mkdir()
    RunDocument(os.getpid() if launcher is None else launcher, None, "", []).write(run_dir)
    return run_dir.resolve()


@pytest.fixture
def ended_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_run_is_a_directory_whose_launcher_lives(tmp_path: Path, ended_process: int) -> None:
    first, second = make_run(tmp_path, "b"), make_run(tmp_path, "a")
    make_run(tmp_path, "dead", ended_process)
    (tmp_path / "forcebound-empty").mkdir()
    (tmp_path / "forcebound-file").touch()
    make_run(tmp_path, "broken").joinpath(RUN_FILE).write_text("{")
    make_run(tmp_path, "nobody").joinpath(RUN_FILE).write_text(json.dumps({"launcher": None}))
    make_run(tmp_path, "list").joinpath(RUN_FILE).write_text("[]")
    assert running([tmp_path]) == [second, first]


def test_a_run_of_somebody_else_is_not_looked_into(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_dir = make_run(tmp_path, "a")
    monkeypatch.setattr(os, "getuid", lambda: run_dir.stat().st_uid + 1)
    assert running([tmp_path]) == []
    with pytest.raises(ConfigError, match="not the run directory of a graph that runs; none runs"):
        find(run_dir, [tmp_path])


def test_the_only_run_needs_no_name(tmp_path: Path) -> None:
    run_dir = make_run(tmp_path, "a")
    assert find(None, [tmp_path]) == run_dir


def test_without_a_run_the_message_says_how_to_start_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no graph of yours runs.*forcebound launch"):
        find(None, [tmp_path])


def test_of_several_runs_one_must_be_named(tmp_path: Path) -> None:
    first, second = make_run(tmp_path, "a"), make_run(tmp_path, "b")
    with pytest.raises(ConfigError, match=f"several graphs run.*{first.name}.*{second.name}"):
        find(None, [tmp_path])
    assert find(second, [tmp_path]) == second


def test_a_run_elsewhere_is_found_by_its_directory(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    run_dir = tmp_path / "by-hand"
    run_dir.mkdir()
    RunDocument(os.getpid(), None, "", []).write(run_dir)
    assert find(run_dir, [tmp_path / "empty"]) == run_dir.resolve()


def test_a_directory_of_no_run_is_refused_with_those_that_run(
    tmp_path: Path, ended_process: int
) -> None:
    run_dir = make_run(tmp_path, "a")
    dead = make_run(tmp_path, "dead", ended_process)
    for wrong in (dead, tmp_path / "missing"):
        with pytest.raises(ConfigError, match=f"{wrong.name} is not.*those that run.*{run_dir}"):
            find(wrong, [tmp_path])


def test_by_default_it_looks_where_the_launcher_makes_its_directories(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    run_dir = make_run(tmp_path, "a")
    assert run_dir in running()


def test_a_node_by_hand_does_not_stand_in_the_way_of_the_graph_that_is_meant(
    tmp_path: Path,
) -> None:
    by_hand, launched = make_run(tmp_path, "a"), make_run(tmp_path, "b")
    (launched / "control-launcher").touch()
    assert find(None, [tmp_path]) == launched
    assert find(by_hand, [tmp_path]) == by_hand
