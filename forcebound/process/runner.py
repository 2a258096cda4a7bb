"""The live runner: one node, the real clock, ZeroMQ.

One loop for every node: wait, receive, step, publish. Only the waiting differs:

* A node that wakes on arrival (controller, environment) sleeps until a packet arrives, until one
  is through on an impaired link, or until its own ``wake_ns``.
* A servo (the device) never waits for packets. It sleeps until its ``wake_ns``, spins the last few
  microseconds, and takes what is there by then.

Strategy:

1. The path from packet to packet does nothing that could be done before or after it: no exception,
   no logging, no allocation of anything that the collector must visit.
2. A perfect link costs nothing: only the newest packet is taken, and no link object exists.
   A link with an impairment drains its socket into its model.
3. Rejected packets are counted by reason in the node, so that a device's telemetry shows them.
4. Whatever ends the loop, the servo writes zero force before anything else is done: a stop request,
   a signal, the death of the launcher, a programming mistake.

Each process answers on a control socket between two steps: ``{"request": "status"}``,
``{"request": "engage"}``, ``{"request": "configure", ...}``, ``{"request": "stop"}``; and publishes
what happens to it as events.
"""

import logging
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.errors import ConfigError, PacketError
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import (
    TOPIC_OF,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    Packet,
)
from forcebound.network import sockets
from forcebound.network.ends import RemoteEnd
from forcebound.network.link import Link
from forcebound.network.remote import RemoteStreams
from forcebound.network.sockets import Network
from forcebound.network.subscriber import Subscriber
from forcebound.nodes import Node
from forcebound.process.endpoints import (
    control_endpoint,
    event_endpoint,
    remote_endpoint,
    topic_endpoint,
)
from forcebound.process.readiness import readiness
from forcebound.process.stop import Stop

CONTROL_INTERVAL = 8  # steps of a servo between two looks at its control socket
IDLE_NS = 500_000_000  # longest sleep of a node to which nothing happens
COMPLAINT_INTERVAL_NS = 1_000_000_000  # between two events about rejected packets
FAREWELL_STEPS = 4  # in which the last telemetry, with zero force, comes

_logger = logging.getLogger(__name__)


class _Inlet:
    """One stream in: socket, codec, and the model of a bad network if there is one."""

    def __init__(
        self,
        expected: type[Packet],
        link: Link[Packet] | None,
        subscriber: Subscriber,
        forward: Callable[[bytes], Any] | None = None,
    ) -> None:
        self.topic = TOPIC_OF[expected]
        self.expected = expected
        self.link = link
        self.subscriber = subscriber
        self.forward = forward  # gets what comes from another machine, for those on this one
        self.count = 0


class Runner:
    """Drives one node; :func:`run` is the loop around it.

    Args:
        node: What decides.
        name: Of the process; its control socket is named after it.
        run_dir: Directory of the run's ``ipc`` sockets.
        links: Impaired links by topic; a topic that is not here has a perfect link.
        network: Where the sockets are opened.
        spin_ns: See :class:`forcebound.realtime.Settings`.
        configure: Brings node and links up to date with the run's launch document on request, and
            returns the parameters that it has changed.
        remote: The link to another machine. A controller uses it beside its own sockets, an
            environment instead of them.

    Raises:
        ConfigError: If an endpoint is in use or not permitted.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        run_dir: Path,
        links: Mapping[str, Link[Packet]],
        network: Network,
        spin_ns: int = 0,
        configure: "Callable[[Runner], Mapping[str, Any]] | None" = None,
        remote: RemoteStreams | None = None,
    ) -> None:
        self._node = node
        self._network = network
        self._configure = configure
        self._spin_ns = spin_ns
        self._remote = remote
        self._run_dir = run_dir
        is_away = remote is not None and remote.end.role == "environment"
        self._publish = {
            packet: network.publisher(topic_endpoint(run_dir, TOPIC_OF[packet])).send
            for packet in node.publishes
            if packet is not Event
        }
        self._publish[Event] = network.publisher(event_endpoint(run_dir, name)).send
        self._inlets = [
            _Inlet(packet, links.get(topic), self._subscribe(topic, links.get(topic) is None))
            for packet, topic in ((packet, TOPIC_OF[packet]) for packet in node.subscribes)
            if not is_away
        ]
        if remote is not None:
            self._reach_out(remote, links)
        self._control = network.control_server(control_endpoint(run_dir, name))
        self._links: list[Link[Packet]]
        self._descriptors: list[int]
        self._readable: Collection[int] | None  # None: look at everything
        self._unsettled: list[Subscriber] = []  # to be asked before their descriptors are
        self._listen()
        self._stop_requested = False
        self._facts: Sequence[realtime.Fact] = ()
        self.steps = 0
        self._next_complaint_ns = 0

    def run(
        self, stop: Stop, facts: Sequence[realtime.Fact] = (), engages_itself: bool = False
    ) -> None:
        """Step the node until ``stop`` is requested; then force zero and the last telemetry.

        Args:
            stop: Ends the loop.
            facts: What the status answers under ``realtime``.
            engages_itself: Whether a servo engages when it is ready, rather than on request.
        """
        self._facts = facts
        try:
            if self._node.wakes_on_arrival:
                self._run_on_perfect_links(stop)  # until they are not, which may be at once
                self._run_on_arrival(stop)
            else:
                self._run_on_schedule(stop, engages_itself)
        finally:
            self._node.stop(time.monotonic_ns())
        self._emit_counts()
        if not self._node.wakes_on_arrival:
            for _ in range(FAREWELL_STEPS):
                self.turn(realtime.wait_until(self._node.wake_ns or 0, 0))

    def emit(
        self,
        event: str,
        message: str,
        data: Mapping[str, str] | None = None,
        *,
        is_fault: bool = False,
    ) -> None:
        """Publish an event, and log it; see :meth:`forcebound.nodes.events.EventLog.emit`."""
        time_ns = time.monotonic_ns()
        told = self._node.events.emit(time_ns, event, message, data, is_fault=is_fault)
        self._publish[Event](encode(told))

    def wait(self, stop_descriptor: int) -> int:
        """Sleep until a node that wakes on arrival may have something to do; return the time.

        It also answers the control socket.

        Args:
            stop_descriptor: Ends the sleep when it is readable.
        """
        readable = [s.descriptor for s in self._unsettled if s.pending()]
        self._unsettled.clear()
        next_ns = self._next_ns()
        timeout_ns = IDLE_NS if next_ns is None else min(IDLE_NS, next_ns - time.monotonic_ns())
        if readable:  # a flood on one stream must not keep the others, and the control, waiting
            timeout_ns = 0
        readable += sockets.wait((*self._descriptors, stop_descriptor), timeout_ns)
        # Now and then everything is looked at, in case a descriptor has kept something to itself.
        self._readable = None if not readable and timeout_ns == IDLE_NS else readable
        if self._readable is None or self._control.descriptor in self._readable:
            self._control.serve(self.answer)
        if self._remote is not None:
            self._watch(self._remote, readable)
        return time.monotonic_ns()

    def _watch(self, remote: RemoteStreams, readable: Collection[int]) -> None:
        time_ns = time.monotonic_ns()
        if time_ns >= remote.due_ns or not self._remote_descriptors.isdisjoint(readable):
            for notice in remote.watch(time_ns):
                event = f"remote_{notice.kind}"
                self.emit(event, notice.message, notice.data, is_fault=notice.is_problem)

    def turn(self, time_ns: int) -> None:
        """Receive, step the node if it has something to do, publish.

        It looks at the streams of which :meth:`wait` has found that something came; without a
        :meth:`wait` before it, at all of them.
        """
        # On an impaired link the time of arrival counts, so nothing waits.
        listens = self._node.needs_packets or self._links
        received = self.receive(time_ns) if listens else []
        wake_ns = self._node.wake_ns
        if received or (wake_ns is not None and wake_ns <= time_ns):
            publish = self._publish
            for packet in self._node.step(time_ns, received):
                publish[type(packet)](encode(packet))
            self.steps += 1

    def receive(self, time_ns: int) -> list[Packet]:
        """Return the packets that have arrived and are through their links at ``time_ns``."""
        readable, self._readable = self._readable, None
        received: list[Packet] = []
        for inlet in self._inlets:
            subscriber, link = inlet.subscriber, inlet.link
            if readable is None:
                arrived = subscriber.receive()
                if arrived and not subscriber.emptied and self._node.wakes_on_arrival:
                    self._unsettled.append(subscriber)
            elif subscriber.descriptor in readable:
                arrived = subscriber.receive_ready()
                if not subscriber.emptied:
                    self._unsettled.append(subscriber)
            elif link is None:
                continue
            else:
                arrived = []
            for data in arrived:
                try:
                    packet = decode(data, inlet.expected)
                except PacketError as error:
                    self._reject(error.reason)
                    continue
                inlet.count += 1
                if inlet.forward is not None:
                    inlet.forward(data)
                if link is None:
                    received.append(packet)
                else:
                    link.accept(time_ns, packet, len(data))
            if link is not None:
                received += link.due(time_ns)
        return received

    def answer(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer to one request of the control socket."""
        wanted = request.get("request")
        if wanted == "status":
            return self.status()
        if wanted == "configure" and self._configure is not None:
            return self._change()
        if wanted == "stop":
            self._stop_requested = True
            return {"stopping": True}
        answer = self._node.handle(request)
        if answer is None:
            known = ", ".join(("status", "stop", "configure", *self._node.requests))
            return {"error": f"unknown request {wanted!r}; known: {known}"}
        return answer

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The node that it drives; as of a simulation, which drives several."""
        return (self._node,)

    def link(self, topic: str) -> Link[Packet] | None:
        """Return the model of the link on which ``topic`` arrives; None if it is perfect."""
        return next((inlet.link for inlet in self._inlets if inlet.topic == topic), None)

    def set_link(self, topic: str, link: Link[Packet]) -> None:
        """Impair a link that was perfect."""
        for inlet in self._inlets:
            if inlet.topic == topic:
                inlet.link = link
                inlet.subscriber.newest_only = False
        self._listen()

    def _subscribe(self, topic: str, newest_only: bool) -> Subscriber:
        endpoint = topic_endpoint(self._run_dir, topic)
        return self._network.subscriber(endpoint, newest_only=newest_only)

    def _reach_out(self, remote: RemoteStreams, links: Mapping[str, Link[Packet]]) -> None:
        """Let packets of the environment's two topics go to, and come from, another machine.

        What goes out goes to this machine's sockets, too; what comes in is passed on to them, on
        an address of its own: so a recorder here sees both.
        """
        sent: type[Packet] = EnvironmentQuery
        came: type[Packet] = EnvironmentReply
        if remote.end.role == "environment":
            sent, came = came, sent
        here, there = self._publish[sent], remote.publisher.send

        def both(data: bytes) -> None:
            there(data)
            here(data)

        self._publish[sent] = both
        link = links.get(TOPIC_OF[came])
        remote.subscriber.newest_only = link is None
        endpoint = remote_endpoint(self._run_dir, TOPIC_OF[came])
        forward = self._network.publisher(endpoint).send
        self._inlets.append(_Inlet(came, link, remote.subscriber, forward))

    def _listen(self) -> None:
        self._links = [inlet.link for inlet in self._inlets if inlet.link is not None]
        self._descriptors = [inlet.subscriber.descriptor for inlet in self._inlets]
        self._descriptors.append(self._control.descriptor)
        self._remote_descriptors = frozenset(self._remote.descriptors if self._remote else ())
        self._descriptors += self._remote_descriptors
        self._readable = None
        self._unsettled.clear()

    def _change(self) -> dict[str, Any]:
        assert self._configure is not None
        try:
            changed = self._configure(self)
        except ConfigError as error:
            return {"error": str(error)}
        if changed:
            values = {name: str(value) for name, value in changed.items()}
            told = ", ".join(f"{name} = {value}" for name, value in values.items())
            self.emit("parameter_set", f"changed: {told}", values)
        return {"configured": True}

    def status(self) -> dict[str, Any]:
        """Return how the process is doing, as a map of plain values.

        ``ready``: one packet has come on each stream; ``waiting_for``: topics on which none has.
        ``received``: counts by topic. The node adds its own (:meth:`forcebound.nodes.Node.status`).
        """
        received = dict.fromkeys((inlet.topic for inlet in self._inlets), 0)
        for inlet in self._inlets:
            received[inlet.topic] += inlet.count
        return {
            **readiness(received),
            **self._node.status(),
            "steps": self.steps,
            "links": self._counts(),
            "remote": None if self._remote is None else self._remote.status(),
            "realtime": [{"code": fact.code, "data": dict(fact.data)} for fact in self._facts],
        }

    def _counts(self) -> dict[str, dict[str, int]]:
        """How many packets had which fate on each impaired link, by topic."""
        return {inlet.topic: inlet.link.counts for inlet in self._inlets if inlet.link is not None}

    def _emit_counts(self) -> None:
        """Leave the links' counts in the recording."""
        for topic, counts in self._counts().items():
            event = self._node.events.link_counts(time.monotonic_ns(), topic, counts)
            self._publish[Event](encode(event))

    def _run_on_perfect_links(self, stop: Stop) -> None:
        """Do as :meth:`_run_on_arrival` in fewer lines: each costs the loop a microsecond, cold."""
        if self._links or self._remote is not None:
            return
        node, publish = self._node, self._publish
        step, clock = node.step, time.monotonic_ns
        inlets = {inlet.subscriber.descriptor: inlet for inlet in self._inlets}
        waiter = sockets.Waiter([*inlets, self._control.descriptor, stop.descriptor])
        unsettled: list[int] = []  # a flood on one stream must not keep the others waiting
        with waiter:
            while not (stop.requested or self._stop_requested):
                wake_ns = node.wake_ns
                if unsettled:
                    ready = list({*unsettled, *waiter.wait(0)})
                    unsettled.clear()
                else:
                    ready = waiter.wait(IDLE_NS if wake_ns is None else wake_ns - clock())
                for descriptor in ready:
                    inlet = inlets.get(descriptor)
                    if inlet is None:
                        self._control.serve(self.answer)
                        if self._links:
                            return
                        continue
                    data = inlet.subscriber.take()
                    if data is None:
                        continue
                    try:
                        packet = decode(data, inlet.expected)
                    except PacketError as error:
                        self._reject(error.reason)
                    else:
                        for sent in step(clock(), (packet,)):
                            publish[type(sent)](encode(sent))
                        inlet.count += 1
                        self.steps += 1
                    if not inlet.subscriber.emptied:
                        unsettled.append(descriptor)
                if wake_ns is not None and wake_ns <= clock():
                    for sent in step(clock(), ()):
                        publish[type(sent)](encode(sent))

    def _run_on_arrival(self, stop: Stop) -> None:
        self.turn(time.monotonic_ns())  # what the run on perfect links has left
        while not (stop.requested or self._stop_requested):
            self.turn(self.wait(stop.descriptor))

    def _run_on_schedule(self, stop: Stop, engages_itself: bool) -> None:
        while not (stop.requested or self._stop_requested):
            self.turn(realtime.wait_until(self._node.wake_ns or 0, self._spin_ns))
            if self.steps % CONTROL_INTERVAL == 0:
                self._control.serve(self.answer)
                if engages_itself and self.status()["ready"]:
                    self.answer({"request": "engage"})
                    engages_itself = False

    def _next_ns(self) -> int | None:
        """Return when the node or a link has something to do, in ns."""
        next_ns = self._node.wake_ns
        for link in self._links:
            due_ns = link.next_due_ns
            if due_ns is not None and (next_ns is None or due_ns < next_ns):
                next_ns = due_ns
        if self._remote is not None:
            next_ns = self._remote.due_ns if next_ns is None else min(next_ns, self._remote.due_ns)
        return next_ns

    def _reject(self, reason: str) -> None:
        self._node.reject(reason)
        time_ns = time.monotonic_ns()
        if time_ns >= self._next_complaint_ns:
            self._next_complaint_ns = time_ns + COMPLAINT_INTERVAL_NS
            rejected = self._node.status()["rejected"]
            counts = ", ".join(f"{count} {why}" for why, count in rejected.items())
            data = {why: str(count) for why, count in rejected.items()}
            message = f"rejected packets so far: {counts}"
            self.emit("packets_refused", message, data, is_fault=True)


def run(
    node: Node,
    name: str,
    run_dir: Path,
    links: Mapping[str, Link[Packet]],
    settings: realtime.Settings,
    stop: Stop,
    engages_itself: bool = False,
    configure: Callable[[Runner], Mapping[str, Any]] | None = None,
    remote_end: RemoteEnd | None = None,
) -> dict[str, Any]:
    """Run a node until it is asked to stop; return its last status.

    Args:
        node: What decides.
        name: Of the process: ``"device"``, ``"controller"`` or ``"environment"``.
        run_dir: Directory of the run's ``ipc`` sockets.
        links: Impaired links by topic; a topic that is not here has a perfect link.
        settings: How punctual to be.
        stop: Ends the loop.
        engages_itself: Whether a servo engages when it is ready, rather than on request.
        configure: See :class:`Runner`.
        remote_end: This end of the link to another machine.

    Raises:
        ConfigError: If an endpoint is in use or not permitted.
    """
    facts = realtime.enter(settings, name)
    _logger.info("; ".join(fact.sentence for fact in facts))
    with Network() as network:
        remote = None if remote_end is None else RemoteStreams(network, remote_end)
        runner = Runner(node, name, run_dir, links, network, settings.spin_ns, configure, remote)
        realtime.freeze_garbage()
        runner.run(stop, facts, engages_itself)
        return runner.status()
