"""Run of a launch file in virtual time: the nodes of a live run, in this process."""

import time
from contextlib import suppress
from pathlib import Path

from forcebound.config.graph import GraphConfig
from forcebound.config.phases import timetable
from forcebound.config.resolved import to_document
from forcebound.errors import RunError
from forcebound.launch.application import apply
from forcebound.launch.build import build_device, build_links, build_node
from forcebound.launch.results import RunResult, run_metadata
from forcebound.messages.packets import TOPIC_OF, Event, Packet, Telemetry
from forcebound.nodes.events import PHASE_BEGINS, EventLog
from forcebound.processes import LAUNCHER, NODES
from forcebound.realtime import without_garbage_collection
from forcebound.recording import Recorder
from forcebound.simulation import Simulation
from forcebound.telemetry import TelemetryColumns


def run_virtual(
    config: GraphConfig,
    duration: float | None = None,
    record: Path | None = None,
    *,
    may_end_early: bool = False,
) -> RunResult:
    """Run a graph in virtual time.

    Args:
        config: What to run.
        duration: Duration in s of virtual time; None: that of the launch file.
        record: Where to write a recording; the same configuration writes the same bytes.
        may_end_early: Whether an interrupt ends the run early, and gives the result until then.

    Raises:
        RunError: If the run is too short to have a sample.
        DeviceError: If a device of the user's own failed.
        KeyboardInterrupt: If the run was interrupted, and may not end early or had no sample yet.
    """
    metadata = run_metadata(config)
    samples: list[Telemetry] = []
    events: list[Event] = []
    recorder = None if record is None else Recorder(record, metadata)

    def observe(packet: Packet) -> None:
        if isinstance(packet, Telemetry):
            samples.append(packet)
        elif isinstance(packet, Event):
            events.append(packet)
        if recorder is not None:
            recorder.write(packet)

    observed = (Telemetry, Event) if recorder is None else tuple(TOPIC_OF)

    device = build_device(config)
    others = [build_node(kind, config) for kind in NODES if kind != "device"]
    links = build_links(config)
    simulation = Simulation([*others, device], links, observe, observed)
    launcher = EventLog(LAUNCHER)
    for events_of in (launcher, *(node.events for node in simulation.nodes)):
        events_of.is_logged = False  # a run of a sweep, or of a second, needs no log
    device.engage()
    seconds = duration or config.duration
    end_ns = round(seconds * 1e9)
    began = time.perf_counter()
    interrupted = False
    ends_it = (KeyboardInterrupt,) if may_end_early else ()
    try:
        with without_garbage_collection(), suppress(*ends_it):
            interrupted = True  # until it has come to its end
            now = config
            for part in timetable(config):
                if part.start_ns < end_ns:
                    simulation.run(part.start_ns)
                    apply(now, part.config, simulation)
                    now = part.config
                    observe(launcher.emit(part.start_ns, PHASE_BEGINS, part.message, part.data))
            simulation.run(end_ns)
            interrupted = False
        for node in simulation.nodes:
            for topic in (TOPIC_OF[packet] for packet in node.subscribes):
                link = simulation.link(topic)
                if link is not None:
                    observe(node.events.link_counts(simulation.time_ns, topic, link.counts))
    finally:
        took = time.perf_counter() - began
        for node in simulation.nodes:
            node.stop(simulation.time_ns)
            node.close()
        if recorder is not None:
            recorder.close()
    if not samples and interrupted:
        if record is not None:
            record.unlink(missing_ok=True)
        raise KeyboardInterrupt
    if not samples:
        raise RunError("the run ended before its first sample; set a longer --duration")
    columns = TelemetryColumns.from_packets(samples)
    ran = simulation.time_ns * 1e-9
    return RunResult(
        columns,
        to_document(config),
        events,
        interrupted=interrupted,
        times_real_time=ran / took,
    )
