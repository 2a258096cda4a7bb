"""The virtual-time runner: order of events, determinism, and the physics of a whole graph."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fakes import press

from forcebound.errors import ConfigError
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.laws import LAWS
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import DeviceState, Telemetry
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.nodes.controller import ControllerNode
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.simulation import Simulation


def run(law: str, seconds: float = 4.0, **graph: Any) -> TelemetryColumns:
    """Press a hand into a stiff wall and return what the device reports; see ``fakes.press``."""
    packets = press(law, seconds, **graph)
    return TelemetryColumns.from_packets([p for p in packets if isinstance(p, Telemetry)])


def test_with_instant_links_every_force_answers_its_own_tick_without_delay() -> None:
    columns = run("none", 0.5)
    assert len(columns.seq) == 500
    assert np.array_equal(columns.device_seq, columns.seq)
    assert np.all(columns.loop_delay == 0.0)
    assert columns.deadline_misses[-1] == 0


def test_a_delay_both_ways_is_the_loop_delay() -> None:
    delay = Impairment(delay=2e-3)
    columns = run("certified", 0.5, environment_query=delay, environment_reply=delay)
    assert np.all(columns.device_seq[:4] == -1)
    assert columns.loop_delay[4:] == pytest.approx(4e-3)


def test_a_busy_environment_answers_once_per_computation() -> None:
    columns = run("certified", 1.0, computation=ComputationTime(Impairment(0.005)))
    answers = np.unique(columns.device_seq[columns.device_seq >= 0])
    assert len(answers) == pytest.approx(200, abs=2)
    assert columns.loop_delay[20:].max() == pytest.approx(9e-3, abs=1.1e-3)


def test_at_rest_the_hand_sinks_into_a_soft_wall_by_force_over_stiffness() -> None:
    columns = run("none", 3.0, environment=Wall(stiffness=200.0))
    depth = columns.true_position[-1, 0] - 0.010
    assert columns.applied_force[-1, 0] / depth == pytest.approx(200.0, rel=0.02)
    hand = 950.0 * (0.014 - columns.true_position[-1, 0])
    assert abs(hand - columns.applied_force[-1, 0]) <= 0.12 + 1e-9


def test_more_conservative_viscous_shows_exactly_two_b() -> None:
    columns = run("more_conservative_viscous", 5.0)
    late = columns.elapsed > 2.0
    depth = columns.position[late, 0] - 0.010
    assert np.mean(columns.applied_force[late, 0] / depth) == pytest.approx(540.0, rel=0.05)


def test_without_a_law_a_late_stiff_wall_throws_the_hand_about_and_gives_energy() -> None:
    late = Impairment(delay=2e-3)
    columns = run("none", environment_query=late, environment_reply=late)
    assert columns.true_energy.min() < -0.01
    assert np.std(columns.true_position[-500:, 0]) > 1e-4


@pytest.mark.parametrize("law", ["certified", "certified_fading"])
@pytest.mark.parametrize(("delay", "loss"), [(0.0, 0.0), (2e-3, 0.3), (10e-3, 0.0), (10e-3, 0.3)])
def test_a_certified_law_never_gives_energy_and_the_hand_comes_to_rest(
    law: str, delay: float, loss: float
) -> None:
    late = Impairment(delay=delay, jitter=delay / 2, loss=loss)
    columns = run(law, 5.0, environment_query=late, environment_reply=late)
    assert columns.true_energy.min() >= -1e-9
    assert np.ptp(columns.true_position[-500:, 0]) < 3e-5
    assert columns.applied_force[-1, 0] > 0.3


def test_the_same_seed_gives_the_same_bits_and_another_seed_others() -> None:
    late = Impairment(delay=2e-3, jitter=1e-3, loss=0.1)
    first, again = (run("certified", 1.0, environment_query=late) for _ in range(2))
    assert first.true_position.tobytes() == again.true_position.tobytes()
    perfect = run("certified", 1.0)
    assert first.true_position.tobytes() != perfect.true_position.tobytes()


def test_a_graph_without_a_publisher_is_refused() -> None:
    controller = ControllerNode(DirectController())
    with pytest.raises(ConfigError, match="no node of the graph publishes device_state"):
        Simulation([controller], {}, print)


@pytest.mark.parametrize(
    ("law", "delay"), [("certified", 0.0), ("certified", 0.06), *((law, 2e-3) for law in LAWS)]
)
def test_what_the_protocol_promises_of_every_tick_holds(law: str, delay: float) -> None:
    """The invariants of docs/protocol.md, on every packet of a run over a bad network."""
    late = Impairment(delay=delay, jitter=delay / 2, loss=delay * 5)
    packets = press(law, 1.0, servo=ServoSettings(), environment_query=late, environment_reply=late)
    for packet in packets:
        assert decode(encode(packet)) == packet
    states = [p for p in packets if isinstance(p, DeviceState)]
    telemetry = [p for p in packets if isinstance(p, Telemetry)]
    assert [p.seq for p in states] == [p.seq for p in telemetry]
    newest = -1
    for before, now in pairwise(telemetry):
        assert now.seq > before.seq
        assert now.time_ns > before.time_ns
        assert now.elapsed >= before.elapsed
        applied, commanded = math.hypot(*now.applied_force), math.hypot(*now.commanded_force)
        assert applied <= now.force_limit <= 8.5
        if not LAWS[law].adds_damping:
            assert applied <= commanded
            assert now.applied_force[0] * now.commanded_force[0] >= 0.0
        if now.device_seq is None:
            assert commanded == now.engagement == 0.0
        else:
            assert newest <= now.device_seq <= now.seq
            assert now.loop_delay is not None
            assert now.loop_delay <= 0.1
            newest = now.device_seq
