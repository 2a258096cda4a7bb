"""The perceptual deadband of a link."""

import math
import re
from pathlib import Path

import pytest
from builders import MS, query, reply
from hypothesis import given
from hypothesis import strategies as st
from launch_texts import GOOD, problems_of, written
from msgspec.structs import replace

from forcebound.graph.loader import load
from forcebound.lab.runs import unserved
from forcebound.messages.packets import EnvironmentReply, Vector
from forcebound.network.deadband import Deadband
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link
from forcebound.run.virtual import run_virtual

LONG = 1e6  # s


def sent(forces: list[Vector], share: float, keep_alive: float = LONG) -> list[int]:
    """Numbers of the replies that are sent, one each ms."""
    deadband = Deadband(share, keep_alive)
    return [
        number
        for number, force in enumerate(forces)
        if not deadband.saves(number * MS, replace(reply(number), force=force))
    ]


def test_a_force_is_sent_when_it_leaves_the_band_around_the_last_one_sent() -> None:
    forces = [10.0, 10.9, 11.0, 11.1, 10.9, 10.0, 9.9]  # slowly out of the band, too
    assert sent([(force,) for force in forces], 0.1) == [0, 3, 6]
    assert sent([(-force,) for force in forces], 0.1) == [0, 3, 6]
    assert sent([(1.0,), (-1.0,), (-1.0,)], 0.5) == [0, 1]


def test_from_rest_every_motion_is_sent_and_rest_is_sent_once() -> None:
    deadband = Deadband(0.2, LONG)
    speeds = [0.0, 0.0, 1e-9, 1.1e-9, 0.0, 0.0]
    packets = [replace(query(number), velocity=(v,)) for number, v in enumerate(speeds)]
    saved = [deadband.saves(number * MS, packet) for number, packet in enumerate(packets)]
    assert saved == [False, True, False, True, False, True]


def test_several_axes_have_one_sphere() -> None:
    """A change across a large force is not felt, though it is large for its own axis."""
    assert sent([(10.0, 0.0), (10.0, 0.9), (10.0, 1.1), (10.0, 1.1)], 0.1) == [0, 2]


def test_a_packet_is_sent_after_the_keep_alive() -> None:
    assert sent([(1.0,)] * 100, 0.1, keep_alive=0.03) == [0, 30, 60, 90]


@given(
    st.lists(st.tuples(st.floats(), st.floats()), max_size=30),
    st.floats(0.01, 0.99),
)
def test_what_is_kept_is_within_the_share_of_what_is_there(
    forces: list[tuple[float, float]], share: float
) -> None:
    kept = sent([*forces], share)
    last: Vector = ()
    for number, force in enumerate(forces):
        if number in kept:
            last = force
        else:
            assert math.dist(force, last) <= share * math.hypot(*last)


def test_packets_of_other_axes_or_without_a_force_are_sent() -> None:
    deadband = Deadband(0.5, LONG)
    packets: list[object] = [replace(reply(0), force=(1.0,) * count) for count in (1, 2, 2, 1)]
    assert [deadband.saves(0, one) for one in (*packets, object())] == [
        False,
        False,
        True,
        *[False] * 2,
    ]


def test_a_link_counts_what_it_saves_apart() -> None:
    link: Link[EnvironmentReply] = Link(Impairment(deadband=0.1, loss=0.5, duplicate=0.1), 1)
    for number in range(1000):
        link.accept(number * MS, replace(reply(number), force=(1.0 + number // 10,)))
        link.due(number * MS)
    assert link.saved + link.sent == 1000
    assert 0 < link.sent < 200
    assert link.sent + link.duplicated == link.lost + link.delivered + link.superseded


def with_deadband(folder: Path, links: str) -> Path:
    return written(folder, GOOD.replace("environment_query: {delay: 2 ms}", links))


@pytest.mark.parametrize("topic", ["device_state", "environment_query", "force_command"])
def test_a_run_at_rest_keeps_its_force_and_saves_packets(tmp_path: Path, topic: str) -> None:
    config = load(with_deadband(tmp_path, f"{topic}: {{deadband: 10 %}}"))
    assert list(unserved(config)) == ["a link with a deadband"]
    result = run_virtual(config)
    plain = run_virtual(load(with_deadband(tmp_path, f"{topic}: {{delay: 0 ms}}")))
    counts = result.summary["links"][topic]
    assert result.summary["packets_saved"] == {topic: counts["saved"]}
    assert counts["saved"] > 0.5 * plain.summary["samples"]
    assert result.summary["true_energy_min_j"] >= 0.0
    resting = result.columns.time > 5.0
    assert result.columns.applied_force[resting].min() > 1.0
    assert result.columns.loop_delay[resting].max() < 0.022  # the keep-alive


@pytest.mark.parametrize(
    ("links", "message"),
    [
        ("environment_query: {deadband: 100 %}", "16:33: deadband: "),
        ("environment_query: {deadband: 1 %, keep_alive: 60 ms}", "keep_alive: .*60 ms|0.06 s"),
        ("energy_transfer: {deadband: 1 %}", "energy_transfer"),
        (
            "environment_query: {deadband: 1 %, keep_alive: 50 ms}\n"
            "  environment_reply: {deadband: 1 %, keep_alive: 50 ms}",
            "age_limit = 100 ms: lower keep_alive",
        ),
    ],
)
def test_a_deadband_that_cannot_work_is_refused(tmp_path: Path, links: str, message: str) -> None:
    assert re.search(message, problems_of(with_deadband(tmp_path, links)))
