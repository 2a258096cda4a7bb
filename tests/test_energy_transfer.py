"""Energy from the ledger of one hand to that of another: debits, protocol, coupled hands."""

import math
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from coupled_hands import HANDS, run_coupled
from fakes import DISSIPATION, device_node
from msgspec.structs import replace

from forcebound.errors import ConfigError
from forcebound.graph.checks import check_energy_partner
from forcebound.graph.graph import HandConfig
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.hands.hands import SinusoidalHand
from forcebound.haptics.laws import LAWS, Dissipation, ForceBounder
from forcebound.haptics.laws.exchange import GRAIN
from forcebound.lab.verification import verify
from forcebound.messages.packets import EnergyTransfer, ForceCommand, Packet, Telemetry
from forcebound.messages.topology import ONE_HAND, graph_of
from forcebound.network.impairment import Impairment
from forcebound.nodes.energy_exchange import EnergyExchange
from forcebound.recordings.recording import Recorder, read

MS = 1_000_000
TOLERANCE = 1e-9  # J
HAND = SinusoidalHand(amplitude=0.02, frequency=1.0)
CERTIFIED = [name for name, law in LAWS.items() if law.is_certified]


def pushed(dissipation: Dissipation = DISSIPATION, axes: int = 1) -> tuple[ForceBounder, int]:
    """Return a bounder whose hand has moved without force, and the time."""
    bounder = ForceBounder("certified", dissipation, axes, exchanges=True)
    bounder.start(0, (0.0,) * axes)
    for n in range(1, 21):
        place = (1e-4 * n,) * axes
        bounder.settle(bounder.bound(n * MS, place, (0.0,) * axes))
    return bounder, 21 * MS


def test_what_one_ledger_gives_is_force_in_the_other() -> None:
    giver, time_ns = pushed()
    getter = ForceBounder("certified", DISSIPATION, exchanges=True)
    getter.start(0, (0.0,))
    before = giver.bound(time_ns, (2e-3,), (8.5,))
    given = giver.debit(math.inf)
    assert given == pytest.approx(giver.estimated_energy, abs=GRAIN)
    assert before[0] > 0.3 > giver.limit == pytest.approx(DISSIPATION.friction, abs=1e-4)
    getter.credit(given)
    (force,) = getter.bound(MS, (0.0,), (8.5,))
    assert force == pytest.approx(before[0], abs=1e-6)


def test_no_more_is_given_than_there_is_and_nothing_without() -> None:
    bounder, time_ns = pushed()
    bounder.bound(time_ns, (2e-3,), (8.5,))
    assert bounder.debit(1e-5) == pytest.approx(1e-5, abs=GRAIN)
    taken = bounder.debit(math.inf)
    assert taken > 1e-5
    assert bounder.debit(math.inf) == 0.0
    for nothing in (0.0, -1.0, math.nan):
        assert bounder.debit(nothing) == 0.0


def test_to_spare_is_what_the_commanded_force_does_not_need() -> None:
    bounder, time_ns = pushed()
    bounder.bound(time_ns, (2e-3,), (0.5,))
    cost = (0.5 - DISSIPATION.least_friction) ** 2 * DISSIPATION.hold_limit / (4 * 0.27)
    assert bounder.spare((0.0,)) - bounder.spare((0.5,)) == pytest.approx(cost)
    assert bounder.spare((8.5,)) < 0.0
    bounder.debit(bounder.spare((0.5,)))
    assert bounder.limit == pytest.approx(0.5, abs=1e-6)


def test_the_decay_of_the_old_force_of_a_lagging_amplifier_is_not_given_away() -> None:
    numbers: dict[str, Any] = {"damping": 0.27, "friction": 0.12, "resolution": 0.0}
    numbers |= {"period": 1e-3, "hold_limit": 1e-3, "saturation": 8.5, "lag": 5e-4}
    bounder, time_ns = pushed(Dissipation(**numbers))
    (force,) = bounder.bound(time_ns, (2e-3,), (8.5,))
    bounder.settle((force,))
    bounder.bound(time_ns + MS, (2.1e-3,), (0.0,))
    left = bounder.estimated_energy  # of the reading before: less than now
    assert 0.0 < bounder.debit(math.inf) < left - 1e-6


@pytest.mark.parametrize("axes", [1, 3, 6])
def test_every_number_of_axes_gives_and_gets(axes: int) -> None:
    gain = Dissipation(
        damping=0.27, friction=0.12, resolution=3e-5, period=1e-3, hold_limit=1.25e-3,
        saturation=8.5, gain_error=0.05,
    )  # fmt: skip
    bounder, time_ns = pushed(gain, axes)
    bounder.bound(time_ns, (2e-3,) * axes, (5.0,) * axes)
    limit = bounder.limit
    given = bounder.debit(2e-6)
    assert given == pytest.approx(2e-6, abs=GRAIN)
    assert bounder.limit < limit
    bounder.settle((0.0,) * axes)
    bounder.credit(given)
    bounder.bound(time_ns + MS, (2e-3,) * axes, (5.0,) * axes)
    assert bounder.limit == pytest.approx(limit, rel=1e-3)


@pytest.mark.parametrize("law", ["none", "aol", "more_conservative"])
def test_a_law_without_a_ledger_of_energy_is_refused(law: str) -> None:
    with pytest.raises(ConfigError):
        ForceBounder(law, DISSIPATION, exchanges=True)


class Life:
    """One hand in a model of the protocol: what its bounders have given and got in all."""

    def __init__(self, hand: str) -> None:
        self.exchange, self.packets = EnergyExchange(hand), list[EnergyTransfer]()
        self.twin = self.exchange  # a process before it, which may still live
        self.given = self.received = 0.0

    def give(self, amount: float) -> None:
        self.exchange.give(amount)
        self.given += amount

    def send(self, time_ns: int) -> None:
        self.packets.append(self.exchange.packet(time_ns))


ACTIONS = ("give",) * 6 + ("send",) * 6 + ("arrive",) * 12 + ("law", "process")


@pytest.mark.parametrize("clock", ["grows", "set back", "two at once"])
@pytest.mark.parametrize("seed", range(30))
def test_nothing_is_credited_twice_whatever_arrives_and_whichever_end_restarts(
    seed: int, clock: str
) -> None:
    random = Random(seed)
    numbers = list(range(1 << 10, 1000 << 10, 1 << 10))  # of processes
    if clock != "grows":
        random.shuffle(numbers)
    lives = Life("left"), Life("right")
    credited: dict[tuple[int, int], list[tuple[float, float]]] = {}  # J, parts of totals
    for life in lives:
        life.exchange.begin()
    for time_ns in range(1, 1000):
        action, who = random.choice(ACTIONS), random.randrange(2)
        life, other = lives[who], lives[1 - who]
        if action == "give":
            life.give(random.randrange(1000) * GRAIN)
        elif action == "send":
            life.send(time_ns)
        elif action == "arrive" and other.packets:
            packet = random.choice(other.packets[-9:])
            if clock == "two at once" and random.random() < 0.3:
                life.exchange, life.twin = life.twin, life.exchange
            life.exchange.take(packet)
            credit = life.exchange.credit()
            life.received += credit
            ways = credited.setdefault((who, packet.ledger), [])
            start, end = packet.given - credit, packet.given
            assert all(end <= one or start >= another for one, another in ways if credit)
            if credit:
                ways.append((start, end))
        elif action == "law":
            life.exchange.begin()
        elif action == "process":
            life.twin, life.exchange = life.exchange, EnergyExchange("", numbers.pop(0))
            life.exchange.begin()
        assert lives[0].received <= lives[1].given
        assert lives[1].received <= lives[0].given


def meet(one: EnergyExchange, other: EnergyExchange, time_ns: int) -> None:
    """Let both sides know each other."""
    for _ in range(2):
        other.take(one.packet(time_ns))
        one.take(other.packet(time_ns + 1))
        time_ns += 2


def test_all_that_was_given_arrives_after_losses_and_a_new_law() -> None:
    giver, getter = Life("left"), Life("right")
    for life in (giver, getter):
        life.exchange.begin()
    meet(giver.exchange, getter.exchange, 1)
    for n in range(10, 100):
        if n == 50:
            giver.exchange.begin()
        elif n != 51:
            giver.give(GRAIN * n)
        giver.send(n)
        if n in (20, 49, 51, 99) or n % 7 == 0:  # the others are lost
            getter.exchange.take(giver.packets[-1])
            getter.received += getter.exchange.credit()
    assert getter.received == giver.given > 0.0


def test_nothing_is_offered_before_the_other_side_knows_this_ledger() -> None:
    one, other = EnergyExchange("left"), EnergyExchange("right")
    one.begin()
    other.begin()
    assert one.offer(1.0) == 0.0
    one.take(other.packet(12))
    assert one.offer(1.0) == 0.0
    meet(one, other, 13)
    assert one.offer(1.0) == 0.5
    one.give(0.5)
    assert one.offer(0.5) == 0.0  # what is on its way counts as the other's
    one.begin()
    assert one.offer(1.0) == 0.0


def test_a_new_process_takes_nothing_from_packets_that_its_predecessor_may_have_had() -> None:
    giver, before = EnergyExchange("left"), EnergyExchange("right")
    giver.begin()
    before.begin()
    meet(giver, before, 2)
    giver.give(1.0)
    late = giver.packet(10)
    giver.give(1.0)
    last = giver.packet(11)
    before.take(last)
    assert before.credit() == 2.0
    after = EnergyExchange("right", 12)
    after.begin()
    after.take(late)
    after.take(last)
    assert after.credit() == 0.0
    giver.take(after.packet(13))
    after.take(giver.packet(14))
    giver.give(1.0)
    after.take(giver.packet(15))
    assert after.credit() == 1.0


def test_a_hand_whose_force_has_not_engaged_gets_nothing() -> None:
    one, other = EnergyExchange("left"), EnergyExchange("right")
    one.begin()
    other.take(one.packet(11))
    assert other.packet(12).seen_ledger == 0


def energies(found: dict[str, list[Telemetry]]) -> dict[str, dict[str, Any]]:
    names = ("true_energy", "given_energy", "received_energy")
    return {
        hand: {name: np.array([getattr(one, name) or 0.0 for one in ticks]) for name in names}
        for hand, ticks in found.items()
    }


def travel(ticks: list[Telemetry]) -> float:
    """How far a hand has moved in the last second, m."""
    places = [one.true_position[0] for one in ticks[-1000:] if one.true_position is not None]
    return max(places) - min(places)


def check_promises(found: dict[str, dict[str, Any]]) -> None:
    """Check the energy of both hands, and that of each with what it gave and got."""
    left, right = (found[hand]["true_energy"] for hand in HANDS)
    assert (left + right).min() >= -TOLERANCE
    for one in found.values():
        credit = one["true_energy"] + one["received_energy"] - one["given_energy"]
        assert credit.min() >= -TOLERANCE
        assert one["received_energy"][-1] > 0.0


BAD = Impairment(delay=5e-3, jitter=4e-3, loss=0.3, duplicate=0.3)


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize(("delay", "bad"), [(0.0, None), (0.02, None), (0.0, BAD)])
def test_two_coupled_hands_keep_their_promises(
    law: str, delay: float, bad: Impairment | None
) -> None:
    operators = {"left": HAND, "right": SinusoidalHand(amplitude=0.01, frequency=2.3)}
    found = energies(run_coupled(operators, 1.5, law=law, delay=delay, impairment=bad))
    left, right = (found[hand] for hand in HANDS)
    check_promises(found)
    for one, other in ((left, right), (right, left)):
        assert 0.0 < one["received_energy"][-1] <= other["given_energy"][-1]


class Restarting(EnergyExchange):
    """Each new ledger is that of a new process, whose number may be smaller than the one before."""

    random = Random(0)

    def begin(self) -> None:
        given, received = self.given, self.received
        super().__init__(self._hand, self.random.randrange(1, 2**40) << 10, self._limit)
        self.given, self.received = given, received
        super().begin()


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize("seed", range(3))
def test_hands_whose_processes_restart_keep_their_promises_over_a_bad_link(
    monkeypatch: pytest.MonkeyPatch, law: str, seed: int
) -> None:
    monkeypatch.setattr("forcebound.nodes.device.EnergyExchange", Restarting)
    monkeypatch.setattr(Restarting, "random", random := Random(seed))
    times = sorted(random.uniform(0.1, 1.9) for _ in range(6))
    operators = {"left": HAND, "right": SinusoidalHand(amplitude=0.01, frequency=2.3)}
    restarts = [(time, random.choice(HANDS)) for time in times]
    packets: list[Packet] = []
    ticks = run_coupled(
        operators, 2.0, law=law, impairment=BAD, restarts=restarts, observe=packets.append
    )
    ledgers = {one.ledger for one in packets if isinstance(one, EnergyTransfer)} - {0}
    assert len(ledgers) > 4
    check_promises(energies(ticks))


def test_a_hand_that_has_stopped_gives_nothing() -> None:
    # Its ledger does not know that the force is gone, and counts work that was not done.
    operators = {"left": HAND, "right": SinusoidalHand(amplitude=0.01, frequency=2.3)}
    ticks = run_coupled(operators, 0.405, stops=[(0.3985, "left")])["left"]
    given = [one.given_energy for one in ticks if one.time_ns > 398e6]
    assert len(given) > 5
    assert given[0] == given[-1] != 0.0


def test_a_hand_gets_no_more_than_its_limit_beyond_what_it_gave() -> None:
    one, other = EnergyExchange("left"), EnergyExchange("right", limit=0.25)
    one.begin()
    other.begin()
    meet(one, other, 1)
    one.give(1.0)
    other.take(one.packet(10))
    assert (other.credit(), other.credit()) == (0.25, 0.0)
    other.give(0.5)
    assert (other.credit(), other.received) == (0.5, 0.75)
    other.give(math.inf)
    assert other.credit() == 0.25  # nothing more has come


@pytest.mark.parametrize("limit", [0.0, 1e-3])
def test_a_partner_that_lies_gives_a_hand_no_more_than_the_limit(
    monkeypatch: pytest.MonkeyPatch, limit: float
) -> None:
    class Liar(EnergyExchange):
        """The left hand's: it says that it has given 10 mJ more in each packet."""

        def packet(self, time_ns: int) -> EnergyTransfer:
            packet = super().packet(time_ns)
            if self._hand != "left" or self._ledger == 0:
                return packet
            return replace(packet, given=packet.given + 0.01 * packet.seq, spare=1e3)

    def lowest(most: float | None) -> float:
        class Limited(Liar):
            def __init__(self, hand: str, process: int, of: float | None) -> None:
                super().__init__(hand, process, most)

        monkeypatch.setattr("forcebound.nodes.device.EnergyExchange", Limited)
        operators = {"left": HAND, "right": SinusoidalHand(amplitude=0.01, frequency=2.3)}
        found = energies(run_coupled(operators, 1.0, delay=0.02, stiffness=2000.0))
        return float(found["right"]["true_energy"].min())

    assert lowest(limit) >= -limit - TOLERANCE
    assert lowest(None) < -2e-3  # so the limit is what bounds it


def test_a_hand_that_nobody_holds_follows_only_with_transfer() -> None:
    operators = {"left": HAND, "right": None}
    alone = run_coupled(operators, 2.0, exchanges=False)
    assert travel(alone["right"]) < 3e-5
    assert max(abs(one.applied_force[0]) for one in alone["right"]) <= 0.12 + 1e-9
    found = run_coupled(operators, 2.0)
    assert travel(found["right"]) == pytest.approx(travel(found["left"]), rel=0.05)
    assert travel(found["right"]) > 0.03


def test_the_leader_does_the_work_of_a_follower_that_dissipates() -> None:
    operators, light = {"left": HAND, "right": None}, PhantomPremium15()
    heavy = PhantomPremium15(damping=2.7)
    easy, hard = (
        energies(run_coupled(operators, 2.0, damping=1.0, devices={"right": one}))
        for one in (light, heavy)
    )
    lost = hard["right"]["received_energy"][-1] - hard["right"]["given_energy"][-1]
    assert hard["left"]["true_energy"][-1] > easy["left"]["true_energy"][-1] + 0.02
    assert hard["left"]["true_energy"][-1] > lost > 0.02


def test_energy_comes_back_when_the_follower_is_pushed() -> None:
    found = energies(run_coupled({"left": None, "right": HAND}, 1.0))
    assert found["left"]["received_energy"][-1] > found["left"]["given_energy"][-1]


def test_a_hand_without_a_partner_takes_no_energy_and_sends_no_packet() -> None:
    node, _ = device_node(law="certified")
    packet = EnergyTransfer(0, 0, 1, 5.0, 0.0, 0, 0.0)
    sent: list[Packet] = []
    for _ in range(4):
        sent += node.step(node.wake_ns, [packet])
    assert node.status().rejected == {"unexpected": 4}
    assert not any(isinstance(one, EnergyTransfer) for one in sent)


def test_a_running_hand_with_a_partner_takes_no_law_that_cannot_exchange() -> None:
    node, _ = device_node(law="certified", energy_partner="right")
    with pytest.raises(ConfigError):
        node.set("none")
    node.set("tdpa")


def test_a_new_law_begins_a_new_ledger_with_the_totals_going_on() -> None:
    node, _ = device_node(law="certified", energy_partner="right")
    node.engage()
    sent: list[Packet] = []
    for n in range(40):
        if n == 20:
            node.set("certified_fading")
        sent += node.step(node.wake_ns, [])
    transfers = [one for one in sent if isinstance(one, EnergyTransfer)]
    ledgers = list(dict.fromkeys(one.ledger for one in transfers))
    assert len(ledgers) == 2
    assert ledgers == sorted(ledgers)
    assert [one.seq for one in transfers] == list(range(20))  # one a tick


@pytest.mark.parametrize("hand", HANDS)
def test_a_recording_is_verified_with_the_energy_that_came_and_went(
    tmp_path: Path, hand: str
) -> None:
    operators = {"left": HAND, "right": SinusoidalHand(amplitude=0.01, frequency=2.3)}
    packets: list[Packet] = []
    found = run_coupled(operators, 0.5, observe=packets.append)[hand]
    assert found[-1].given_energy
    assert found[-1].received_energy
    partner = {"left": "right", "right": "left"}[hand]
    servo = ServoSettings(energy_partner=partner, age_limit=1.0)
    config = HandConfig(PhantomPremium15(), servo)
    for extra in (0.0, GRAIN):
        path = tmp_path / f"{extra}.mcap"
        with Recorder(path, {"launch": "{}"}) as recorder:
            for packet in packets:
                if isinstance(packet, Telemetry | ForceCommand) and packet.hand == hand:
                    one = replace(packet, hand="hand")
                    if isinstance(one, Telemetry) and one.seq >= 400:
                        one = replace(one, received_energy=(one.received_energy or 0.0) + extra)
                    recorder.write(one)
        assert verify(read(path), config).is_same == (extra == 0.0)


def test_partners_are_mutual_and_their_laws_can_exchange() -> None:
    left, right = (ServoSettings(energy_partner=one) for one in HANDS[::-1])
    sound = {"left": left, "right": right, "third": ServoSettings()}
    for name in sound:
        check_energy_partner(name, sound)
    none = ServoSettings(law="none", energy_partner="left")
    itself = {"right": ServoSettings(), "left": ServoSettings(energy_partner="left")}
    for wrong in ({"left": left}, {"left": left, "right": ServoSettings()}, itself):
        with pytest.raises(ConfigError) as caught:
            check_energy_partner("left", wrong)
        assert caught.value.field == "energy_partner"
    with pytest.raises(ConfigError, match="law none"):
        check_energy_partner("right", {"left": left, "right": none})


def test_streams_of_energy_go_from_device_to_device() -> None:
    graph = graph_of((*HANDS, "third"), exchanges=[HANDS])
    ways = {
        one.name: (one.sender, one.receiver)
        for one in graph.links
        if one.topic == "energy_transfer"
    }
    assert ways == {
        "left/energy_transfer": ("left/device", "right/device"),
        "right/energy_transfer": ("right/device", "left/device"),
    }
    assert "energy_transfer" not in {one.topic for one in ONE_HAND.streams}
