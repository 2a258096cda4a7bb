"""Run of a launch file in virtual time: the nodes of a live run, in this process."""

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.phases import timetable
from forcebound.graph.resolved import kind_of, to_document
from forcebound.haptics.devices import JointsModel
from forcebound.haptics.environments import may_report_contacts
from forcebound.messages.control import Configure, Parameters
from forcebound.messages.events import PHASE_BEGINS, EventLog, is_of
from forcebound.messages.packets import TOPIC_OF, EnvironmentReply, Event, Packet, Telemetry
from forcebound.messages.topology import Document, flat
from forcebound.nodes.environment import EnvironmentNode
from forcebound.realtime import without_garbage_collection
from forcebound.recordings.recording import Recorder
from forcebound.recordings.telemetry import TelemetryCollector
from forcebound.roles import DEVICE, LAUNCHER
from forcebound.run.application import Tuner
from forcebound.run.build import build_device, build_links, build_node
from forcebound.run.results import RunResult, run_metadata
from forcebound.run.simulation import LateTicks, Simulation
from forcebound.stop import Stop

Progress = Callable[[int, int], None]  # takes what is done, and the total

MS = 1_000_000  # ns
PART_NS = 100 * MS  # of virtual time, between two looks at progress and stop requests


class VirtualGraph:
    """A graph in virtual time, open and engaged, whose time goes on by :meth:`run`.

    ``observe`` is called with each packet of the classes ``observed`` at its sending, in order, and
    with the events of the phases and of the end. ConfigError or DeviceError if a part cannot be
    opened; :func:`check_has_virtual_time` comes first. Unless ``has_views``, the environment makes
    no scenes, and no contacts that no controller uses: the forces are the same.
    """

    def __init__(
        self,
        config: GraphConfig,
        observe: Callable[[Packet], None],
        observed: Collection[type[Packet]],
        late_ticks: LateTicks | None = None,
        *,
        has_views: bool = True,
    ) -> None:
        config = config.on_one_machine()
        self.devices = {}
        for name, hand in config.hands.items():
            lateness = None if late_ticks is None else late_ticks.of(hand.servo)
            self.devices[name] = build_device(hand, lateness=lateness, name=name)
        graph, links = config.graph, build_links(config)
        others = [build_node(n, config) for n in graph.loop if graph.nodes[n].role != DEVICE]
        nodes = [*others, *self.devices.values()]
        (self.world,) = (node for node in others if isinstance(node, EnvironmentNode))
        if not has_views:
            controllers = [hand.controller for hand in config.hands.values()]
            takes = any(each.takes_contacts or not _is_ours(each) for each in controllers)
            self.world.views.leave_out(not takes and _is_ours(config.environment.model))
        self._simulation = Simulation(nodes, links, observe, observed, graph)
        self._observe = observe
        self._launcher = EventLog(LAUNCHER)
        # A short run, or one of a sweep, needs no log.
        for events in (self._launcher, *(node.events for node in self._simulation.nodes)):
            events.is_logged = False
        self._tuner = Tuner(config)
        self._phases = deque(timetable(config))
        for device in self.devices.values():
            device.engage()

    @property
    def time_ns(self) -> int:
        """Virtual time, until which everything has happened, in ns."""
        return self._simulation.time_ns

    def run(self, until_ns: int) -> None:
        """Let everything happen that is due before ``until_ns``; begin the phases that are due."""
        while self._phases and self._phases[0].start_ns < until_ns:
            phase = self._phases.popleft()
            start_ns = phase.start_ns
            self._simulation.run(start_ns)
            self.set(phase.values)
            self._observe(self._launcher.emit(start_ns, PHASE_BEGINS, phase.message, phase.data))
        self._simulation.run(until_ns)

    def set(self, values: Parameters) -> None:
        """Change parameters from now on, to values of which the configuration has been made."""
        self._tuner(self._simulation, Configure(self.time_ns, values))

    def report_end(self) -> None:
        """Let the nodes and links report what they report of the run at its end."""
        simulation, now_ns = self._simulation, self.time_ns
        for node in simulation.nodes:
            for stream in simulation.graph.received(node.events.node):
                link = simulation.link(stream.name)
                if link is not None:
                    self._observe(node.events.link_counts(now_ns, stream.name, link.counts))
            for event in node.last_events(now_ns):
                self._observe(event)

    def close(self) -> None:
        """Stop and close the nodes."""
        with ExitStack() as stack:  # all of them, even if one fails
            for node in self._simulation.nodes:
                stack.callback(node.close)
                stack.callback(node.stop, self.time_ns)


def run_virtual(
    config: GraphConfig,
    duration: float | None = None,
    record: Path | None = None,
    *,
    may_end_early: bool = False,
    progress: Progress = lambda done, total: None,
    late_ticks: LateTicks | None = None,
) -> RunResult:
    """Run a graph of one hand in virtual time; see :func:`run_virtual_hands`."""
    _ = config.only  # of several, none is meant
    (result,) = run_virtual_hands(
        config,
        duration,
        record,
        may_end_early=may_end_early,
        progress=progress,
        late_ticks=late_ticks,
    ).values()
    return result


def run_virtual_hands(
    config: GraphConfig,
    duration: float | None = None,
    record: Path | None = None,
    *,
    may_end_early: bool = False,
    progress: Progress = lambda done, total: None,
    late_ticks: LateTicks | None = None,
) -> dict[str, RunResult]:
    """Run a graph in virtual time; return the result of each hand by its name.

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
        DeviceError: If a user's device failed.
        KeyboardInterrupt: If the run was interrupted, and may not end early or had no sample yet.
    """
    check_has_virtual_time(config)
    config = config.on_one_machine()
    end_ns = round((duration or config.duration) * 1e9)
    with ExitStack() as stack:
        recorder = None
        if record is not None:
            recorder = Recorder(record, run_metadata(config), graph=config.graph)
        wants_replies = may_report_contacts(config.environment.model)
        observer = _Observer(recorder, config.hands, wants_replies)
        stack.callback(observer.close)
        graph = VirtualGraph(config, observer.take, observer.packets, late_ticks)
        stack.callback(graph.close)
        stop = stack.enter_context(Stop()) if may_end_early else None
        began = time.perf_counter()
        with without_garbage_collection():
            while graph.time_ns < end_ns and not (stop is not None and stop.requested):
                graph.run(min(graph.time_ns + PART_NS, end_ns))
                progress(graph.time_ns // MS, end_ns // MS)
        took = time.perf_counter() - began
        graph.report_end()
    interrupted = stop is not None and stop.requested
    if not observer.has_samples and interrupted:
        if record is not None:
            record.unlink(missing_ok=True)
        raise KeyboardInterrupt
    if not observer.has_samples:
        raise RunError("the run ended before its first sample; use a longer --duration")
    results = observer.results(to_document(config))
    speed = graph.time_ns * 1e-9 / took
    return {
        hand: replace(result, interrupted=interrupted, times_real_time=speed)
        for hand, result in results.items()
    }


def _is_ours(part: object) -> bool:
    """Return whether a controller or an environment comes with forcebound."""
    return type(part).__module__.startswith("forcebound.")


def check_has_virtual_time(config: GraphConfig) -> None:
    """Raise ConfigError if the device is at a port, where time is real; it names what to use."""
    for hand in config.hands.values():
        instead = hand.device.simulated_in
        if instead is None:
            continue
        if len(config.hands) > 1 and isinstance(hand.device, JointsModel):
            instead = "joint_arms"
        kind = kind_of("device", hand.device)
        raise ConfigError(
            f"the device {kind} is no simulated one, and has no virtual time: use"
            f" `forcebound launch`, or `forcebound simulate {instead}`"
        )


class _Observer:
    """Collects the packets that a result needs; records all packets if there is a recorder."""

    def __init__(
        self, recorder: Recorder | None, hands: Iterable[str], wants_replies: bool
    ) -> None:
        self._recorder = recorder
        self.samples = {hand: TelemetryCollector() for hand in hands}
        self.events: list[Event] = []
        needed = (Telemetry, Event, *((EnvironmentReply,) if wants_replies else ()))
        self.packets = needed if recorder is None else tuple(TOPIC_OF)

    @property
    def has_samples(self) -> bool:
        return all(self.samples.values())

    def take(self, packet: Packet) -> None:
        if type(packet) is Telemetry:
            self.samples[packet.hand].take(packet)
        elif type(packet) is EnvironmentReply:
            self.samples[packet.hand].take_reply(packet)
        elif type(packet) is Event:
            self.events.append(packet)
        if self._recorder is not None:
            self._recorder.write(packet)

    def results(self, document: Document) -> dict[str, RunResult]:
        return {
            hand: RunResult(
                samples.columns(),
                flat(document, hand),
                [event for event in self.events if is_of(event, hand)],
            )
            for hand, samples in self.samples.items()
        }

    def close(self) -> None:
        if self._recorder is not None:
            self._recorder.close()
