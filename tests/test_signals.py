"""Signals of one's own: from the part that publishes them to every place that shows them."""

import json
import math
from pathlib import Path
from shutil import copyfile
from typing import Any, get_args

import numpy as np
import pytest
from builders import query, reply, state
from click.testing import CliRunner
from invoking import invoke
from live_graph import PROCESSES_OF_THEIR_OWN, live_graph
from msgspec import UNSET

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.loader import load, load_tried
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.guard import GuardedDevice
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.environments.membrane import Membrane
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.parts.signals import Signal, SignalError
from forcebound.messages.codec import encode
from forcebound.messages.events import PUBLISHED, EventKind, EventLog
from forcebound.messages.packets import EnvironmentReply, Event, ForceCommand, Vector
from forcebound.messages.topology import HAND
from forcebound.network.impairment import Impairment
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.nodes.publishing import Signals
from forcebound.observe.page.feed import Feed
from forcebound.recordings.recording import Recorder, read
from forcebound.recordings.schema import declared_signals
from forcebound.results.signals import curves_of
from forcebound.run.virtual import run_virtual
from forcebound.testing import parts

SOURCE = """
from dataclasses import dataclass
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.parts.signals import Signal

@dataclass(frozen=True)
class Gel(StatelessEnvironment):
    signals = (Signal("depth", "m", "depth in the gel"), Signal("load"))

    def force(self, user, position, velocity, elapsed):
        depth = max(position[0] - 0.01, 0.0)
        self.signal("depth", depth)
        if depth > 0.0:
            self.event("touched", "the gel is touched")
        return (500.0 * depth, *[0.0] * (len(position) - 1))
"""
LAUNCH = """
forcebound: 1
include: stiff_wall.yaml
environment: {kind: gel.py}
"""


@pytest.fixture
def gel(tmp_path: Path) -> Path:
    """A launch file with an environment of one's own beside it."""
    (tmp_path / "gel.py").write_text(SOURCE)
    file = tmp_path / "gel.yaml"
    file.write_text(LAUNCH)
    return file


def answers(node: EnvironmentNode, *positions: float) -> list[Any]:
    """What an environment node sends about some positions, 1 ms apart."""
    sent: list[Any] = []
    for tick, x in enumerate(positions):
        sent += node.step(tick * 1_000_000, [query(tick, x)])
    return sent


def signals_of(packets: list[Any]) -> list[Any]:
    return [packet.signals for packet in packets if isinstance(packet, EnvironmentReply)]


# --- from a user's file to every place -----------------------------------------------------------


def test_a_recording_of_virtual_time_has_column_unit_and_curve(gel: Path, tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    result = run_virtual(load(gel), 0.5, file)
    touched = [event for event in result.events if event.event == "touched"]
    assert touched
    assert PUBLISHED in touched[0].data

    recording = read(file)
    depth, load_ = curves_of(recording)
    assert depth.about == ("depth in the gel", "m")
    assert load_.about == ("load", "")
    np.testing.assert_array_equal(depth.time_ns, result.columns.time_ns - 400_000)
    pushed = np.maximum(result.columns.position[:, 0] - 0.01, 0.0)
    # The force is written 0.4 ms after the state that the environment was asked about.
    assert depth.values.max() == pytest.approx(pushed.max(), abs=1e-4)
    assert np.isnan(load_.values).all()

    tables = tmp_path / "tables"
    assert invoke("export", str(file), "--csv", str(tables)).exit_code == 0
    units = (tables / "columns.csv").read_text().splitlines()
    assert "environment_reply,signals.depth,m,depth in the gel" in units
    assert "signals.depth" in (tables / "environment_reply.csv").read_text().splitlines()[0]
    assert invoke("replay", str(file), "--verify").exit_code == 0


DEVICE = """
from dataclasses import dataclass
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.parts.signals import Signal

@dataclass(frozen=True, kw_only=True)
class Warm(PhantomPremium15):
    signals = (Signal("temperature", "K", "motor"),)

    def open(self, operator, hold_limit):
        device = super().open(operator, hold_limit)
        device.signal("temperature", 300.0)
        device.event("warm", "the motor is warm")
        return device
"""


def test_a_controller_and_a_device_publish_with_their_packets(tmp_path: Path) -> None:
    copyfile(parts.__file__, tmp_path / "counting.py")
    (tmp_path / "warm.py").write_text(DEVICE)
    kinds = "device: {kind: warm.py}\ncontroller: {kind: counting.py}\n"
    (tmp_path / "both.yaml").write_text(f"forcebound: 1\ninclude: stiff_wall.yaml\n{kinds}")
    file = tmp_path / "run.mcap"
    result = run_virtual(load(tmp_path / "both.yaml"), 0.05, file)
    temperature, replies = curves_of(read(file))
    assert temperature.about == ("motor", "K")
    assert set(temperature.values) == {300.0}
    np.testing.assert_array_equal(replies.values, np.arange(1, 51))
    np.testing.assert_array_equal(temperature.time_ns, replies.time_ns)
    assert [event.node for event in result.events if event.event == "warm"] == ["device"]


def test_a_guarded_device_publishes() -> None:
    device = PhantomPremium15().open(None, 1e-3)
    rejected: list[str] = []
    published = Signals(
        GuardedDevice(device), (Signal("one"),), EventLog("device"), rejected.append
    )
    device.signal("one", 1.0)
    assert published.numbers() == {"one": 1.0}
    with pytest.raises(SignalError):
        device.signal("two", 1.0)
    assert published.numbers() == {"one": 1.0}
    device.signal("one", math.nan)
    assert published.numbers() is UNSET
    device.event("warm", "the motor is warm")
    assert [event.event for event in published.events(0)] == ["warm"]


def test_a_number_that_was_published_before_its_names_were_known_is_checked_then() -> None:
    part = DirectController()
    part.signal("two", 1.0)
    with pytest.raises(SignalError, match="two"):
        Signals(part, (Signal("one"),), EventLog("controller"), lambda reason: None)


@pytest.mark.parametrize("mark", [pytest.param(None, marks=PROCESSES_OF_THEIR_OWN)])
def test_a_live_graph_shows_them_to_echo_page_and_recorder(gel: Path, mark: None) -> None:
    with live_graph(str(gel), is_alone=False) as graph:
        graph.wait_until_forced()
        words = ["echo", "environment_reply", "--field", "signals", "--json", "--count", "1"]
        echoed = CliRunner().invoke(main, [*words, "--run", str(graph.run_dir)])
        assert json.loads(echoed.stdout)["signals"]["depth"] > 0.0
        feed = Feed(graph.run_dir, {HAND: 0.0})
        shown: list[float] = []

        def is_shown() -> bool:
            for message in feed.look():
                column = message.get("signals", {}).get("environment_reply.depth", ())
                shown.extend(one for one in column if one is not None)
            return bool(shown)

        graph.until(is_shown, "a signal on the page")
        feed.close()
        assert shown[-1] > 0.0
        graph.end()
        recording = read(graph.record)
        assert max(map(float, curves_of(recording)[0].values)) > 0.0
        events = recording.packets("event")
        assert any(isinstance(event, Event) and event.event == "touched" for event in events)


def test_a_plot_has_a_panel_for_each_unit_with_a_number(gel: Path, tmp_path: Path) -> None:
    from forcebound.results.plots import DEFAULT_PANELS, figure

    file = tmp_path / "run.mcap"
    result = run_virtual(load(gel), 0.5, file)
    run = (result.label, result.columns, result.document)
    axes = figure([run], signals=[curves_of(read(file))]).axes[len(DEFAULT_PANELS) :]
    assert [one.get_ylabel() for one in axes] == ["signals (m)"]  # no `load` was published
    time, depth = axes[0].lines[0].get_data()
    assert np.asarray(time)[-1] == pytest.approx(result.columns.time[-1] - 0.0004)
    assert np.asarray(depth)[-1] == curves_of(read(file))[0].values[-1]


def test_the_skin_breaks_once_and_gives_no_energy(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    result = run_virtual(load("membrane.yaml"), 1.0, file)
    [broke] = [event for event in result.events if event.event == "skin_broke"]
    [damage] = curves_of(read(file))
    [first] = np.flatnonzero(damage.values == 1.0)[:1]
    assert damage.time_ns[first] == broke.time_ns
    assert (np.diff(damage.values) >= 0.0).all()
    assert result.columns.true_energy.min() >= 0.0
    at_rest = result.columns.time > 0.9
    assert np.abs(result.columns.applied_force[at_rest]).max() < 1e-9  # N


def test_the_skin_is_drawn_where_it_is_stretched_and_then_with_a_gap() -> None:
    skin = Membrane(stiffness=500.0, strength=2.0, skin=0.010).open(1)

    def drawn(position: float) -> tuple[float, float]:
        """Place of the skin, and height of the gap in it, in m."""
        skin.force("", (position,), (0.0,), 0.0)
        scene = skin.scene()
        assert scene is not None
        above, below = scene
        return above.position[0], above.position[1] - below.position[1] - above.size[1]

    rest, whole = drawn(0.0)
    assert whole == pytest.approx(0.0)
    assert drawn(0.013) == pytest.approx((rest + 0.003, 0.0))
    at, gap = drawn(0.015)
    assert at == rest
    assert gap > 0.001


# --- what does not fit ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "of skin", "9th", "ä", "n" * 33])
def test_a_name_is_a_letter_then_letters_digits_underscores(name: str) -> None:
    with pytest.raises(ConfigError, match="name of a signal"):
        Signal(name)


def test_two_signals_of_one_name_are_refused_with_the_line_of_the_class(gel: Path) -> None:
    text = SOURCE.replace('Signal("load")', 'Signal("depth")')
    (gel.parent / "gel.py").write_text(text)
    with pytest.raises(ConfigError, match="two named depth") as caught:
        load(gel)
    assert "gel.py" in str(caught.value)


@pytest.mark.parametrize("value", ['"depht", 1.0', '"depth", "deep"'])
def test_a_wrong_name_or_value_is_found_before_a_run_and_by_the_check(
    gel: Path, value: str
) -> None:
    (gel.parent / "gel.py").write_text(SOURCE.replace('"depth", depth', value))
    with pytest.raises(ConfigError, match="signal"):
        load_tried(gel)
    checked = CliRunner().invoke(
        main, ["check", "environment", str(gel.parent / "gel.py"), "--json"]
    )
    assert json.loads(checked.stdout)["promises"]["signals"] is False


class Talkative(StatelessEnvironment):
    """Publishes the value that the test sets."""

    signals = (Signal("one"), Signal("two"))
    said: tuple[tuple[Any, Any], ...] = ()
    happened: tuple[str, ...] = ()

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        for name, value in self.said:
            self.signal(name, value)
        for event in self.happened:
            self.event(event)
        return (1.0,)


class Odd:
    """No number, and it says so with an error of its own, as a tensor does."""

    def __float__(self) -> float:
        raise RuntimeError("a tensor with two elements")


def talkative(*said: tuple[Any, Any], happened: tuple[str, ...] = ()) -> EnvironmentNode:
    model = Talkative()
    model.said, model.happened = said, happened
    return EnvironmentNode(model)


@pytest.mark.parametrize("value", ["2", 10**400, None])
def test_what_is_no_number_is_a_failure_and_no_answer(value: Any) -> None:
    node = talkative(("one", value))
    assert signals_of(answers(node, 0.0)) == []
    assert node.faults == 1


def test_a_text_of_any_characters_can_be_sent() -> None:
    node = talkative(happened=("seen",))
    node._environment.event("odd", "a file \udcff")  # as os.fsdecode gives it
    assert [encode(packet) for packet in answers(node, 0.0)]


@pytest.mark.parametrize("wrong", [("three", 3.0), ("two", Odd())])
def test_in_the_loop_a_wrong_signal_is_a_failure_that_is_counted_and_reported_once(
    wrong: tuple[Any, Any],
) -> None:
    node = talkative(("one", 1.0), wrong)
    sent = answers(node, 0.0, 0.0)
    assert signals_of(sent) == []
    assert node.faults == 2
    [fault] = [packet for packet in sent if isinstance(packet, Event) and packet.is_fault]
    assert fault.event == "environment_failed"
    assert wrong[0] in fault.message
    assert node.rejected == {}


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_number_that_is_not_finite_is_a_gap(value: float, tmp_path: Path) -> None:
    node = talkative(("one", value), ("two", np.float32(2.0)))
    packets = answers(node, 0.0)
    assert signals_of(packets) == [{"two": 2.0}]
    assert node.rejected == {}
    from_elsewhere = reply(1, 1.0)  # as a node in another language may send it
    sent = type(from_elsewhere)(**{**as_fields(from_elsewhere), "signals": {"one": value}})
    with Recorder(tmp_path / "run.mcap", {}) as recorder:
        recorder.write(sent)
    [recorded] = read(tmp_path / "run.mcap").packets("environment_reply")
    assert isinstance(recorded, EnvironmentReply)
    assert recorded.signals is not UNSET
    assert math.isnan(recorded.signals["one"])


def as_fields(packet: EnvironmentReply) -> dict[str, Any]:
    return {name: getattr(packet, name) for name in packet.__struct_fields__}


def test_events_are_limited() -> None:
    node = talkative(happened=("", "x\ny", *["seen"] * 20))
    events = [packet.event for packet in answers(node, 0.0) if isinstance(packet, Event)]
    assert events == ["seen"] * 10
    assert node.rejected == {"event": 12}


@pytest.mark.parametrize("kind", [*get_args(EventKind), "remote_connected"])
def test_no_event_of_a_part_can_pose_as_one_of_the_graph(kind: str) -> None:
    node = talkative(happened=(kind,))
    assert not [packet for packet in answers(node, 0.0) if isinstance(packet, Event)]
    assert node.rejected == {"event": 1}


# --- nothing without them ------------------------------------------------------------------------


def test_without_signals_packets_and_recordings_are_as_before(tmp_path: Path) -> None:
    [answer] = answers(EnvironmentNode(Wall()), 0.02)
    assert answer.signals is UNSET
    assert b"signals" not in encode(answer)
    node = ControllerNode(DirectController())
    node.step(0, [state(0, 0.0)])
    [command] = [p for p in node.step(1, [answer]) if isinstance(p, ForceCommand)]
    assert command.signals is UNSET
    file = tmp_path / "run.mcap"
    run_virtual(load("stiff_wall.yaml"), 0.05, file)
    recording = read(file)
    assert "signals" not in recording.metadata
    assert curves_of(recording) == []
    assert all(getattr(p, "signals", None) is UNSET for p in recording.packets("environment_reply"))


def test_a_damaged_list_of_signals_is_one_line() -> None:
    with pytest.raises(ConfigError, match="signals"):
        declared_signals({"signals": '{"environment_reply": 3}'})


def test_a_stateless_environment_publishes_nothing_of_a_run_before() -> None:
    model = Talkative()
    model.event("seen")
    model.signal("one", 1.0)
    assert signals_of(answers(EnvironmentNode(model), 0.0)) == [UNSET]


def test_a_changed_environment_goes_on_publishing() -> None:
    node = EnvironmentNode(Membrane(stiffness=1000.0, skin=0.0))
    first = answers(node, 0.001)
    node.set(Membrane(stiffness=500.0, skin=0.0), Impairment())
    second = [
        p for p in node.step(5_000_000, [query(5, 0.0005)]) if isinstance(p, EnvironmentReply)
    ]
    assert signals_of(first) + signals_of(list(second)) == [{"damage": 0.5}, {"damage": 0.125}]
