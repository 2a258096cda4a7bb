"""An environment of recorded replies."""

import json
from pathlib import Path
from typing import Any

import pytest
from builders import MS
from invoking import invoke

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.environments.recorded import RecordedEnvironment
from forcebound.lab.replay import graph_of
from forcebound.messages.packets import Contact, DeviceState, EnvironmentReply, Vector
from forcebound.recordings.recording import Recorder, read
from forcebound.run.virtual import run_virtual

BEGIN = 70  # tick with which the force engages


def recorded(path: Path, *words: str, duration: float = 0.3) -> Path:
    """Return the recording of a run in virtual time; ``words``: launch file and arguments."""
    run_virtual(load(words[0], words[1:]), duration, path)
    return path


def state(tick: int, elapsed: float | None = None) -> DeviceState:
    since = max(tick - BEGIN, 0) * 1e-3 if elapsed is None else elapsed
    return DeviceState(tick, tick * MS, since, (0.0,), (0.0,), (0.0,))


def reply(tick: int, force: Vector, contact: Contact | tuple[None, None]) -> EnvironmentReply:
    at = tick * MS
    return EnvironmentReply(tick, at + 9, tick, at, tick, at + 3, force, "environment", *contact)


def answers(path: Path, replies: dict[int, Vector], states: list[DeviceState]) -> Path:
    """Write a recording of some states and replies; a reply touches what lies one metre ahead."""
    with Recorder(path, {"launch": "{}"}) as recorder:
        for each in states:
            recorder.write(each)
        for tick, force in replies.items():
            still = tuple(0.0 for _ in force[1:])
            contact = Contact((1.0, *still), (-1.0, *still)) if force[0] else (None, None)
            recorder.write(reply(tick, force, contact))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def forces(path: Path, times: list[float], axes: int = 1) -> list[Vector]:
    environment = RecordedEnvironment(path).open(axes)
    return [environment.force("", (0.5,) * axes, (0.0,) * axes, time) for time in times]


def test_the_answer_is_that_to_the_nearest_state_and_zero_outside_of_the_recording(
    path: Path,
) -> None:
    states = [state(tick) for tick in range(BEGIN - 3, BEGIN + 10)]
    replies: dict[int, Vector] = {BEGIN: (1.0,), BEGIN + 1: (2.0,), BEGIN + 4: (5.0,)}
    answers(path, {BEGIN - 3: (7.0,)} | replies, states)
    times = [0.0, 0.0004, 0.0006, 0.001, 0.0024, 0.0026, 0.004, 0.0041, 9.0]
    assert [f for (f,) in forces(path, times)] == [1.0, 1.0, 2.0, 2.0, 2.0, 5.0, 5.0, 0.0, 0.0]


def test_contacts_come_with_their_answers(path: Path) -> None:
    states = [state(BEGIN + tick) for tick in range(3)]
    answers(path, {BEGIN: (1.0,), BEGIN + 1: (0.0,), BEGIN + 2: (1.0,)}, states)
    environment = RecordedEnvironment(path).open(1)
    contacts = []
    for tick in range(3):
        environment.force("", (0.0,), (0.0,), tick * 1e-3)
        contacts.append(environment.contact(""))
    assert contacts == [Contact((1.0,), (-1.0,)), None, Contact((1.0,), (-1.0,))]


def test_a_number_that_is_not_finite_is_no_answer(path: Path) -> None:
    states = [state(BEGIN + tick) for tick in range(3)]
    answers(path, {BEGIN: (1.0,), BEGIN + 1: (float("inf"),), BEGIN + 2: (3.0,)}, states)
    assert forces(path, [0.001 + 1e-6]) == [(3.0,)]


def test_a_recording_that_begins_later_counts_from_its_beginning(path: Path) -> None:
    states = [state(BEGIN + 500 + tick) for tick in range(3)]
    answers(path, {BEGIN + 500: (1.0,), BEGIN + 502: (2.0,)}, states)
    assert forces(path, [0.0, 0.002, 0.5]) == [(1.0,), (2.0,), (0.0,)]


def test_the_answers_end_with_the_device_that_was_lost(path: Path) -> None:
    states = [*(state(BEGIN + tick) for tick in range(3)), state(0, 0.0), state(1, 0.001)]
    answers(path, {BEGIN + 1: (1.0,), BEGIN + 2: (2.0,), 1: (9.0,)}, states)
    assert forces(path, [0.001, 0.002]) == [(1.0,), (2.0,)]


def test_other_axes_get_no_force_and_no_contact_that_is_not_whole(path: Path) -> None:
    states = [state(BEGIN + tick) for tick in range(2)]
    answers(path, {BEGIN: (1.0, 2.0), BEGIN + 1: (1.0, 2.0)}, states)
    assert forces(path, [0.001], axes=3) == [(1.0, 2.0, 0.0)]
    more, fewer = (RecordedEnvironment(path).open(axes) for axes in (3, 1))
    more.force("", (0.0,) * 3, (0.0,) * 3, 0.001)
    assert more.contact("") == Contact((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert fewer.force("", (0.0,), (0.0,), 0.001) == (1.0,)
    assert fewer.contact("") is None


@pytest.mark.parametrize(
    "words",
    [("stress",)],  # with delays and phases
    ids=" ".join,
)
def test_the_same_hand_meets_the_same_forces(path: Path, words: tuple[str, ...]) -> None:
    recorded(path, *words)
    again = path.with_name("again.mcap")
    run_virtual(graph_of(read(path), feeds=("hand", "environment")), 0.3, again)
    for topic in ("telemetry", "environment_reply"):
        assert read(again).packets(topic) == read(path).packets(topic)


def test_another_hand_gets_energy_from_it_unless_a_law_forbids(path: Path) -> None:
    recorded(path, "stiff_wall", duration=0.6)
    energy = {}
    for law in ("none", "certified"):
        words = ("--environment", f"law:={law}", "operator.end:=-10 mm", "--json")
        energy[law] = json.loads(invoke("replay", path, *words).stdout)["true_energy_min_j"]
    assert energy["none"] < -0.01
    assert energy["certified"] >= -1e-9


def test_it_can_stand_in_any_launch_file(path: Path) -> None:
    recorded(path, "stiff_wall")
    file = path.with_name("mine.yaml")
    file.write_text(
        "forcebound: 1\ninclude: stiff_wall.yaml\nenvironment: { kind: recorded, file: run.mcap }\n"
    )
    model: Any = load(file).environment.model
    assert model == RecordedEnvironment(path)
    path.unlink()
    with pytest.raises(
        ConfigError, match=r"mine\.yaml:3:38: cannot read the recording .*run\.mcap"
    ):
        load(file)


def test_a_file_without_answers_is_named(path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot read the recording .*run\.mcap: No such file"):
        RecordedEnvironment(path).check_files()
    answers(path, {1: (1.0,)}, [state(1), state(2)])
    with pytest.raises(ConfigError, match="has no reply to a state with an engaged force"):
        RecordedEnvironment(path).check_files()
    path.write_text("time,force")
    with pytest.raises(ConfigError, match="is not an MCAP file"):
        RecordedEnvironment(path).check_files()
