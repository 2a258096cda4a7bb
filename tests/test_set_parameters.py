"""Setting parameters of a run: its document, its nodes, other machines, other commands."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from launch_texts import written

from forcebound.errors import ConfigError, RunError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.graph.model import always, restore
from forcebound.graph.parameters import parameters
from forcebound.graph.resolved import to_document
from forcebound.haptics.environments import open_environment
from forcebound.messages.control import (
    Answer,
    Configure,
    ConfigureNode,
    ControllerStatus,
    EnvironmentStatus,
    LauncherStatus,
    ProcessState,
    Request,
)
from forcebound.messages.topology import ONE_HAND
from forcebound.network.impairment import Impairment
from forcebound.observe import control, snapshot, tuning
from forcebound.observe.tuning import (
    Change,
    changed_parameters,
    configuration,
    cut_links,
    find_parameters,
    found_elsewhere,
    set_parameters,
)
from forcebound.run.application import try_out
from forcebound.run.live import take_back
from forcebound.run.run_directory import RunDocument


def check_notes(change: Change, *words: str) -> None:
    """Check that there is a note with each of some words, and no other."""
    assert len(change.notes) == len(words)
    assert all(word in note for word, note in zip(words, change.notes, strict=True))


def begin(run_dir: Path, config: GraphConfig) -> None:
    """Write what a launcher writes of a run."""
    (run_dir / "launch.json").write_text(json.dumps(to_document(config)))
    RunDocument(1, None, "", []).write(run_dir)


@pytest.fixture(scope="module")
def config() -> GraphConfig:
    return replace(load("stiff_wall"), duration=0.5)


def test_a_run_directory_without_nodes_keeps_the_change_for_them(
    config: GraphConfig, tmp_path: Path
) -> None:
    file = tmp_path / "launch.json"
    begin(tmp_path, config)
    done = set_parameters(tmp_path, {"environment.stiffness": 500})
    assert done.values == {"environment.stiffness": 500.0}
    check_notes(done, "no environment is running")
    model = restore(json.loads(file.read_text()), always).environment.model
    force = open_environment(model, 1).force("", (0.012,), (0.0,), 0.0)
    assert force == pytest.approx((1.0,))
    with pytest.raises(ConfigError, match="which is a time"):
        set_parameters(tmp_path, {"environment.stiffness": "5 s"})
    assert json.loads(file.read_text())["environment"]["stiffness"] == 500.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("links.environment_query.jitter", "1e308 s"),
        ("links.environment_reply.limit", 2**70),
        ("links.environment_reply.outages", [{"start": 0.0, "duration": 1e308}]),
        ("environment.compute_delay", "25 h"),
    ],
)
def test_what_would_end_a_node_is_refused_before_it_is_written(
    config: GraphConfig, tmp_path: Path, name: str, value: Any
) -> None:
    begin(tmp_path, config)
    before = (tmp_path / "launch.json").read_bytes()
    with pytest.raises(ConfigError, match=name.replace(".", r"\.")):
        set_parameters(tmp_path, {name: value})
    assert (tmp_path / "launch.json").read_bytes() == before


def test_an_outage_lasts_a_day_at_most(config: GraphConfig, tmp_path: Path) -> None:
    begin(tmp_path, config)
    for time_text in ("1e308 s", "25 h", "nan s", "0 s"):
        with pytest.raises(ConfigError, match=r"s and <= 86400 s|expected a time"):
            cut_links(tmp_path, time_text, ())
    assert not any(link.outages for link in configuration(tmp_path).only.links.values())


def test_a_change_is_tried_on_a_copy(config: GraphConfig) -> None:
    impossible, name = Impairment(), "links.environment_query.delay"
    changed = config.with_hand(links={"environment_query": impossible})
    object.__setattr__(impossible, "delay", 1e308)  # a value that no range has caught
    with pytest.raises(ConfigError, match=r"links\.environment_query: cannot work"):
        try_out(changed, [name])
    try_out(config.with_hand(links={"environment_query": Impairment(0.002)}), [name])


def test_the_parameters_before_a_change_hold_again_and_then_those_of_the_launch_file(
    config: GraphConfig, tmp_path: Path
) -> None:
    begin(tmp_path, config)
    back = partial(take_back, config, tmp_path, "environment")
    name = "environment.stiffness"
    first = to_document(config)["environment"]["stiffness"]
    for value in (500.0, 600.0):
        set_parameters(tmp_path, {name: value, "links.environment_reply.delay": 1e-6 * value})
    assert back() == {name: 500.0}
    assert back() == {name: first}
    assert back() == {}
    links = configuration(tmp_path).only.links  # of another node: it has not failed
    assert links["environment_reply"].delay == pytest.approx(6e-4)
    set_parameters(tmp_path, {name: 700.0})
    long_ago = time.time() - 60.0
    os.utime(tmp_path / "launch.json", (long_ago, long_ago))
    assert back() == {}


def test_a_file_is_taken_from_the_launch_files_folder_alone(
    config: GraphConfig, tmp_path: Path
) -> None:
    name = "links.environment_query.trace"
    (tmp_path / "launch.json").write_text(json.dumps(to_document(config)))
    own, secret = tmp_path / "own", tmp_path / "secret.csv"
    own.mkdir()
    RunDocument(1, None, "", [], folder=str(own)).write(tmp_path)
    secret.write_text("password\n")
    (own / "link.csv").symlink_to(secret)
    for file in (secret, own / "link.csv", own / ".." / "secret.csv", "/dev/zero"):
        with pytest.raises(ConfigError, match=r"in .*own or below") as caught:
            set_parameters(tmp_path, {name: str(file)})
        assert "password" not in str(caught.value)
    (own / "delays.csv").write_text("time_s,delay_s\n0,0.01\n")
    assert set_parameters(tmp_path, {name: str(own / "delays.csv")}).values
    with pytest.raises(ConfigError, match=r"other\.csv"):
        set_parameters(tmp_path, {name: str(own / "other.csv")})


def test_a_node_that_does_not_answer_is_named(
    config: GraphConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuning, "ANSWER_TIMEOUT", 0.1)
    monkeypatch.setattr(snapshot, "STATUS_TIMEOUT", 0.1)
    begin(tmp_path, config)
    (tmp_path / ONE_HAND.nodes["environment"].socket).touch()
    with pytest.raises(RunError, match="environment did not answer"):
        set_parameters(tmp_path, {"environment.stiffness": 500})


SETTER = """
import sys
from pathlib import Path
from forcebound.observe.tuning import configuration, find_parameters, set_parameters
run_dir, name = Path(sys.argv[1]), sys.argv[2]
for value in (number * 1e-3 for number in range(1, 26)):
    set_parameters(run_dir, {name: value})
    [found] = find_parameters(configuration(run_dir), [name]).values()
    assert found == value, f"{name} is {found}, not {value}: a change was lost"
"""


def test_of_changes_made_at_the_same_time_none_is_lost(config: GraphConfig, tmp_path: Path) -> None:
    begin(tmp_path, config)
    names = ("environment.stiffness", "links.device_state.delay")
    setters = [
        subprocess.Popen([sys.executable, "-c", SETTER, tmp_path, name], stderr=subprocess.PIPE)
        for name in names
    ]
    errors = [setter.communicate()[1].decode() for setter in setters]
    assert [setter.returncode for setter in setters] == [0, 0], errors
    assert find_parameters(configuration(tmp_path), names) == dict.fromkeys(names, 0.025)


def test_what_ends_on_another_machine_is_changed_there(tmp_path: Path) -> None:
    remote = written(
        tmp_path, "forcebound: 1\ninclude: stiff_wall.yaml\nremote: {address: 127.0.0.1}\n"
    )
    begin(tmp_path, load(remote))
    with pytest.raises(ConfigError, match="on another machine"):
        set_parameters(tmp_path, {"environment.stiffness": 500})
    assert set_parameters(tmp_path, {"links.environment_reply.loss": 0.1}).values


class Answering:
    """Processes that answer requests, each with what a test gives it.

    Args:
        run_dir: Of the graph.
        answers: By process; None: silent.
    """

    def __init__(self, run_dir: Path, answers: Mapping[str, Answer | None]) -> None:
        self.asked: list[tuple[str, Request]] = []
        self._run_dir, self._answers = run_dir, answers
        for name in answers:
            (run_dir / ONE_HAND.nodes[name].socket).touch()

    def __call__(
        self, run_dir: Path, requests: Mapping[str, Request], timeout: float
    ) -> dict[str, Answer | None]:
        assert run_dir == self._run_dir
        assert timeout > 0.0
        self.asked += requests.items()
        return {name: self._answers[name] for name in requests}

    @property
    def configured(self) -> set[str]:
        return {name for name, request in self.asked if isinstance(request, Configure)}


REMOTE = "forcebound: 1\ninclude: stiff_wall.yaml\nremote: {address: 127.0.0.1, local: true}\n"


@pytest.fixture
def answering(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Answering]:
    """Makes a run directory with processes that answer."""
    document = to_document(load(written(tmp_path, REMOTE)))
    (tmp_path / "launch.json").write_text(json.dumps(document))

    def make(is_graph: bool = True, **answers: Answer | None) -> Answering:
        metadata = {"launch": json.dumps(document)}
        RunDocument(1, None, "", [], metadata, is_graph=is_graph).write(tmp_path)
        made = Answering(tmp_path, answers)
        for module in (tuning, control, snapshot):
            monkeypatch.setattr(module, "ask_all", made)
        return made

    return make


def launcher(**states: str) -> LauncherStatus:
    nodes = {name: ProcessState(state) for name, state in states.items()}
    return LauncherStatus(phase="running", nodes=nodes)


@pytest.mark.parametrize("name", ["environment_reply", "device_state", "force_command"])
def test_on_the_machine_of_an_environment_the_links_of_the_graph_are_refused(
    answering: Callable[..., Answering], tmp_path: Path, name: str
) -> None:
    processes = answering(is_graph=False, environment=EnvironmentStatus(name="a"))
    with pytest.raises(ConfigError, match=r"ends at the .*on the machine of the graph.*set` there"):
        set_parameters(tmp_path, {f"links.{name}.delay": 0.015, "environment.stiffness": 1})
    assert not processes.configured
    assert not changed_parameters(tmp_path)
    config = configuration(tmp_path)
    own = {key for key in parameters(config) if "environment." in key or "environment_query" in key}
    assert found_elsewhere(tmp_path, config, parameters(config)) == parameters(config).keys() - own
    done = set_parameters(tmp_path, {"links.environment_query.delay": 0.015})
    assert processes.configured == {"environment"}
    assert done == tuning.Change({"links.environment_query.delay": 0.015})
    assert changed_parameters(tmp_path) == done.values


RUNNING = {"device": "running", "controller": "running", "environment": "running"}


@pytest.mark.parametrize(
    ("serving", "is_told"), [("far/1/a", True), ("near/2/b", False), (None, False)]
)
def test_a_change_to_a_stand_by_says_who_serves(
    answering: Callable[..., Answering],
    tmp_path: Path,
    serving: str | None,
    is_told: bool,
) -> None:
    processes = answering(
        launcher=launcher(**RUNNING),
        controller=ControllerStatus(environment=serving),
        environment=EnvironmentStatus(name="near/2/b"),
    )
    done = set_parameters(tmp_path, {"links.environment_query.delay": 0.001})
    assert processes.configured == {"environment"}
    check_notes(done, *["far/1/a serves the graph"] * is_told)
    assert not set_parameters(tmp_path, {"links.environment_reply.delay": 0.001}).notes


def test_an_environment_that_was_stopped_on_request_keeps_the_change(
    answering: Callable[..., Answering], tmp_path: Path
) -> None:
    processes = answering(
        launcher=launcher(**{**RUNNING, "environment": "stopped"}),
    )
    done = set_parameters(tmp_path, {"environment.stiffness": 500})
    assert not processes.configured
    check_notes(done, "`forcebound start environment`")
    assert changed_parameters(tmp_path) == {"environment.stiffness": 500.0}


def test_a_suspended_node_gets_the_change_from_the_launcher_when_it_goes_on(
    answering: Callable[..., Answering], tmp_path: Path
) -> None:
    processes = answering(
        launcher=launcher(**RUNNING), controller=ControllerStatus(), environment=None
    )
    for _ in range(2):  # also the second time, when the document has the value already
        processes.asked.clear()
        with pytest.raises(RunError, match="kept until it continues"):
            set_parameters(tmp_path, {"environment.stiffness": 500})
        [passed_on] = [one for _, one in processes.asked if isinstance(one, ConfigureNode)]
        assert passed_on.node == "environment"
