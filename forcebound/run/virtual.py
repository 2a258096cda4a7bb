"""Run of a launch file in virtual time: the nodes of a live run, in this process."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from functools import partial
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.parameters import parameters
from forcebound.graph.phases import timetable
from forcebound.graph.resolved import kind_of, to_document
from forcebound.haptics.environments import may_report_contacts
from forcebound.messages.control import Configure
from forcebound.messages.events import PHASE_BEGINS, EventLog
from forcebound.messages.packets import TOPIC_OF, EnvironmentReply, Event, Packet, Telemetry
from forcebound.messages.topology import ONE_HAND
from forcebound.realtime import without_garbage_collection
from forcebound.recordings.recording import Recorder
from forcebound.recordings.telemetry import TelemetryCollector
from forcebound.roles import DEVICE, LAUNCHER
from forcebound.run.application import Tuner
from forcebound.run.build import build_device, build_links, build_node
from forcebound.run.results import RunResult, run_metadata
from forcebound.run.simulation import LateTicks, Simulation

Progress = Callable[[int, int], None]  # takes what is done, and the total

MS = 1_000_000  # ns
PART_NS = 100 * MS  # of virtual time, between two looks at the progress


def run_virtual(
    config: GraphConfig,
    duration: float | None = None,
    record: Path | None = None,
    *,
    may_end_early: bool = False,
    progress: Progress = lambda done, total: None,
    late_ticks: LateTicks | None = None,
) -> RunResult:
    """Run a graph in virtual time.

    Args:
        config: What to run.
        duration: Duration in s of virtual time; None: that of the launch file.
        record: Where to write a recording; the same configuration writes the same bytes.
        may_end_early: Whether an interrupt ends the run early, and gives the result until then.
        progress: Called now and then with the virtual time, and its end, in ms.
        late_ticks: Lateness of the servo's ticks; None: all are punctual.

    Raises:
        ConfigError: If the device lives in real time only.
        RunError: If the run is too short to have a sample.
        DeviceError: If a device of the user's own failed.
        KeyboardInterrupt: If the run was interrupted, and may not end early or had no sample yet.
    """
    check_has_virtual_time(config)
    end_ns = round((duration or config.duration) * 1e9)
    with ExitStack() as stack:
        recorder = None if record is None else Recorder(record, run_metadata(config))
        observer = _Observer(recorder, may_report_contacts(config.environment.model))
        stack.callback(observer.close)
        simulation = _open(config, observer, late_ticks)
        for node in simulation.nodes:
            stack.callback(node.close)
            stack.callback(node.stop, end_ns)
        began = time.perf_counter()
        run = partial(_advance, simulation, lambda ns: progress(ns // MS, end_ns // MS))
        interrupted = _run(config, simulation, observer, end_ns, may_end_early, run)
        took = time.perf_counter() - began
        observer.take_last_events(simulation)
    if not observer.samples and interrupted:
        if record is not None:
            record.unlink(missing_ok=True)
        raise KeyboardInterrupt
    if not observer.samples:
        raise RunError("the run ended before its first sample; use a longer --duration")
    return RunResult(
        observer.samples.columns(),
        to_document(config),
        observer.events,
        interrupted=interrupted,
        times_real_time=simulation.time_ns * 1e-9 / took,
    )


def check_has_virtual_time(config: GraphConfig) -> None:
    """Raise ConfigError if the device is at a port, where time is real; it names what to use."""
    instead = config.device.model.simulated_in
    if instead is not None:
        kind = kind_of("device", config.device.model)
        raise ConfigError(
            f"the device {kind} is at a serial port, emulated or not, and has no virtual time:"
            f" use `forcebound launch`, or `forcebound simulate {instead}`"
        )


class _Observer:
    """Collects the packets that a result needs; records all packets if there is a recorder."""

    def __init__(self, recorder: Recorder | None, wants_replies: bool) -> None:
        self._recorder = recorder
        self.samples = TelemetryCollector()
        self.events: list[Event] = []
        needed = (Telemetry, Event, *((EnvironmentReply,) if wants_replies else ()))
        self.packets = needed if recorder is None else tuple(TOPIC_OF)
        self.is_interrupted = False  # whether to end the run after the next packet

    def take(self, packet: Packet) -> None:
        if type(packet) is Telemetry:
            self.samples.take(packet)
        elif type(packet) is EnvironmentReply:
            self.samples.take_reply(packet)
        elif type(packet) is Event:
            self.events.append(packet)
        if self._recorder is not None:
            self._recorder.write(packet)
        if self.is_interrupted:
            self.is_interrupted = False
            raise KeyboardInterrupt

    def take_last_events(self, simulation: Simulation) -> None:
        now_ns = simulation.time_ns
        for node in simulation.nodes:
            for stream in simulation.graph.received(node.events.node):
                link = simulation.link(stream.name)
                if link is not None:
                    self.take(node.events.link_counts(now_ns, stream.name, link.counts))
            for event in node.last_events(now_ns):
                self.take(event)

    def close(self) -> None:
        if self._recorder is not None:
            self._recorder.close()


def _open(config: GraphConfig, observer: _Observer, late_ticks: LateTicks | None) -> Simulation:
    """Return the graph, its force engaged."""
    lateness = None if late_ticks is None else late_ticks.of(config.device.servo)
    device = build_device(config, lateness=lateness)
    others = [build_node(name, config) for name in ONE_HAND.loop if name != DEVICE]
    links = build_links(config)
    simulation = Simulation([*others, device], links, observer.take, observer.packets)
    for node in simulation.nodes:
        node.events.is_logged = False  # a short run, or one of a sweep, needs no log
    device.engage()
    return simulation


def _run(
    config: GraphConfig,
    simulation: Simulation,
    observer: _Observer,
    end_ns: int,
    may_end_early: bool,
    run: Callable[[int], None],
) -> bool:
    """Run the phases, by ``run``; return whether the run was interrupted."""
    launcher = EventLog(LAUNCHER)
    launcher.is_logged = False
    interrupts = _interrupt_after_a_packet(observer) if may_end_early else nullcontext()
    try:
        with interrupts, without_garbage_collection():
            tuner = Tuner(config)
            for part in timetable(config):
                if part.start_ns < end_ns:
                    run(part.start_ns)
                    tuner(simulation, Configure(part.start_ns, parameters(part.config)))
                    event = launcher.emit(part.start_ns, PHASE_BEGINS, part.message, part.data)
                    observer.take(event)
            run(end_ns)
    except KeyboardInterrupt:
        if not may_end_early:
            raise
        return True
    return False


def _advance(simulation: Simulation, report: Callable[[int], None], until_ns: int) -> None:
    """Run until a virtual time, in parts, and report the time after each."""
    while simulation.time_ns < until_ns:
        simulation.run(min(simulation.time_ns + PART_NS, until_ns))
        report(simulation.time_ns)


@contextmanager
def _interrupt_after_a_packet(observer: _Observer) -> Iterator[None]:
    """Let Ctrl-C wait for the end of a packet, so that recording and result hold the same."""

    def interrupt(number: int, frame: object) -> None:
        observer.is_interrupted = True

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
