"""Loop delay of a graph that runs or was recorded."""

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from forcebound import realtime
from forcebound.config.traces import loop_delays, of_recording
from forcebound.errors import ConfigError, PacketError, RunError
from forcebound.launch.live import RUN_FILE, TELEMETRY, RunDocument, read_launch_document
from forcebound.messages.codec import decode
from forcebound.messages.packets import Telemetry
from forcebound.monitor.runs import find, while_running
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.network.trace import DelayTrace
from forcebound.process import topic_endpoint
from forcebound.telemetry import TelemetryColumns

DURATION = 5.0  # s, how long a running graph is watched
_PERIOD_NS = 10_000_000  # of looking for telemetry: waking for each packet would disturb the graph


@dataclass(frozen=True)
class Measured:
    """The loop delays of a graph."""

    trace: DelayTrace  # see :func:`forcebound.config.traces.loop_delays`
    document: Mapping[str, Any]  # launch file of the graph, as resolved
    is_complete: bool = True  # False: a recording that was cut off

    @property
    def summary(self) -> dict[str, Any]:
        """The delays in a few figures, fit for JSON.

        ``ticks``, ``lost_share`` (0 to 1) and ``loop_delay_ms``: ``p50``, ``p99``, ``max``, each
        None if every answer was lost.
        """
        known = np.array([delay for delay in self.trace.delays if delay is not None]) * 1e3
        figures = np.percentile(known, (50, 99, 100)).tolist() if known.size else [None] * 3
        ticks = len(self.trace.delays)
        return {
            "ticks": ticks,
            "lost_share": 1.0 - known.size / ticks,
            "loop_delay_ms": dict(zip(("p50", "p99", "max"), figures, strict=True)),
        }


def measure(run: Path | None, duration: float | None = None) -> Measured:
    """Return the loop delays of a run.

    Args:
        run: A recording; the run directory of a running graph; None: the only one that runs.
        duration: How long to watch a running graph, in s; None: :data:`DURATION`.

    Raises:
        ConfigError: If there is no such recording or graph, it has no tick, or a duration is given
            for a recording.
        RunError: If the graph sent nothing, or ended meanwhile.
    """
    if run is not None and not run.is_dir():
        if duration is not None:
            raise ConfigError(f"{run} is a recording, which is read whole: leave out --duration")
        return Measured(*of_recording(run))
    run_dir = find(run, of_graph=True, option="`forcebound delay DIR`")
    with while_running(run_dir):
        document = read_launch_document(run_dir)
        columns = watch(run_dir, DURATION if duration is None else duration)
    return Measured(loop_delays(columns), document)


def watch(run_dir: Path, duration: float) -> TelemetryColumns:
    """Return the telemetry of a running graph, for ``duration`` s or until the graph ends.

    Raises:
        ConfigError: If it is no run directory, or no longer one.
        RunError: If none came.
    """
    packets: list[Telemetry] = []
    cores = realtime.leave_core(RunDocument.read(run_dir).core)
    try:
        with Network() as network:
            endpoint = topic_endpoint(run_dir, TELEMETRY)
            subscriber = network.subscriber(endpoint, newest_only=False)
            end_ns = time.monotonic_ns() + round(duration * 1e9)
            while time.monotonic_ns() < end_ns and (run_dir / RUN_FILE).exists():
                sockets.wait((), _PERIOD_NS)
                for data in subscriber.receive():
                    with suppress(PacketError):  # not counted: the monitor is no part of the graph
                        packets.append(cast("Telemetry", decode(data, Telemetry)))
    finally:
        os.sched_setaffinity(0, cores)
    if not packets:
        raise RunError(
            f"no telemetry in {duration:g} s from the graph in {run_dir}: is it starting, or"
            " ending? If it starts, try again, with a longer --duration"
        )
    return TelemetryColumns.from_packets(packets)
