"""Recorder process: records every packet of some streams until a stop request, or an end."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from forcebound import realtime
from forcebound.errors import PacketError
from forcebound.messages.codec import decode
from forcebound.messages.packets import TOPICS, Packet
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.process.endpoints import control_endpoint, has_control
from forcebound.process.readiness import readiness
from forcebound.process.stop import Stop

COMPLETE = "complete"  # a complete recording
RECORDER_PERIOD_NS = 10_000_000  # waking for each packet would cost half a core
FLUSH_PERIOD_NS = 250_000_000  # a killed recorder loses at most this
DRAIN_NS = 50_000_000  # silence after a stop request that ends the recording
DRAIN_LIMIT_NS = 1_000_000_000  # longest wait for that silence, and for the device's end
_logger = logging.getLogger(__name__)


class Sink(Protocol):
    """Sink of a recorder's packets; :class:`forcebound.recording.Recorder` is one."""

    def write(self, packet: Packet) -> None:
        """Record one packet."""
        ...

    def flush(self) -> None:
        """Flush, so that all packets so far survive the end of this process."""
        ...


def record(
    sink: Sink,
    name: str,
    run_dir: Path,
    streams: Sequence[tuple[str, str]],
    core: int | None,
    stop: Stop,
    is_over: Callable[[str], bool] | None = None,
) -> dict[str, Any]:
    """Record every packet of some streams until a stop request; return the last status.

    The recorder of a run then records the packets still on their way, so stop the publishers first.
    When writing fails (a full disk) it reports this once and drops further packets; the run
    continues without a recording.

    Args:
        sink: Where the packets go; the caller closes it.
        name: Of the process; its control socket is named after it.
        run_dir: Directory of the run's ``ipc`` sockets.
        streams: Topic and endpoint of each.
        core: The chain's core, where the recorder does not run if there is another one.
        stop: Ends the loop.
        is_over: Of a recorder that is no part of the run: called with the state of the recording,
            :data:`COMPLETE` or why it is not; returns whether to end.
    """
    realtime.enter(realtime.Settings(core=core), name)
    with Network() as network:
        inbox = _Inbox(network, streams, _FailSafeSink(sink))
        control = network.control_server(control_endpoint(run_dir, name))

        def answer(request: Mapping[str, Any]) -> dict[str, Any]:
            if request.get("request") == "stop":
                stop.request()
            return inbox.status()

        flush_ns = time.monotonic_ns() + FLUSH_PERIOD_NS
        while not (stop.requested or (is_over is not None and is_over(inbox.sink.state))):
            sockets.wait((stop.descriptor,), RECORDER_PERIOD_NS)
            control.serve(answer)
            inbox.take()
            if time.monotonic_ns() >= flush_ns:
                inbox.sink.flush()
                flush_ns = time.monotonic_ns() + FLUSH_PERIOD_NS
        if is_over is None:
            inbox.drain(lambda: has_control(run_dir, "device"))
        inbox.sink.flush()
    return inbox.status()


class _Inbox:
    """The streams of a recorder, and what came on them."""

    def __init__(
        self, network: Network, streams: Sequence[tuple[str, str]], sink: "_FailSafeSink"
    ) -> None:
        self.sink = sink
        self._counts = {topic: 0 for topic, _ in streams}
        self._rejected: dict[str, int] = {}
        self._subscribers = [(topic, network.subscriber(endpoint)) for topic, endpoint in streams]

    def take(self) -> bool:
        """Record what has come; return whether anything had."""
        any_came = False
        for topic, subscriber in self._subscribers:
            for data in subscriber.receive():
                any_came = True
                try:
                    packet = decode(data, TOPICS[topic].packet)
                except PacketError as error:
                    self._rejected[error.reason] = self._rejected.get(error.reason, 0) + 1
                    continue
                self._counts[topic] += 1
                self.sink.write(packet)
        return any_came

    def drain(self, has_device: Callable[[], bool]) -> None:
        """Record what is still on its way, until nothing comes and there is no device.

        A launcher ends the device first. When it is killed, all are to end at once, and a device
        that gets no processor has its zero force still to write.
        """
        limit_ns = time.monotonic_ns() + DRAIN_LIMIT_NS
        silent_ns = 0
        while silent_ns < DRAIN_NS and time.monotonic_ns() < limit_ns:
            is_silent = not self.take() and not has_device()
            silent_ns = silent_ns + RECORDER_PERIOD_NS if is_silent else 0
            sockets.wait((), RECORDER_PERIOD_NS)

    def status(self) -> dict[str, Any]:
        """Return the status of the process."""
        return {
            **readiness(self._counts),
            "rejected": dict(self._rejected),
            "recording": self.sink.state,
            "realtime": [],
        }


class _FailSafeSink:
    """A sink that reports once that it cannot write, and then drops its packets.

    Attributes:
        state: :data:`COMPLETE`, or why the recording is not.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self.state = COMPLETE

    def write(self, packet: Packet) -> None:
        self._try(self._sink.write, packet)

    def flush(self) -> None:
        self._try(self._sink.flush)

    def _try(self, act: Callable[..., None], *packet: Packet) -> None:
        if self.state != COMPLETE:
            return
        try:
            act(*packet)
        except OSError as error:
            self.state = f"stopped: {error.strerror or error}"
            _logger.error("recording %s; the run continues", self.state)
