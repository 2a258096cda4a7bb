"""What pages get of several hands, and what they may do with each."""

import asyncio
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from golden_packets import EVENT, REPLY, TELEMETRY
from live_graph import live_graph
from live_page import TWO_HANDS
from msgspec.structs import replace
from test_view import opened

from forcebound.graph.loader import load
from forcebound.messages.packets import Packet
from forcebound.messages.topology import graph_of
from forcebound.observe.page.controls import Controls, _joints
from forcebound.observe.page.feed import Feed
from forcebound.observe.page.server import Server
from forcebound.run.process.reader import Received

HANDS = ("left", "right")


@pytest.fixture
def feed(monkeypatch: pytest.MonkeyPatch) -> Feed:
    """A feed of two hands, whose reader is a mock; :func:`sent` gives it packets."""
    signal = {"left/device_state": {"heat": ["heat", "K"]}}
    run = Mock(graph=graph_of(HANDS), metadata={"signals": json.dumps(signal)})
    monkeypatch.setattr("forcebound.observe.page.feed.RunDocument.read", lambda _: run)
    monkeypatch.setattr("forcebound.observe.page.feed.Reader", Mock())
    return Feed(Path(), {"left": 0.0, "right": 0.25})


def sent(feed: Feed, *packets: tuple[str, Packet]) -> None:
    found: Iterator[Received] = (Received(stream, packet, b"") for stream, packet in packets)
    reader: Any = feed._reader
    reader.take.return_value = found


def test_each_hand_has_frames_of_its_own(feed: Feed) -> None:
    left = replace(TELEMETRY, hand="left", position=(0.01,), true_energy=1.0, elapsed=2.0)
    right = replace(left, hand="right", position=(0.02,))
    reply = replace(REPLY, hand="right", proxy=(0.03,))
    sent(
        feed,
        ("left/telemetry", left),
        ("right/telemetry", right),
        ("right/environment_reply", reply),
    )
    frames = {frame["hand"]: frame for frame in feed.look()}
    assert {name: frame["position"] for name, frame in frames.items()} == {
        "left": [(0.01,)],
        "right": [(0.02,)],
    }
    assert {name: frame["proxy"] for name, frame in frames.items()} == {
        "left": None,
        "right": (0.03,),
    }
    assert [frames[name]["true_energy"] for name in HANDS] == [[1.0], [0.75]]
    assert [list(frames[name]["signals"]) for name in HANDS] == [["left/device_state.heat"], []]
    sent(feed, ("left/telemetry", left))
    assert [frame["hand"] for frame in feed.look()] == ["left"]


def test_a_law_begins_the_energy_of_its_own_hand_again(feed: Feed) -> None:
    data = {"law": "none", "energy_before": "0.875"}
    changed = replace(EVENT, node="right/device", time_ns=5, event="law_changed", data=data)
    sample = replace(TELEMETRY, time_ns=6, true_energy=1.0, elapsed=2.0)
    sent(feed, ("event", changed), ("left/telemetry", sample), ("right/telemetry", sample))
    event, *frames = feed.look()
    assert event["node"] == "right/device"
    assert [(one["law"], one["true_energy"]) for one in frames] == [("", [1.0]), ("none", [0.125])]


def test_axes_that_are_no_places_in_space_are_joints() -> None:
    (leader, _) = load("joint_arms").hands.values()
    joints = _joints(leader.named_axes)
    assert [joint["name"] for joint in joints] == [axis.name for axis in leader.named_axes]
    assert all(joint["isAngle"] for joint in joints)
    for file in ("three_axes", "knob_wall", "haply_2diy"):
        assert _joints(load(file).hands["hand"].named_axes) == []


def test_a_law_of_one_hand_does_not_replace_that_of_another() -> None:
    controls = Mock(_config=Mock(hands_here=HANDS), _law_requests=0, _newest={})

    def received(**request: object) -> bool:
        waiting.append(Controls.receive(controls, request))
        return all(counts() for counts in waiting)

    waiting: list[Callable[[], bool]] = []
    assert received(do="set", settings={"left.device.law": "none"})
    assert received(do="set", settings={"right.device.law": "none"})
    assert received(do="set", settings={"environment.stiffness": 1})
    assert not received(do="set", settings={"left.device.law": "certified"})
    waiting = waiting[1:]
    assert received()
    assert not received(do="safe")  # of both
    assert waiting[-1]()


def is_near(hand: str, x: float, frame: dict[str, Any]) -> bool:
    """Whether a frame shows a hand near a place in m, with room for the depth in the wall."""
    return bool(frame["hand"] == hand and abs(frame["tip"][0] - x) < 0.007)


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_each_page_moves_its_hand_and_both_break(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def visit(run_dir: Path, folder: Path) -> None:
        server = Server(recordings=folder)
        serving = asyncio.create_task(server.show(run_dir))
        pages = {hand: await opened(server, server.access.token) for hand in HANDS}
        for page in pages.values():
            hello = await page.until("hello", lambda m: m["hands"])
            assert [(one["name"], one["pointer"]["start"]) for one in hello["hands"]] == [
                ("left", [-0.005]),
                ("right", [-0.005]),
            ]
        values = (await pages["left"].until("parameters"))["values"]
        assert values["right.device.law"] == "certified"
        assert values["environment.stiffness"] == "10000 N/m"
        for hand, x in (("left", -0.02), ("right", 0.015)):
            await pages[hand].send(do="point", hand=hand, target=[x], stamp=1.0)
        for hand, x in (("left", -0.02), ("right", 0.015)):
            frame = await pages[hand].until("frame", partial(is_near, hand, x))
            assert frame["pointer"] == [x]
        assert "third" in str(await pages["left"].asks(do="point", hand="third", target=[0.0]))
        assert await pages["left"].asks(do="break") is None
        await pages["right"].until(
            "parameters",
            lambda m: (
                [m["values"][f"{hand}.device.law"] for hand in HANDS] == ["none", "none"]
                and m["values"]["left.links.environment_reply.delay"] == "0.005 s"
            ),
        )
        server.stop()
        await serving
        closing = asyncio.create_task(server.close())
        for page in pages.values():
            await page.close()
        await closing

    file = tmp_path / "two.yaml"
    file.write_text(TWO_HANDS)
    with live_graph(str(file), is_alone=False) as graph:
        graph.wait_until_engaged()
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(graph.runtime))
        asyncio.run(visit(graph.run_dir, graph.folder))
