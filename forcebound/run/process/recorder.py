"""Recorder process: records every packet of some streams until a stop request."""

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from forcebound.messages.control import GetStatus, RecorderStatus, StopProcess
from forcebound.messages.packets import Packet
from forcebound.messages.topology import Graph, endpoint, is_bound
from forcebound.roles import DEVICE, RECORDER
from forcebound.run.process.reader import PERIOD_NS, Reader
from forcebound.stop import Stop

if TYPE_CHECKING:
    from forcebound.recordings.recording import Recorder  # slow to import

COMPLETE = "complete"  # a complete recording
FLUSH_PERIOD_NS = 250_000_000  # a killed recorder loses at most this
DRAIN_NS = 50_000_000  # silence after a stop request that ends the recording
DRAIN_LIMIT_NS = 1_000_000_000  # longest wait for the device's end while nothing comes
BACKLOG_LIMIT_NS = 60_000_000_000  # to write what waits, on a machine that gives little time
_logger = logging.getLogger(__name__)


def clocks() -> tuple[int, dict[str, str]]:
    """Return UTC less the monotonic clock, in ns, and the metadata that says so.

    Of ten readings between two of the monotonic clock, that with the shortest time between counts.
    """
    from forcebound.recordings.clock import UTC_OFFSET, UTC_OFFSET_AT  # slow to import

    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(10)]
    before, utc, after = min(readings, key=lambda one: one[2] - one[0])
    at = (before + after) // 2
    return utc - at, {UTC_OFFSET: str(utc - at), UTC_OFFSET_AT: str(at)}


class FailSafeSink:
    """Writes to a sink until that fails, which is reported once; then drops the packets."""

    def __init__(self, sink: "Recorder") -> None:
        self._sink = sink
        self._flush_ns = time.monotonic_ns() + FLUSH_PERIOD_NS
        self.state = COMPLETE  # or why the recording is not

    def take(self, reader: Reader) -> bool:
        """Record what a reader has received; return whether it was anything."""
        any_came = False
        for received in reader.take():
            any_came = True
            self._try(self._sink.write, received.packet)
        if time.monotonic_ns() >= self._flush_ns:
            self.flush()
        return any_came

    def flush(self) -> None:
        """Flush the sink."""
        self._try(self._sink.flush)
        self._flush_ns = time.monotonic_ns() + FLUSH_PERIOD_NS

    def _try(self, act: Callable[..., None], *packet: Packet) -> None:
        if self.state != COMPLETE:
            return
        try:
            act(*packet)
        except OSError as error:
            self.state = f"stopped: {error.strerror or error}"
            _logger.error("recording %s; the run continues", self.state)


def record(
    sink: "Recorder",
    run_dir: Path,
    graph: Graph,
    streams: Sequence[str],
    core: int | None,
    stop: Stop,
) -> RecorderStatus:
    """Record every packet of some streams until a stop request; return the last status.

    The packets still on their way are recorded, too, so stop the publishers first. When writing
    fails (a full disk), the run continues without a recording. The caller closes the sink.
    """
    safe = FailSafeSink(sink)
    with Reader(run_dir, graph.named(*streams), core) as reader:
        requests = (GetStatus, StopProcess)
        control = reader.network.control_server(endpoint(run_dir, graph.nodes[RECORDER]), requests)

        def status() -> RecorderStatus:
            counts = reader.received.items()
            received = {name: n for name, n in counts if n or name not in graph.elsewhere}
            return RecorderStatus(received=received, rejected=reader.rejected, recording=safe.state)

        def answer(request: GetStatus | StopProcess) -> RecorderStatus:
            if isinstance(request, StopProcess):
                stop.request()
            return status()

        while not stop.requested:
            reader.wait(stop.descriptor)
            control.serve(answer)
            safe.take(reader)
        devices = [node for node in graph.nodes.values() if node.role == DEVICE]
        answers = partial(control.serve, answer)  # so that the launcher waits
        _drain(reader, safe, lambda: any(is_bound(run_dir, one) for one in devices), answers)
        safe.flush()
    return status()


def _drain(
    reader: Reader,
    safe: FailSafeSink,
    has_device: Callable[[], bool],
    answer: Callable[[], object],
) -> None:
    """Record what is still on its way, until nothing comes and there is no device.

    A launcher ends the device first. When it is killed, all are to end at once, and a device that
    gets no processor has its zero force still to write. A recorder that got none has a backlog: it
    goes on as long as packets come.
    """
    end_ns = time.monotonic_ns() + BACKLOG_LIMIT_NS
    idle_ns = silent_ns = 0  # idle: nothing came; silent: and there is no device
    while silent_ns < DRAIN_NS and idle_ns < DRAIN_LIMIT_NS and time.monotonic_ns() < end_ns:
        answer()
        any_came = safe.take(reader)
        idle_ns = 0 if any_came else idle_ns + PERIOD_NS
        silent_ns = 0 if any_came or has_device() else silent_ns + PERIOD_NS
        reader.wait()
