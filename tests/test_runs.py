"""Run directories: those of running graphs, and removal of the others."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NoReturn

import pytest
from addresses import LAUNCHER_SOCKET
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.observe import delay, observation, runs
from forcebound.observe.listing import list_graphs
from forcebound.observe.runs import find, running
from forcebound.run.run_directory import (
    LAUNCH_FILE,
    LOCK_FILE,
    RECORDING,
    RUN_FILE,
    RunDocument,
    remove_left_over,
    run_directory,
    run_folders,
    shared,
)

MakeRun = Callable[..., Path]


@pytest.fixture
def only_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "run_folders", lambda: {tmp_path})


@pytest.fixture
def make_run(only_here: None) -> Iterator[MakeRun]:
    """Makes a run directory that has an owner until the end of the test."""
    with ExitStack() as stack:

        def make(folder: Path, name: str, is_alive: bool = True, **document: Any) -> Path:
            run_dir = folder / f"forcebound-{name}"
            run_dir.mkdir()
            run = RunDocument(os.getpid(), None, "", [], **document)
            run.write(run_dir)
            with ExitStack() as own:
                own.enter_context(shared(run_dir))
                if is_alive:
                    stack.push(own.pop_all())
            return run_dir.resolve()

        yield make


def test_a_run_is_a_directory_that_has_an_owner(tmp_path: Path, make_run: MakeRun) -> None:
    first, second = make_run(tmp_path, "b"), make_run(tmp_path, "a")
    make_run(tmp_path, "dead", is_alive=False)
    RunDocument(os.getpid(), None, "", []).write(tmp_path)
    (make_run(tmp_path, "never", is_alive=False) / LOCK_FILE).unlink()
    (tmp_path / "forcebound-empty").mkdir()
    (tmp_path / "forcebound-file").touch()
    make_run(tmp_path, "broken").joinpath(RUN_FILE).write_text("{")
    make_run(tmp_path, "nobody").joinpath(RUN_FILE).write_text(json.dumps({"launcher": None}))
    make_run(tmp_path, "list").joinpath(RUN_FILE).write_text("[]")
    assert list(running()) == [second, first]


def test_a_run_of_somebody_else_is_not_looked_into(
    tmp_path: Path, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_dir = make_run(tmp_path, "a")
    monkeypatch.setattr(os, "getuid", lambda: run_dir.stat().st_uid + 1)
    assert not running()
    with pytest.raises(ConfigError, match=r"not the run directory .*; none runs"):
        find(run_dir)


@pytest.mark.usefixtures("only_here")
def test_without_a_run_the_message_says_how_to_start_one() -> None:
    with pytest.raises(ConfigError, match=r"no graph of yours runs.*forcebound launch"):
        find(None)


def test_of_several_runs_one_must_be_named(tmp_path: Path, make_run: MakeRun) -> None:
    first = make_run(tmp_path, "a", file="stiff_wall law:=none")
    second = make_run(tmp_path, "b", file="stress.yaml")
    with pytest.raises(ConfigError) as caught:
        find(None)
    head, *lines = str(caught.value).splitlines()
    assert head == "several graphs run; name one with --run GRAPH, of"
    assert lines == [
        f"  {first}  (stiff_wall law:=none, process {os.getpid()})",
        f"  {second}  (stress.yaml, process {os.getpid()})",
    ]
    with pytest.raises(ConfigError, match="name one with `forcebound delay DIR`"):
        find(None, option="`forcebound delay DIR`")
    assert find(second) == second


def test_a_graph_has_the_name_of_its_launch_file_also_where_that_file_lies(
    tmp_path: Path, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_dir = make_run(tmp_path, "a", file="./my_wall.yaml delay:=2ms")
    make_run(tmp_path, "b", file="stiff_wall")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_wall.yaml").touch()
    (tmp_path / "stiff_wall").mkdir()
    for name in ("my_wall", "my_wall.yaml", "./my_wall.yaml"):
        assert find(Path(name)) == run_dir
    assert find(Path("stiff_wall")) != run_dir


def test_a_graph_of_which_nothing_answers_is_listed_as_silent(
    tmp_path: Path, make_run: MakeRun
) -> None:
    [graph] = list_graphs(0.0, make_run(tmp_path, "a", file="stiff_wall"))
    assert (graph.name, graph.phase, graph.processes) == ("stiff_wall", "silent", ())
    assert list_graphs(0.0, tmp_path) == []


def test_an_environment_alone_is_found_but_does_not_count_beside_a_graph(
    tmp_path: Path, make_run: MakeRun
) -> None:
    alone = make_run(tmp_path, "a", is_graph=False)
    assert find(None) == alone
    with pytest.raises(ConfigError, match=r"no graph of yours .* only environments for graphs on"):
        find(None, require_graph=True)
    with pytest.raises(ConfigError, match="an environment alone, and no graph"):
        find(alone, require_graph=True)
    graph = make_run(tmp_path, "b")
    assert find(None) == graph
    assert find(None, require_graph=True) == graph


def test_a_directory_of_no_run_is_refused_with_those_that_run(
    tmp_path: Path, make_run: MakeRun
) -> None:
    run_dir = make_run(tmp_path, "a")
    dead = make_run(tmp_path, "dead", is_alive=False)
    for wrong in (dead, tmp_path / "missing"):
        with pytest.raises(ConfigError, match=f"(?s){wrong.name} is not.*these are.*{run_dir}"):
            find(wrong)


def test_a_link_of_anybody_in_a_shared_folder_disables_nothing(
    tmp_path: Path, make_run: MakeRun
) -> None:
    run_dir = make_run(tmp_path, "a")
    (tmp_path / "forcebound-x").symlink_to("forcebound-x")
    (tmp_path / "forcebound-y").symlink_to(run_dir)
    assert find(None) == run_dir
    assert remove_left_over([tmp_path]) == []
    with pytest.raises(ConfigError, match="not the run directory of a running graph"):
        find(tmp_path / "forcebound-x")


def test_a_pipe_in_place_of_the_document_is_not_waited_for(
    tmp_path: Path, make_run: MakeRun
) -> None:
    run_dir = make_run(tmp_path, "a")
    other = tmp_path / "forcebound-b"
    other.mkdir(mode=0o700)
    os.mkfifo(other / RUN_FILE)
    assert find(None) == run_dir
    with pytest.raises(ConfigError, match="not the run directory of a running graph"):
        find(other)


def test_by_default_it_looks_where_the_launcher_makes_its_directories(
    run_dir: Path, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "run_folders", run_folders)
    private, shared_folder = run_dir / "a", run_dir / "b"
    private.mkdir(mode=0o700)
    shared_folder.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(private))
    monkeypatch.setattr("tempfile.tempdir", str(shared_folder))
    former = make_run(shared_folder, "a")
    with run_directory() as made:
        assert made.parent == private
        RunDocument(os.getpid(), None, "", []).write(made)
        assert {former, made.resolve()} <= running().keys()


def test_a_run_directory_is_made_where_nobody_else_may_enter(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = run_dir / "open"
    others.mkdir(mode=0o755)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(others))
    monkeypatch.setattr("tempfile.tempdir", str(run_dir))
    fallback = run_dir / f"forcebound-run-{os.getuid()}"
    with run_directory() as made:
        assert made.parent in (fallback, Path(f"/run/user/{os.getuid()}"))
        assert made.parent.stat().st_mode & 0o077 == 0


def test_a_node_by_hand_does_not_stand_in_the_way_of_the_graph_that_is_meant(
    tmp_path: Path, make_run: MakeRun
) -> None:
    by_hand, launched = make_run(tmp_path, "a"), make_run(tmp_path, "b")
    (launched / LAUNCHER_SOCKET).touch()
    assert find(None) == launched
    assert find(by_hand) == by_hand


@pytest.mark.parametrize("command", [["doctor"], ["delay"]])
def test_a_graph_that_ends_while_it_is_looked_at_is_a_failed_run(
    tmp_path: Path, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    run_dir = make_run(tmp_path, "a")
    (run_dir / LAUNCH_FILE).write_text("{}")

    def end(run_dir: Path, *_: object) -> NoReturn:
        shutil.rmtree(run_dir)
        RunDocument.read(run_dir)
        raise AssertionError

    for module in (delay, observation):
        monkeypatch.setattr(module, "watch", end)
    run = [str(run_dir)] if command == ["delay"] else ["--run", str(run_dir)]
    done = CliRunner().invoke(main, [*command, *run])
    assert done.exit_code == 1
    assert f"the graph in {run_dir} has ended" in done.stderr


# --- Owners, and what they leave when they die --------------------------------------------------


OWNER = """
import os, sys
from pathlib import Path
from forcebound.run.run_directory import (RunDocument, run_directory)
with run_directory() as run_dir:
    RunDocument(os.getpid(), None, "", []).write(run_dir)
    print(run_dir, flush=True)
    sys.stdin.read()
"""


def test_the_directory_of_a_killed_owner_is_removed_by_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert owner.stdout is not None
        left = Path(owner.stdout.readline().strip())
        with run_directory():
            assert left.resolve() in running()
        owner.send_signal(signal.SIGKILL)
    finally:
        owner.kill()
        owner.communicate()
    assert left.is_dir()
    assert left.resolve() not in running()
    with run_directory() as next_run:
        assert not left.exists()
        assert next_run.is_dir()
    assert not next_run.exists()


def test_only_what_is_provably_dead_and_of_no_use_is_removed(
    tmp_path: Path, make_run: MakeRun
) -> None:
    make_run(tmp_path, "lives")
    make_run(tmp_path, "recorded", is_alive=False).joinpath(RECORDING).touch()
    make_run(tmp_path, "older", is_alive=False).joinpath(LOCK_FILE).unlink()
    make_run(tmp_path, "begins", is_alive=False).joinpath(RUN_FILE).unlink()
    dead = make_run(tmp_path, "dead", is_alive=False)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    linked = make_run(elsewhere, "linked", is_alive=False)
    (tmp_path / "forcebound-link").symlink_to(linked)
    kept = set(tmp_path.iterdir()) - {dead}
    assert remove_left_over([tmp_path]) == [dead]
    assert set(tmp_path.iterdir()) == kept
    assert linked.is_dir()
