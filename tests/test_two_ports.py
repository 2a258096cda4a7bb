"""Controllers with a second port at the environment: what both ends exchange, and what is felt.

The figures are those of the methods' authors. Each has its contrast, where it must fail.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from random import Random

import pytest
from two_ports import PERIOD, Row, exchange

from forcebound.graph.graph import GraphConfig
from forcebound.haptics.controllers import ControllerModel
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.controllers.tdpa_two_port import TdpaTwoPort
from forcebound.haptics.controllers.wave_variables import WaveVariables
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply, Packet
from forcebound.run.virtual import VirtualGraph, run_virtual

Delays = Callable[[int], Sequence[int]]  # of the copies of a packet, in ticks

TDPA, DRIFTING = TdpaTwoPort(), TdpaTwoPort(drift_compensation=False)
WAVES = WaveVariables(impedance=4.0, cutoff=1000.0)
METHODS = {"tdpa": TDPA, "drifting": DRIFTING, "waves": WAVES}
STIFFNESS = 1000.0  # N/m, of a wall at 0


def wall(place: float) -> float:
    return STIFFNESS * max(place, 0.0)


def free(place: float) -> float:
    return 0.0


def strokes(tick: int, force: float) -> float:
    """A hand that goes 4 mm in and out, whatever the force, and in the end stays out."""
    return 0.004 * math.sin(2.0 * math.pi * min(tick * PERIOD, 2.75))


class Mass:
    """A hand: a mass, in kg, with a damping, in N s/m, that is pushed."""

    def __init__(self, mass: float, damping: float, push: Callable[[float], float]) -> None:
        self.mass, self.damping, self.push = mass, damping, push
        self.place = self.speed = 0.0

    def __call__(self, tick: int, force: float) -> float:
        pushed = self.push(tick * PERIOD) - force - self.damping * self.speed
        self.speed += pushed / self.mass * PERIOD
        self.place += self.speed * PERIOD
        return self.place


def constant(ticks: int) -> Delays:
    return lambda number: [ticks]


def a_bad_network(seed: int) -> Delays:
    """Late, overtaken, lost and doubled packets."""
    random = Random(seed)
    return lambda number: random.choice([[], *[[random.randrange(2, 40)]] * 9, [5, 30]])


NETWORKS: dict[str, Callable[[], tuple[Delays, ...]]] = {
    "at once": lambda: (constant(0),),
    "constant": lambda: (constant(20),),
    "rising": lambda: (lambda number: [5 + number // 40],),
    "falling": lambda: (lambda number: [95 - number // 40],),
    "bad": lambda: (a_bad_network(1), a_bad_network(2)),
}


def excess(taken: list[float], put_in: list[float]) -> float:
    """The most that came out of a port beyond what the other one had put in, in J."""
    return max(out - entered for out, entered in zip(taken, put_in, strict=True))


def counted(rows: list[Row]) -> tuple[float, float]:
    """The excess at the hand, and at the environment, as the ports count."""
    rows = [row for row in rows if row.port]
    return (
        excess([r.hand["energy_out"] for r in rows], [r.port["port_energy_in"] for r in rows]),
        excess([r.port["port_energy_out"] for r in rows], [r.hand["energy_in"] for r in rows]),
    )


def measured(rows: list[Row]) -> tuple[float, float]:
    """The same from motion and force alone, where no packet overtakes another."""
    into: list[list[float]] = [[0.0], [0.0]]
    out: list[list[float]] = [[0.0], [0.0]]
    for before, row in pairwise(rows):
        at_hand = before.force * (row.position - before.position)
        at_wall = -wall(before.place) * (row.place - before.place)
        for port, energy in enumerate((at_hand, at_wall)):
            into[port].append(into[port][-1] + max(energy, 0.0))
            out[port].append(out[port][-1] + max(-energy, 0.0))
    return excess(out[0], into[1]), excess(out[1], into[0])


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("method", METHODS)
def test_no_port_takes_out_what_the_other_one_has_not_put_in(method: str, network: str) -> None:
    rows = exchange(METHODS[method], wall, strokes, 3000, *NETWORKS[network]())
    at_hand, at_wall = counted(rows)
    assert at_wall < 1e-15
    # Its force is for the step that the hand makes next, and the hand turns round.
    assert at_hand < (1e-15 if method == "waves" else 2e-6)
    assert rows[-1].hand["energy_in"] > 1e-6  # there was something to count


@pytest.mark.parametrize("delay", [5, 20, 100])
def test_energies_of_a_delayed_network_are_positive_only_with_the_two_ports(delay: int) -> None:
    """Ryu, Artigas and Preusche 2010: each port's output stays below the other one's input."""
    with_ports = measured(exchange(TDPA, wall, strokes, 3000, constant(delay)))
    without = measured(exchange(DirectController(), wall, strokes, 3000, constant(delay)))
    assert max(with_ports) < 2e-6
    assert max(without) > 1e-3


def test_the_drift_of_a_contact_stays_and_its_compensation_takes_it_away() -> None:
    """Artigas, Ryu and Preusche 2010: position drift compensation."""
    stays = exchange(DRIFTING, wall, strokes, 3000, constant(20))
    vanishes = exchange(TDPA, wall, strokes, 3000, constant(20))
    assert stays[-1].position == vanishes[-1].position < 0.0  # out of the wall, at rest
    assert stays[-1].position - stays[-1].place > 1e-3
    assert vanishes[-1].place == pytest.approx(vanishes[-1].position, abs=1e-9)
    assert max(row.port["drift"] for row in vanishes if row.port) > 1e-3  # there was one


@pytest.mark.parametrize("method", [TDPA, DRIFTING])
def test_free_motion_is_free_with_two_port_passivity_control(method: ControllerModel) -> None:
    rows = exchange(method, free, strokes, 2000, constant(20))
    assert {row.force for row in rows} == {0.0}
    assert rows[-1].place == pytest.approx(rows[-21].position, abs=1e-12)


@pytest.mark.parametrize("delay", [5, 20, 100])
def test_a_delayed_wave_feels_as_a_spring_at_a_stiff_wall(delay: int) -> None:
    """Niemeyer and Slotine 2004: b / T, in series with the wall."""
    rows = exchange(WAVES, wall, Mass(0.3, 4.0, lambda time: 1.0), 6000, constant(delay))
    assert rows[-1].force == pytest.approx(1.0, rel=0.01)  # at rest
    assert rows[-1].place == pytest.approx(1.0 / STIFFNESS, rel=0.01)  # in the wall: no drift
    # The wave stands half a tick at each end: 1 ms of the round trip.
    spring = WAVES.impedance / ((delay + 0.5) * PERIOD)
    felt = rows[-1].force / rows[-1].position
    assert felt == pytest.approx(1.0 / (1.0 / STIFFNESS + 1.0 / spring), rel=0.05)


@pytest.mark.parametrize("delay", [5, 20, 100])
def test_a_delayed_wave_feels_as_a_mass_in_free_motion(delay: int) -> None:
    """Niemeyer and Slotine 2004: b T."""
    acceleration = 0.1  # m/s^2
    rows = exchange(
        WAVES,
        free,
        lambda tick, _: 0.5 * acceleration * (tick * PERIOD) ** 2,
        3000,
        constant(delay),
    )
    felt = sum(row.force for row in rows[1000:]) / 2000 / acceleration
    assert felt == pytest.approx(WAVES.impedance * delay * PERIOD, rel=0.03)


def test_a_matched_impedance_absorbs_the_waves_that_others_throw_back() -> None:
    """Niemeyer and Slotine 2004: reflections have a period of 4 T, and none where b is matched."""

    def speeds(mass: float, damping: float) -> list[float]:
        """Largest speeds, with their sign, in the push of 2 T and each 2 T after it."""
        hand = Mass(mass, damping, lambda time: math.sin(math.pi * min(time / 0.2, 1.0)) ** 2)
        rows = exchange(WAVES, free, hand, 805, constant(100))
        steps = [row.position - before.position for before, row in pairwise(rows)]
        return [max(steps[at : at + 200], key=abs) for at in (2, 202, 402, 602)]

    push, *echoes = speeds(0.02, WAVES.impedance)
    assert max(map(abs, echoes[1:])) < 0.05 * push  # the first one is the wave that comes back
    push, *echoes = speeds(0.2, 20.0 * WAVES.impedance)
    assert [abs(echo) > 0.05 * push for echo in echoes] == [True] * 3
    assert [echo > 0.0 for echo in echoes] == [True, False, True]


# In a graph


def run_of(packets: list[Packet], **arguments: object) -> GraphConfig:
    config = GraphConfig.read("stiff_wall", law="none", age_limit="300 ms", **arguments)
    graph = VirtualGraph(config, packets.append, (EnvironmentQuery, EnvironmentReply))
    graph.run(200_000_000)
    graph.close()
    return config


@pytest.mark.parametrize("method", ["tdpa_two_port", "wave_variables"])
def test_queries_and_replies_carry_the_signals_of_both_ports(method: str) -> None:
    packets: list[Packet] = []
    config = run_of(packets, controller=method)
    queries = [packet for packet in packets if isinstance(packet, EnvironmentQuery)]
    replies = [packet for packet in packets if isinstance(packet, EnvironmentReply)]
    model = config.only.controller
    assert len(queries) > 100 < len(replies)
    for declared, packet in ((model.signals, queries[-1]), (model.port_signals, replies[-1])):
        assert set(dict(packet.signals or {})) == {signal.name for signal in declared}
        assert decode(encode(packet)) == packet


def test_a_query_of_others_has_no_signals() -> None:
    packets: list[Packet] = []
    run_of(packets, controller="direct")
    assert b"signals" not in b"".join(map(encode, packets))


@pytest.mark.parametrize("delay", ["5 ms", "100 ms"])
def test_waves_stay_passive_at_a_stiff_wall_where_its_late_force_alone_does_not(delay: str) -> None:
    """Anderson and Spong 1989, Niemeyer and Slotine 1991: passive at any constant delay."""

    def given(method: str) -> float:
        arguments = {"law": "none", "age_limit": "300 ms", "delay": delay, "controller": method}
        run = run_virtual(GraphConfig.read("stiff_wall", **arguments))
        return -float(min(run.columns.true_energy))

    assert given("wave_variables") < 1e-6
    assert given("direct") > 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("axes", [1, 3, 8])
def test_a_second_port_answers_with_numbers_that_it_declares(method: str, axes: int) -> None:
    model, random = METHODS[method], Random(1)
    port = model.open_port(axes)
    assert port is not None
    signals = {signal.name: 1e-3 for signal in model.signals}
    for seq in range(200):
        place, speed = (tuple(random.uniform(-0.01, 0.01) for _ in range(axes)) for _ in "xv")
        times = (seq, seq * 1_000_000, seq, seq * 1_000_000)
        query = EnvironmentQuery(*times, 0.0, place, speed, None, signals=signals)
        force, sent = port.answer(query, signals, lambda place, _: tuple(map(wall, place)))
        assert len(force) == axes
        assert all(map(math.isfinite, (*force, *sent.values())))
        assert sent.keys() == {signal.name for signal in model.port_signals}


def test_a_world_with_a_state_of_its_own_first_hears_of_the_motion_that_is_then_made() -> None:
    """With the first question of a wave it moves on, so that one must be close to the answer."""
    asked: list[tuple[float, float]] = []

    def ask(position: tuple[float, ...], velocity: tuple[float, ...]) -> tuple[float, ...]:
        asked.append((position[0], velocity[0]))
        return (wall(position[0]),)

    port = WAVES.open_port(1)
    for seq in range(1, 200):
        asked.clear()
        times = (seq, seq * 1_000_000, seq, seq * 1_000_000)
        query = EnvironmentQuery(*times, 0.0, (0.0,), (0.05,), None)
        (force,), _ = port.answer(query, {"wave_time": PERIOD}, ask)
    made = 0.05 - force / WAVES.impedance
    assert force == pytest.approx(0.05 * WAVES.impedance, rel=1e-3)  # the wall has stopped it
    assert asked[0][1] == pytest.approx(made, abs=1e-4)
    assert asked[1][1] == 0.05  # without a force: the solution begins there
