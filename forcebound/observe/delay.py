"""Delays of a graph that runs or was recorded: of its loop, and from hop to hop."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from forcebound.errors import ConfigError, RunError
from forcebound.files import RECORDING_SUFFIX
from forcebound.messages.packets import TOPIC_OF, Telemetry
from forcebound.messages.topology import Document, flat, node_name
from forcebound.network.trace import DelayTrace
from forcebound.observe.control import chosen_hand
from forcebound.observe.runs import find, while_running
from forcebound.observe.streams import packets_of
from forcebound.recordings.delay_traces import loop_delays, of_recording
from forcebound.recordings.hops import HOPS, Hops
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.run_directory import read_launch_document

DURATION = 5.0  # s, how long a running graph is watched
SHARES = {"min": 0.0, "p50": 50.0, "p90": 90.0, "p99": 99.0, "p99_9": 99.9, "max": 100.0}
CLASSES = 12  # of a histogram
LEAST = 0.12  # ms, width of a histogram of equal delays


class Bin(Struct, frozen=True):
    """A class of a histogram."""

    from_ms: float
    to_ms: float
    count: int


class Percentiles(Struct, frozen=True):
    """Delays that these shares of all do not exceed, in ms; None: every answer was lost."""

    min: float | None = None
    p50: float | None = None
    p90: float | None = None
    p99: float | None = None
    p99_9: float | None = None
    max: float | None = None


class LinkDelays(Percentiles, frozen=True, kw_only=True):
    """Times from hop to hop."""

    count: int


class DelayFigures(Struct, frozen=True, omit_defaults=True):
    """Loop delays in a few figures."""

    ticks: int
    lost_share: float  # 0 to 1
    loop_delay_ms: Percentiles
    histogram: list[Bin]  # of the loop delay
    links_ms: dict[str, LinkDelays] = {}  # of each link and ``loop``; empty: not measured


@dataclass(frozen=True)
class Measured:
    """The loop delays of a graph."""

    trace: DelayTrace  # see :func:`forcebound.recordings.delay_traces.loop_delays`
    document: Document  # launch file of the graph, as resolved
    is_complete: bool = True  # False: a recording that was cut off
    hops: Hops | None = None  # None: not asked for

    @property
    def figures(self) -> DelayFigures:
        """The delays in a few figures."""
        known = np.array([delay for delay in self.trace.delays if delay is not None]) * 1e3
        ticks = len(self.trace.delays)
        hops = {} if self.hops is None else self.hops.delays()
        return DelayFigures(
            ticks=ticks,
            lost_share=1.0 - known.size / ticks,
            loop_delay_ms=Percentiles(**_percentiles(known)),
            histogram=_histogram(known),
            links_ms={
                name: LinkDelays(**_percentiles(one), count=one.size) for name, one in hops.items()
            },
        )


def _percentiles(delays: NDArray[np.float64]) -> dict[str, float]:
    if not delays.size:
        return {}
    return dict(zip(SHARES, np.percentile(delays, list(SHARES.values())).tolist(), strict=True))


def _histogram(delays: NDArray[np.float64]) -> list[Bin]:
    """Return classes of equal width up to the 99.9th percentile; the last has all beyond, too."""
    if not delays.size:
        return []
    low, high = float(delays.min()), float(np.percentile(delays, SHARES["p99_9"]))
    counts, edges = np.histogram(delays.clip(max=high), CLASSES, (low, max(high, low + LEAST)))
    rows = zip(edges, edges[1:], counts, strict=False)
    return [Bin(float(a), float(b), int(n)) for a, b, n in rows]


def measure(
    run: Path | None,
    duration: float | None = None,
    links: bool = False,
    hand: str | None = None,
) -> Measured:
    """Return the loop delays of a recording, or of a running graph (None: the only one).

    A running graph is watched for ``duration`` s, by default :data:`DURATION`. ``links``: also from
    hop to hop. ``hand``: whose loop; None: that of the only hand.

    Raises:
        ConfigError: If there is no such recording, graph or hand, it has no tick, or a duration is
            given for a recording.
        RunError: If the graph sent nothing, or ended.
    """
    if run is not None and (run.suffix == RECORDING_SUFFIX or (not run.suffix and run.is_file())):
        from forcebound.recordings.recording import read

        if duration is not None:
            raise ConfigError(f"{run} is a recording, which is read whole: leave out --duration")
        recorded = Hops.of(read(run, hand=hand).stream(*HOPS)) if links else None
        return Measured(*of_recording(run, hand), recorded)
    run_dir = find(run, require_graph=True, option="`forcebound delay GRAPH`")
    hops = Hops() if links else None
    with while_running(run_dir):
        hand = chosen_hand(run_dir, hand)
        document = flat(read_launch_document(run_dir), hand)
        seconds = DURATION if duration is None else duration
        columns = watch(run_dir, seconds, (hand,), hops)[hand]
    if not columns.time.size:
        raise RunError(
            f"no telemetry in {seconds:g} s from the graph in {run_dir}: is it starting, or"
            " ending? If it starts, try again, with a longer --duration"
        )
    return Measured(loop_delays(columns), document, hops=hops)


def watch(
    run_dir: Path, duration: float, hands: Collection[str], hops: Hops | None = None
) -> dict[str, TelemetryColumns]:
    """Return the telemetry of some hands of a running graph, as long as it runs.

    Args:
        run_dir: Of the graph.
        duration: After which it returns in any case, in s.
        hands: Their names.
        hops: Gets the packets of all their links, if there is one.
    """
    packets: dict[str, list[Telemetry]] = {hand: [] for hand in hands}
    topics = HOPS[-1:] if hops is None else HOPS
    names = [node_name(hand, topic) for hand in hands for topic in topics]
    for _, packet, _ in packets_of(run_dir, names, duration):
        if hops is not None:
            hops.add(TOPIC_OF[type(packet)], packet)
        if isinstance(packet, Telemetry):
            packets[packet.hand].append(packet)
    return {hand: TelemetryColumns.from_packets(found) for hand, found in packets.items()}
