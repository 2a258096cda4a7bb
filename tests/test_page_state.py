"""The state of the live page: its words, and that the verdict on the same run has the same."""

from collections.abc import Sequence
from typing import Any, cast

import pytest
from builders import MS, telemetry_packet
from msgspec.structs import replace

from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.messages.control import BounderReport
from forcebound.messages.packets import Telemetry
from forcebound.messages.topology import Document, flat
from forcebound.observe.page.feed import HandFeed
from forcebound.observe.page.state import Judged
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.figures import OF_STATE
from forcebound.results.promises import broken_promises
from forcebound.results.samples import Samples
from forcebound.results.state import state
from forcebound.results.summary import figures_of
from forcebound.run.virtual import VirtualGraph

REPORT = BounderReport(hold_limit=1.02e-3, longest_hold_limit=1.02e-3)
BLOCK = 33  # samples of a frame
WORDED = 8  # frames between two wordings


def judged(document: Document, packets: Sequence[Telemetry], cause: str = "") -> Judged:
    """What the controls know of a hand."""
    run = Samples(TelemetryColumns.from_packets(packets), {"device": document["device"]})
    run.report = REPORT
    return Judged(document, REPORT, cause, broken_promises(run))


def shown(
    packets: Sequence[Telemetry], document: Document, feed: HandFeed, cause: str = ""
) -> dict[str, str]:
    """The state after all packets, of a page that has seen them come."""
    words = None
    for number, start in enumerate(range(0, len(packets), BLOCK)):
        for packet in packets[start : start + BLOCK]:
            feed.take(packet)
        feed.frame(1)
        if number % WORDED == 0:
            feed.state.judged = judged(document, feed.recent[0], cause)
            feed.state.describe()
    feed.state.judged = judged(document, feed.recent[0], cause)
    words = feed.state.describe()
    assert words is not None
    return words


def recorded(file: str, *words: str, seconds: float = 3.0) -> tuple[list[Telemetry], Document]:
    """The telemetry of a run in virtual time."""
    config, packets = load(file, words), list[Telemetry]()
    hand = next(iter(config.hands))

    def keep(packet: object) -> None:
        if cast("Telemetry", packet).hand == hand:
            packets.append(cast("Telemetry", packet))

    VirtualGraph(config, keep, [Telemetry]).run(round(seconds * 1e9))
    return packets, flat(to_document(config), hand)


CASES = {
    "certified": ("stiff_wall", "delay:=5 ms"),
    "leaks": ("stiff_wall", "law:=none", "delay:=5 ms"),
    "leaks, at rest": ("stiff_wall", "law:=none", "stiffness:=1.5 N/mm", "delay:=1 ms"),
    "no law, no leak": ("stiff_wall", "law:=none", "stiffness:=0.2 N/mm"),
    "observer": ("stiff_wall", "law:=tdpa", "delay:=2 ms"),
    "moves": ("three_axes",),
    "slides": ("sliding_friction",),
    "arm": ("five_bar_wall",),
    "moved by nobody": ("released_hand",),
    "palpation": ("palpation",),
    "two hands": ("two_hands",),
    "follower": ("leader_follower_transfer",),
}


@pytest.mark.parametrize("is_real", [False, True], ids=["simulated", "as of a real device"])
@pytest.mark.parametrize("name", CASES)
def test_the_page_says_at_the_end_what_the_verdict_says(name: str, is_real: bool) -> None:
    packets, document = recorded(*CASES[name])
    if is_real:
        packets = [
            replace(p, true_energy=None, true_position=None, hand_force=None) for p in packets
        ]
    words = shown(packets, document, HandFeed(0.0, ()))
    run = Samples(TelemetryColumns.from_packets(packets), document)
    run.report = REPORT
    summary = figures_of(run, OF_STATE)
    verdict = state(summary, launched(document))
    head = words["head"].removeprefix("No law. ")
    assert head.startswith(f"{verdict.head}. ")
    assert ("At rest." in head) == bool(summary["at_rest"])
    if document["device"]["law"] != "none" or verdict.kind != "passive":
        assert words["kind"] == verdict.kind
    if verdict.kind != "passive":  # of a real device the newest ticks are still to come
        known = verdict.known.split("up to")[0] if is_real else verdict.known
        assert words["more"].lower().startswith(known.lower())


def test_page_and_verdict_name_the_same_broken_promise() -> None:
    packets, document = recorded("stiff_wall", "delay:=1 ms")
    document["device"] |= {"write_delay": -1.0, "allowance": -1.0}  # each force acts later, unpaid
    words = shown(packets, document, HandFeed(0.0, ()))
    run = Samples(TelemetryColumns.from_packets(packets), document)
    run.report = REPORT
    verdict = state(figures_of(run, OF_STATE), launched(document))
    assert words["kind"] == verdict.kind == "uncovered"
    assert words["head"].startswith(verdict.head)
    assert words["more"].startswith(verdict.known.partition("; since contact")[0])


DEVICE: Document = {"kind": "x", "law": "certified", "rate": 1000.0}
HEALTHY: dict[str, Any] = {
    "swing": 0.0,
    "applied": 20.0,
    "fall": 0.01,
    "lost": 0.0,
    "engagement": 1.0,
}


def words_of(law: str = "certified", cause: str = "", **change: Any) -> dict[str, str]:
    """The state after two seconds of samples, with some changes to a hand at rest in a wall."""
    case = HEALTHY | {"is_true": True, "away": 0.0, "delay": 1e-3, "engagement": 1.0} | change
    packets = []
    for tick in range(2001):
        time, is_in = tick * 1e-3, tick <= 2000 - 1e3 * case["away"]
        place = (0.012 + case["swing"] * (-1.0) ** (tick // 100),)
        energy = case["fall"] * time
        packets.append(
            telemetry_packet(
                tick,
                position=place,
                true_position=place if case["is_true"] else None,
                true_energy=energy if case["is_true"] else None,
                estimated_energy=energy,
                commanded_force=(20.0 if is_in else 0.0,),
                applied_force=(case["applied"] if is_in else 0.0,),
                deadline_misses=round(case["lost"] * tick),
                loop_delay=case["delay"],
                engagement=case["engagement"],
                read_ns=tick * MS,
                write_ns=tick * MS + 400_000,
            )
        )
    document = {"device": {**DEVICE, "law": law, **case.get("device", {})}}
    document |= {"operator": {"kind": case.get("holder", "pressing")}}
    return shown(packets, document, HandFeed(0.0, ()), cause)


LATE_WRITES = {"write_delay": 3e-4, "allowance": -1.0}  # no allowance: nothing is paid


@pytest.mark.parametrize(
    ("change", "kind", "head", "more"),
    [
        ({}, "passive", "Passive. At rest.", "all 20 N"),
        ({"swing": 5e-3}, "passive", "In contact.", "all 20 N"),
        ({"applied": 5.0}, "passive", "At rest.", "5 N of the 20 N"),
        ({"away": 0.2}, "passive", "", "all 20 N"),  # a bounce
        ({"away": 0.3}, "passive", "", "No contact"),
        ({"law": "none"}, "off", "No law. Passive.", "all 20 N"),
        ({"law": "none", "applied": 5.0, "cause": "too far"}, "off", "", "5 N of the 20 N"),
        ({"fall": -0.01}, "not_passive", "Not passive.", "received up to 20 mJ"),
        ({"fall": -0.01, "holder": "wall"}, "not_passive", "", "What it meets received"),
        ({"lost": 0.1, "applied": 5.0}, "late", "Late ticks", "10% of the ticks"),
        ({"lost": 0.1}, "passive", "Passive.", "10% of the ticks"),  # nobody feels it
        ({"lost": 0.015, "applied": 5.0}, "passive", "", "30 ticks were missed in this contact"),
        ({"applied": 5.0, "cause": "too far: come nearer"}, "passive", "", "commands: too far."),
        ({"delay": None}, "off", "No force.", "does not answer"),
        ({"engagement": 0.4}, "off", "engages: 40%", ""),
        ({"device": LATE_WRITES}, "uncovered", "Not covered", "2,0"),
        ({"device": LATE_WRITES, "fall": -0.01}, "not_passive", "Not covered", "20 mJ"),
    ],
)
def test_the_state_in_words(change: dict[str, Any], kind: str, head: str, more: str) -> None:
    words = words_of(**change)
    assert words["kind"] == kind
    assert head in words["head"]
    assert more in words["more"]


@pytest.mark.parametrize(
    ("change", "absent"),
    [
        ({"lost": 0.005, "applied": 5.0}, "press again"),  # too few to feel
        ({"lost": 0.015}, "press again"),
        ({"lost": 0.1, "applied": 5.0}, "press again"),
        ({"applied": 5.0, "cause": "too far: come nearer"}, "nearer"),
        ({"law": "none", "applied": 5.0, "cause": "too far"}, "too far"),
        ({"away": 0.3}, "20 N"),
    ],
)
def test_what_does_not_matter_is_not_said(change: dict[str, Any], absent: str) -> None:
    assert absent not in words_of(**change)["more"]


def test_a_law_begins_the_state_again_and_a_page_that_comes_later_says_since_when() -> None:
    packets, document = recorded("stiff_wall", "law:=none", "delay:=5 ms", seconds=2.0)
    feed = HandFeed(0.0, ())
    assert shown(packets, document, feed)["kind"] == "not_passive"
    last = packets[-1]
    feed.begin_law(last.time_ns, float(last.true_energy or 0.0), "certified")
    document["device"]["law"] = "certified"
    still = [
        replace(last, time_ns=last.time_ns + tick * MS, seq=last.seq + tick, loop_delay=1e-3)
        for tick in range(1, 700)
    ]
    words = shown(still, document, feed)
    assert (words["kind"], words["energy"]) == ("passive", "0")
    assert "Seen from" not in words["more"]
    later = shown(still, document, HandFeed(float(last.true_energy or 0.0), ()))
    assert "Seen from" in later["more"]
