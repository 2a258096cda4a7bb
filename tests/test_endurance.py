"""Long runs under all impairments: constant memory, no lost descriptor, correct sums.

``make endurance`` runs them: one hour in virtual time, ten minutes live.
"""

import gc
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from live_graph import live_graph

from forcebound.graph.loader import load
from forcebound.graph.phases import timetable
from forcebound.messages.control import Configure
from forcebound.messages.packets import TOPIC_OF, Packet, Telemetry
from forcebound.messages.topology import ONE_HAND
from forcebound.run.application import Tuner
from forcebound.run.build import build_device, build_links, build_node
from forcebound.run.simulation import Simulation

HOUR_NS = 3_600_000_000_000
MINUTE_NS = 60_000_000_000
SETTLED = 10  # minutes after which nothing may grow any more
SLACK = 4_000_000  # bytes; what an allocator's arenas may shift. A leak of 1 byte a packet is 14 MB
LIVE_SECONDS = 600

EVERYTHING = """
forcebound: 1
include: stiff_wall.yaml
description: Everything that a network can do, at once.
duration: 600 s
device: { age_limit: 100 ms }
operator: { kind: sinusoidal, centre: 10 mm, amplitude: 4 mm, frequency: 0.7 Hz }
environment: { compute_delay: 0.3 ms, compute_jitter: 0.2 ms, compute_distribution: normal }
links:
  device_state: { delay: 0.5 ms, loss: 1 %, duplicate: 1 % }
  environment_query:
    delay: 3 ms
    jitter: 1 ms
    distribution: paretonormal
    correlation: 0.2
    gemodel: { p: 0.3 %, r: 5 % }
    duplicate: 2 %
    corrupt: 1 %
    rate: 1 MB/s
    limit: 50
  environment_reply:
    delay: 3 ms
    jitter: 1 ms
    distribution: pareto
    loss: 5 %
    reorder: 5 %
    duplicate: 2 %
    corrupt: 1 %
    outages: [{ start: 20 s, duration: 1 s }, { start: 300 s, duration: 3 s }]
  force_command: { delay: 0.5 ms, loss: 1 %, reorder: 2 % }
realtime: { policy: other }
"""


def resident(process: int | str = "self") -> int:
    """Memory that a process holds, in bytes."""
    pages = Path(f"/proc/{process}/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def descriptors(process: int) -> int:
    return len(os.listdir(f"/proc/{process}/fd"))


class Watch:
    """Counts what a simulation sends and keeps the least energy; keeps no packet."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.least_energy = 0.0

    def __call__(self, packet: Packet) -> None:
        self.counts[TOPIC_OF[type(packet)]] += 1
        if type(packet) is Telemetry and packet.true_energy is not None:
            self.least_energy = min(self.least_energy, packet.true_energy)


def add_up(counts: dict[str, int]) -> bool:
    out = sum(counts[fate] for fate in counts if fate not in ("sent", "duplicated"))
    return out == counts["sent"] + counts["duplicated"]


@pytest.fixture
def everything(tmp_path: Path) -> Path:
    file = tmp_path / "everything.yaml"
    file.write_text(EVERYTHING)
    return file


def an_hour(file: str | Path, report: Callable[[str], None]) -> None:
    config = load(file)
    watch = Watch()
    device = build_device(config.only)
    others = [build_node(kind, config) for kind in ONE_HAND.loop if kind != "device"]
    simulation = Simulation([*others, device], build_links(config), watch)
    for node in simulation.nodes:
        node.events.is_logged = False
    device.engage()
    parts = timetable(config)
    tuner, sizes = Tuner(config), []
    for minute in range(HOUR_NS // MINUTE_NS):
        if parts:  # each minute another phase, again and again
            values = parts[minute % len(parts)].values
            tuner(simulation, Configure(minute, values))
        simulation.run((minute + 1) * MINUTE_NS)
        gc.collect()
        sizes.append(resident())
    grown = max(sizes[SETTLED:]) - sizes[SETTLED]
    report(f"{file}: {grown / 1e3:.0f} kB grown in the last {len(sizes) - SETTLED} minutes")
    assert grown < SLACK
    assert watch.least_energy >= -1e-9
    assert watch.counts["telemetry"] == HOUR_NS // 1_000_000
    assert watch.counts["device_state"] == HOUR_NS // 1_000_000
    seen = 0
    for node in simulation.nodes:
        for stream in ONE_HAND.received(node.events.node):
            link = simulation.link(stream.name)
            if link is not None:
                seen += 1
                assert add_up(link.counts), (stream.name, link.counts)
                assert link.queued < 1000
    assert seen >= 2


@pytest.mark.endurance
def test_an_hour_in_virtual_time_with_everything_at_once_leaves_no_trace(
    everything: Path, record_testsuite_property: Callable[[str, object], None]
) -> None:
    an_hour(everything, lambda line: record_testsuite_property("endurance", line))


@pytest.mark.endurance
def test_an_hour_of_the_stress_test_in_virtual_time_leaves_no_trace(
    record_testsuite_property: Callable[[str, object], None],
) -> None:
    an_hour("stress", lambda line: record_testsuite_property("endurance", line))


@pytest.mark.endurance
@pytest.mark.live
@pytest.mark.xdist_group("live")
def test_ten_minutes_live_with_everything_at_once_lose_no_memory_and_no_descriptor(
    everything: Path, record_testsuite_property: Callable[[str, object], None]
) -> None:
    sizes: dict[str, list[int]] = {}
    files: dict[str, list[int]] = {}
    with live_graph(str(everything)) as graph:
        for _ in range(LIVE_SECONDS // 10):
            graph.wait(10.0)
            for name in graph.status().nodes:
                sizes.setdefault(name, []).append(resident(graph.pid(name)))
                files.setdefault(name, []).append(descriptors(graph.pid(name)))
        ended = graph.end(timeout=600.0)  # there is much to read
    summary = ended.summary
    for name, size in sizes.items():
        half = len(size) // 2
        grown = max(size[half:]) - max(size[:half])
        told = f"{name}: {grown / 1e3:.0f} kB grown, {files[name][-1]} descriptors"
        record_testsuite_property("endurance", told)
        assert grown < SLACK, told
        assert len(set(files[name][1:])) == 1, (name, files[name])
    assert summary["true_energy_min_j"] >= -1e-9
    assert set(summary["links"]) == {
        "device_state",
        "environment_query",
        "environment_reply",
        "force_command",
    }
    for topic, counts in summary["links"].items():
        assert add_up(counts), (topic, counts)
        assert counts["lost"] > 0
    assert summary["faults"].get("process_ended", 0) == 0
