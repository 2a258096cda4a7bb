"""Loop delay of a graph that runs or was recorded."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from forcebound.config.traces import loop_delays, of_recording
from forcebound.errors import ConfigError, RunError
from forcebound.launch.run_directory import TELEMETRY, read_launch_document
from forcebound.messages.packets import Packet, Telemetry
from forcebound.monitor.runs import find, while_running
from forcebound.monitor.streams import SHARES, read_topics
from forcebound.network.trace import DelayTrace
from forcebound.telemetry import TelemetryColumns

DURATION = 5.0  # s, how long a running graph is watched
CLASSES = 12  # of a histogram
LEAST = 0.12  # ms, width of a histogram of equal delays


@dataclass(frozen=True)
class Measured:
    """The loop delays of a graph."""

    trace: DelayTrace  # see :func:`forcebound.config.traces.loop_delays`
    document: Mapping[str, Any]  # launch file of the graph, as resolved
    is_complete: bool = True  # False: a recording that was cut off

    @property
    def summary(self) -> dict[str, Any]:
        """The delays in a few figures, fit for JSON.

        ``ticks``, ``lost_share`` (0 to 1), ``loop_delay_ms``: the percentiles in ``SHARES``, each
        None if every answer was lost, and ``histogram``: ``from_ms``, ``to_ms`` and ``count`` of
        each class.
        """
        known = np.array([delay for delay in self.trace.delays if delay is not None]) * 1e3
        wanted = list(SHARES.values())
        figures = np.percentile(known, wanted).tolist() if known.size else [None] * len(wanted)
        ticks = len(self.trace.delays)
        return {
            "ticks": ticks,
            "lost_share": 1.0 - known.size / ticks,
            "loop_delay_ms": dict(zip(SHARES, figures, strict=True)),
            "histogram": _histogram(known),
        }


def _histogram(delays: NDArray[np.float64]) -> list[dict[str, float]]:
    """Return classes of equal width up to the 99.9th percentile; the last has all beyond, too."""
    if not delays.size:
        return []
    low, high = float(delays.min()), float(np.percentile(delays, SHARES["p99_9"]))
    counts, edges = np.histogram(delays.clip(max=high), CLASSES, (low, max(high, low + LEAST)))
    rows = zip(edges, edges[1:], counts, strict=False)
    return [{"from_ms": float(a), "to_ms": float(b), "count": int(n)} for a, b, n in rows]


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
    run_dir = find(run, of_graph=True, option="`forcebound delay GRAPH`")
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

    def take(topic: str, packet: Packet, data: bytes) -> bool:
        packets.append(cast("Telemetry", packet))
        return True

    read_topics(run_dir, (TELEMETRY,), take, duration)
    if not packets:
        raise RunError(
            f"no telemetry in {duration:g} s from the graph in {run_dir}: is it starting, or"
            " ending? If it starts, try again, with a longer --duration"
        )
    return TelemetryColumns.from_packets(packets)
