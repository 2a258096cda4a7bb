"""The recorder's loop, in this process."""

import time
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from unittest.mock import Mock

import pytest
from builders import query
from fakes import Sender
from waiting import TIMEOUT

from forcebound import realtime
from forcebound.messages.packets import EnvironmentQuery, Packet
from forcebound.messages.topology import ONE_HAND
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.recordings.recording import Recorder
from forcebound.run.process.recorder import BACKLOG_LIMIT_NS, _drain, record
from forcebound.stop import Stop


class StoppingSink(Recorder):
    """A recording in memory that asks for the end when it has a packet."""

    def __init__(self, stop: Stop) -> None:  # no file
        self.packets: list[Packet] = []
        self.flushes = 0
        self._stop = stop

    def write(self, packet: Packet) -> None:
        self.packets.append(packet)
        self._stop.request()

    def flush(self) -> None:
        self.flushes += 1


def test_the_recorder_keeps_everything_and_counts_what_it_cannot_read(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(realtime, "enter", lambda settings, role: [])
    with Stop() as stop, Network() as network:
        sink = StoppingSink(stop)
        sender = Sender(network, run_dir, "environment_query")
        end = time.monotonic() + TIMEOUT

        def send_now(descriptors: Sequence[int], timeout_ns: int) -> list[int]:
            assert time.monotonic() < end, "the recorder heard nothing"
            if not stop.requested:
                sender.send(b"junk")
                sender.send(query(1))
            return real_wait(descriptors, timeout_ns)

        real_wait = sockets.wait
        monkeypatch.setattr(sockets, "wait", send_now)
        topics = ["environment_query", "telemetry"]
        status = record(sink, run_dir, ONE_HAND, topics, None, stop)
    assert set(map(type, sink.packets)) == {EnvironmentQuery}
    assert status.received == {"environment_query": len(sink.packets), "telemetry": 0}
    assert status.waiting_for == ("telemetry",)
    assert status.rejected["malformed"] >= 1
    assert sink.flushes >= 1


def test_a_recorder_that_got_no_processor_writes_its_backlog(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks, answers, clock = count(), count(), count(0, 50_000_000)  # 50 ms each
    monkeypatch.setattr("time.monotonic_ns", lambda: next(clock))
    sink = Mock(take=lambda _: next(looks) < 100)
    _drain(Mock(), sink, lambda: False, lambda: next(answers))
    assert next(looks) == 105  # and a silence
    assert next(answers) == 105
    sink = Mock(take=lambda _: next(looks) > 0)  # for ever
    _drain(Mock(), sink, lambda: False, lambda: None)
    assert next(clock) > BACKLOG_LIMIT_NS


def test_a_recorder_that_is_to_end_with_the_device_has_what_the_device_sends_last(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(realtime, "enter", lambda settings, role: [])
    monkeypatch.setattr("forcebound.run.process.recorder.DRAIN_LIMIT_NS", round(TIMEOUT * 1e9))
    device = run_dir / ONE_HAND.nodes["device"].socket
    device.touch()
    waits = count()
    with Stop() as stop, Network() as network:
        sink = StoppingSink(stop)
        sender = Sender(network, run_dir, "environment_query")

        def send_late(descriptors: Sequence[int], timeout_ns: int) -> list[int]:
            if not stop.requested:
                sender.send(query(1))
            elif next(waits) > 20 and device.exists():  # after what would be a silence
                sender.send(query(2))
            if sink.packets[-1:] == [query(2)]:
                device.unlink(missing_ok=True)
            return real_wait(descriptors, timeout_ns)

        real_wait = sockets.wait
        monkeypatch.setattr(sockets, "wait", send_late)
        record(sink, run_dir, ONE_HAND, ["environment_query"], None, stop)
    assert sink.packets[-1] == query(2)
