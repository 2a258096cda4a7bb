"""After *Make it safe* a hand that is inside lets go and presses again, under the law as ever."""

import math
from typing import NamedTuple

import pytest
from test_page_state import judged

from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.messages.control import Point, Pointed
from forcebound.messages.events import LAW_CHANGED
from forcebound.messages.packets import Event, Packet, Telemetry, Vector
from forcebound.messages.topology import HAND, flat
from forcebound.observe.page.feed import HandFeed
from forcebound.observe.page.lead import LONGEST_NS, Lead
from forcebound.results.state import Passivity
from forcebound.run.virtual import VirtualGraph

SECOND = 1_000_000_000
LOOK = SECOND // 30
STIFFNESS = 10_000.0  # N/m, of the wall
DEEP, START = 0.02, -0.005  # m, of the pointer; the wall begins at 10 mm


class Felt(NamedTuple):
    """What a hand at rest feels."""

    stiffness: float  # N/m
    words: dict[str, str]


class Visit:
    """Somebody before the page of `pointer_wall`, in virtual time."""

    def __init__(self, *words: str) -> None:
        self.feed, self.packets, self.places = HandFeed(0.0, ()), list[Telemetry](), list[Vector]()
        config = load("pointer_wall", words)
        self.document = flat(to_document(config), HAND)
        self.graph = VirtualGraph(config, self._take, [Telemetry, Event])
        self.device = self.graph.devices[HAND]
        self.lead = Lead(self.point, (START,), self.feed.state)

    def _take(self, packet: Packet) -> None:
        if isinstance(packet, Event):
            if packet.event == LAW_CHANGED and "energy_before" in packet.data:
                energy, law = float(packet.data["energy_before"]), str(packet.data["law"])
                self.document["device"]["law"] = law
                self.feed.begin_law(packet.time_ns, energy, law)
            return
        assert isinstance(packet, Telemetry)
        self.packets.append(packet)
        self.feed.take(packet)

    def point(self, place: Vector) -> None:
        assert isinstance(self.device.handle(Point(place)), Pointed)
        self.places.append(place)

    def run(self, seconds: float) -> Felt:
        """Look at the graph as the page does; return what is felt in the end."""
        until = self.graph.time_ns + round(seconds * SECOND)
        while self.graph.time_ns < until:
            self.graph.run(self.graph.time_ns + LOOK)
            self.feed.frame(1)
            self.lead.look()
        self.feed.state.judged = judged(self.document, self.feed.recent[0])
        words = self.feed.state.describe()
        assert words is not None
        last = self.packets[-300:]
        depth = sum(one.position[0] - 0.010 for one in last)
        return Felt(sum(one.applied_force[0] for one in last) / depth, words)

    def change(self, law: str) -> Felt:
        self.device.set(law)
        return self.run(0.5)


@pytest.fixture(scope="module")
def fresh() -> Felt:
    """What a hand feels in a run that has this law from the start, led in the same way."""
    visit = Visit("operator.start:=20 mm")
    visit.run(1.0)
    visit.feed.state.is_inside = True  # as it is
    visit.lead.begin((DEEP,))
    return visit.run(5.0)


def pressed_without_law() -> Visit:
    visit = Visit("law:=none")
    visit.run(0.5)
    visit.point((DEEP,))
    visit.run(2.0)
    return visit


def test_a_hand_inside_feels_a_soft_wall_since_its_ledger_is_empty_and_the_page_says_so(
    fresh: Felt,
) -> None:
    visit = pressed_without_law()
    soft = visit.change("certified")
    assert soft.stiffness < 0.5 * fresh.stiffness
    assert "the ledger began empty" in soft.words["more"]
    assert "Let go, and press again." in soft.words["more"]
    assert float(soft.words["paid"].rstrip("%")) < 50.0


def test_led_out_and_in_again_it_feels_what_the_law_gives_in_a_fresh_run(fresh: Felt) -> None:
    visit = pressed_without_law()
    visit.lead.begin((DEEP,))
    visit.change("certified")
    again = visit.run(4.0)
    assert visit.places[1] == (START,)
    assert visit.places[-1] == (DEEP,)
    assert again.stiffness == pytest.approx(fresh.stiffness, rel=0.1)
    assert again.stiffness > 0.9 * STIFFNESS
    assert again.words["kind"] == Passivity.PASSIVE
    assert "began empty" not in again.words["more"]
    law = visit.feed._law
    under = [one for one in visit.packets if one.time_ns > law.time_ns]
    assert min(one.true_energy or 0.0 for one in under) - law.energy >= -ENERGY_TOLERANCE


def test_a_hand_that_swung_through_the_surface_is_led_too_and_feels_as_stiff_a_wall(
    fresh: Felt,
) -> None:
    felt = []
    for is_led in (False, True):
        visit = Visit("law:=none", "delay:=5 ms")
        visit.run(0.5)
        visit.point((DEEP,))
        visit.run(3.0)
        swing = [one.position[0] for one in visit.packets[-300:]]
        assert min(swing) < 0.010 < max(swing)
        for link in ("environment_query", "environment_reply"):
            visit.graph.set({f"links.{link}.delay": 0.0})
        if is_led:
            visit.lead.begin((DEEP,))
        visit.change("certified")
        felt.append(visit.run(6.0).stiffness)
    assert felt[0] < 0.5 * fresh.stiffness
    assert felt[1] == pytest.approx(fresh.stiffness, rel=0.1)


def test_a_hand_that_is_moved_by_somebody_is_let_be() -> None:
    visit = pressed_without_law()
    visit.lead.begin((DEEP,))
    visit.lead.end()
    visit.change("certified")
    assert visit.places == [(DEEP,)]


def test_a_hand_outside_or_one_that_nobody_has_moved_is_led_nowhere() -> None:
    for place in ((START,), None):
        visit = Visit("law:=none")
        visit.run(0.5)
        visit.lead.begin(place)
        visit.change("certified")
        visit.run(1.0 + LONGEST_NS / SECOND)
        assert visit.places == []


def test_a_hand_that_gets_nowhere_is_where_it_was_in_the_end() -> None:
    visit = pressed_without_law()
    visit.lead = Lead(visit.point, (DEEP + 1e-3,), visit.feed.state)  # it starts inside
    visit.lead.begin((DEEP,))
    visit.change("certified")
    visit.run(1.0 + LONGEST_NS / SECOND)
    assert visit.places[:2] == [(DEEP,), (DEEP + 1e-3,)]
    assert visit.places[-1] == (DEEP,)
    assert not visit.feed.state.is_led
    assert math.isclose(visit.packets[-1].position[0], 0.012, abs_tol=5e-3)
