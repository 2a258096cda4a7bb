"""The live runner: one node, the real clock, ZeroMQ.

One loop for every node: wait, receive, step, publish. Only the waiting differs:

* A node that wakes on arrival (controller, environment) sleeps until a packet arrives, until one
  is due on an impaired link, or until its ``wake_ns`` (:mod:`forcebound.run.process.inbox`).
* A servo (the device) never waits for packets. It sleeps until its ``wake_ns``, spins the last few
  microseconds, and takes the packets that have arrived.

Strategy:

1. Between receiving and sending, only necessary work is done: no exception, no logging, no
   allocation of objects that the garbage collector tracks.
2. The control socket and the connections of remote links are polled every 10 ms, between steps; the
   control socket of a device whose hand was dragged, after each tick.
3. Rejected packets are counted by reason in the node, so that a device's telemetry shows them.
4. When the loop ends, the servo first writes zero force, whether the cause is a stop request, a
   signal, the end of the launcher or a programming error.

Each process answers requests (:mod:`forcebound.messages.control`) between two steps, and publishes
faults and changes as events.
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import cast

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.graph.parameters import describe
from forcebound.messages.codec import encode
from forcebound.messages.control import (
    OF_NODES,
    Accepted,
    Answer,
    Configure,
    GetStatus,
    NodeStatus,
    Parameters,
    Refused,
    Request,
    StopProcess,
)
from forcebound.messages.events import PARAMETERS_SET, REMOTE, EventKind
from forcebound.messages.packets import (
    TOPIC_OF,
    EnergyTransfer,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    Packet,
    Scene,
)
from forcebound.messages.topology import HAND, ONE_HAND, Graph, Route, Stream, endpoint
from forcebound.network import sockets
from forcebound.network.ends import RemoteEnd
from forcebound.network.link import Link
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.roles import Fact
from forcebound.run.process.inbox import LONGEST_WAIT_NS, Inbox, Relays
from forcebound.stop import Stop

SCENE_INTERVAL_NS = (
    200_000_000  # over a link, whose packets a hand waits for: a scene has kilobytes
)
COMPLAINT_INTERVAL_NS = 1_000_000_000  # between two events about rejected packets
FINAL_STEPS = 4  # until the last telemetry, with zero force, is sent

_logger = logging.getLogger(__name__)


class Runner:
    """Drives one node, the process ``name`` of a graph; :func:`run` is the loop around it.

    A stream that is not in ``links`` has a perfect link. ``configure`` brings node and links to the
    parameters of a request; it returns those that it has changed. ``remotes`` are the links to
    other machines, by hand: a controller uses its link in addition to its sockets, an environment
    serves the hand over it instead of them.

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
        configure: "Callable[[Runner, Configure], Parameters] | None" = None,
        remotes: Mapping[str, RemoteLink] = MappingProxyType({}),
        graph: Graph = ONE_HAND,
    ) -> None:
        self._node = node
        self._network = network
        self._configure = configure
        self._spin_ns = spin_ns
        self._remotes = remotes
        self._run_dir = run_dir
        self.graph = graph
        routes = graph.routes(name)
        self._publish: dict[Route, Callable[[bytes], object]] = {
            route: network.publisher(endpoint(run_dir, stream)).send
            for route, stream in routes.items()
            if stream.sender == name
        }
        received = {route: one for route, one in routes.items() if one.receiver == name}
        out, self._relayed = self._relays(name)
        self._inbox = Inbox(received, links, self._reject, node.admit, graph.elsewhere, out)
        self.link, self.set_link = self._inbox.link, self._inbox.set_link
        served = [hand for hand, remote in remotes.items() if remote.end.role == "environment"]
        self._inbox.listen(network, run_dir, without=served)
        for hand, remote in remotes.items():
            self._connect_remote(hand, remote)
        requests = (*OF_NODES, *node.requests)
        self._control = network.control_server(endpoint(run_dir, graph.nodes[name]), requests)
        self._look_ns = 0  # next poll of the control socket and of remote links
        self._stop_requested = False
        self._facts: Sequence[Fact] = ()
        self.steps = 0
        self._next_complaint_ns = 0

    def run(self, stop: Stop, facts: Sequence[Fact] = ()) -> None:
        """Step the node until ``stop`` is requested; then force zero and the last telemetry."""
        self._facts = facts
        try:
            while not (stop.requested or self._stop_requested):
                if self._node.wakes_on_arrival:
                    self.wait(stop.descriptor)
                else:
                    self.turn(realtime.wait_until(self._node.wake_ns or 0, self._spin_ns))
        finally:
            self._node.stop(time.monotonic_ns())
        self._emit_last_events()
        if not self._node.wakes_on_arrival:
            for _ in range(FINAL_STEPS):
                self.turn(realtime.wait_until(self._node.wake_ns or 0, 0))

    def emit(
        self,
        event: EventKind,
        message: str,
        data: Mapping[str, str] | None = None,
        *,
        is_fault: bool = False,
    ) -> None:
        """Publish an event, and log it; see :meth:`forcebound.messages.events.EventLog.emit`."""
        time_ns = time.monotonic_ns()
        emitted = self._node.events.emit(time_ns, event, message, data, is_fault=is_fault)
        self._publish[Event, HAND](encode(emitted))

    def wait(self, stop_descriptor: int) -> None:
        """Sleep until a node that wakes on arrival is due, or a descriptor is readable; step it."""
        self._step(*self._inbox.wait(self._node.wake_ns, stop_descriptor))

    def turn(self, time_ns: int) -> None:
        """Receive, step the node if it is due, publish."""
        # On an impaired link the time of arrival counts, so no packet waits for a later turn.
        listens = self._node.needs_packets or self._inbox.links
        self._step(time_ns, self._inbox.take(time_ns) if listens else ())

    def _step(self, time_ns: int, received: Sequence[Packet]) -> None:
        wake_ns = self._node.wake_ns
        if received or (wake_ns is not None and wake_ns <= time_ns):
            publish = self._publish
            for packet in self._node.step(time_ns, received):
                publish[type(packet), packet.hand](encode(packet))
            self.steps += 1
        if time_ns >= self._look_ns:
            self.look(time_ns)
        elif self._node.awaits_requests:
            self._control.serve(self.answer, 1)

    def look(self, time_ns: int) -> None:
        """Serve the control socket and the remote links."""
        self._look_ns = time_ns + LONGEST_WAIT_NS
        self._control.serve(self.answer)
        for hand, remote in self._remotes.items():
            if time_ns < remote.due_ns and not sockets.wait(remote.descriptors, 0):
                continue
            for notice in remote.watch(time_ns):
                event = cast(EventKind, f"{REMOTE}{notice.kind}")
                message, data = notice.message, notice.data
                if hand != HAND and remote.end.role == "environment":  # a controller has one hand
                    message, data = f"{hand}: {message}", {**data, "hand": hand}
                self.emit(event, message, data, is_fault=notice.is_problem)

    def answer(self, request: Request) -> Answer:
        """Return the answer to a request of the control socket."""
        match request:
            case GetStatus():
                return self.status()
            case StopProcess():
                self._stop_requested = True
                return Accepted()
            case Configure():
                return self._change(request)
            case _:
                return self._node.handle(request)

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The node, as a tuple of one: the same interface as ``Simulation``."""
        return (self._node,)

    def _connect_remote(self, hand: str, remote: RemoteLink) -> None:
        """Let a hand's queries and replies go to, and come from, another machine.

        Sent packets also go to this machine's sockets; received packets are passed on to them, on
        another address: so a recorder here sees both.
        """
        sent: type[Packet] = EnvironmentQuery
        came: type[Packet] = EnvironmentReply
        if remote.end.role == "environment":
            sent, came = came, sent
            self._send_also((Scene, HAND), remote, SCENE_INTERVAL_NS)
        self._send_also((sent, hand), remote)
        forwarded = self.graph.forwarded(TOPIC_OF[came], hand)
        forward = self._network.publisher(endpoint(self._run_dir, forwarded)).send
        self._inbox.listen_remotely(came, hand, remote.channel, forward, self._relayed[hand])

    def _send_also(self, route: Route, remote: RemoteLink, interval_ns: int = 0) -> None:
        """Let packets of a route also go to another machine, there first, not more often."""
        here, there, due_ns = self._publish[route], remote.send, 0

        def both(data: bytes) -> None:
            nonlocal due_ns
            if not interval_ns or time.monotonic_ns() >= due_ns:
                there(data)
                due_ns = interval_ns and time.monotonic_ns() + interval_ns
            here(data)

        self._publish[route] = both

    def _relays(self, name: str) -> tuple[Relays, dict[str, Relays]]:
        """Return what passes on energy of hands, and scenes, between this machine and others.

        First what goes from this machine; then what comes over each link, by its hand: to a device
        here, or to another link.
        """
        out: dict[Stream, Callable[[bytes], object]] = {}
        into: dict[str, dict[Stream, Callable[[bytes], object]]] = {h: {} for h in self._remotes}
        serves = any(one.end.role == "environment" for one in self._remotes.values())
        for stream in self.graph.streams:
            if stream.topic == TOPIC_OF[Scene] and stream.is_forwarded and stream.sender == name:
                show = self._network.publisher(endpoint(self._run_dir, stream)).send
                into |= {hand: {**relays, stream: show} for hand, relays in into.items()}
            if stream.partner is None or stream.hand is None:
                continue
            comes, goes = stream.hand, stream.partner  # the links of an environment are of others
            if not serves:
                comes, goes = goes, comes
            is_between = comes in into and goes in into
            if not is_between and name not in (stream.sender, stream.receiver):
                continue
            if comes in into:
                here = self._publish.get((EnergyTransfer, stream.hand))
                send = self._remotes[goes].send if goes in into else here
                if send is not None:
                    into[comes][stream] = send
            elif goes in into:
                out[stream] = self._remotes[goes].send
        return out, {**into}

    def _change(self, request: Configure) -> Answer:
        try:
            changed = {} if self._configure is None else self._configure(self, request)
        except ConfigError as error:
            return Refused(str(error))
        if changed:
            values = {name: str(value) for name, value in changed.items()}
            words = f"changed: {describe(changed, request.units)}"
            self.emit(PARAMETERS_SET, words, values)
        return Accepted()

    def status(self) -> NodeStatus:
        """Return how the process is doing."""
        status = self._node.status()
        status.received = dict(self._inbox.received)
        status.steps = self.steps
        status.links = self._inbox.link_counts()
        status.remotes = {hand: remote.status() for hand, remote in self._remotes.items()}
        status.realtime = list(self._facts)
        return status

    def _emit_last_events(self) -> None:
        """Publish the last events of the run: counts of the links, and events of the node."""
        now_ns = time.monotonic_ns()
        counted = self._inbox.link_counts().items()
        events = [self._node.events.link_counts(now_ns, *link) for link in counted]
        for event in (*events, *self._node.last_events(now_ns)):
            self._publish[Event, HAND](encode(event))

    def _reject(self, reason: str, why: str) -> None:
        self._node.reject(reason)
        time_ns = time.monotonic_ns()
        if time_ns >= self._next_complaint_ns:
            self._next_complaint_ns = time_ns + COMPLAINT_INTERVAL_NS
            rejected = self._node.status().rejected
            data = {name: str(count) for name, count in rejected.items()}
            counts = ", ".join(f"{count} {name}" for name, count in data.items())
            message = f"rejected packets so far: {counts}; the last: {why}"
            self.emit("packets_refused", message, data, is_fault=True)


def run(
    node: Node,
    name: str,
    run_dir: Path,
    links: Mapping[str, Link[Packet]],
    settings: realtime.Settings,
    stop: Stop,
    configure: Callable[[Runner, Configure], Parameters] | None = None,
    remote_ends: Mapping[str, RemoteEnd] = MappingProxyType({}),
    graph: Graph = ONE_HAND,
) -> NodeStatus:
    """Run a node until a stop request, and close it; return its last status.

    Arguments and errors are those of :class:`Runner`; ``settings`` say how punctual to be.
    """
    facts = realtime.enter(settings, graph.nodes[name].role)
    _logger.info("; ".join(fact.sentence for fact in facts))
    try:
        with ExitStack() as stack:
            network = stack.enter_context(Network())
            remotes: dict[str, RemoteLink] = {}
            for hand, end in remote_ends.items():  # a network has one authenticator
                own = stack.enter_context(Network()) if remotes else network
                remotes[hand] = RemoteLink(own, end)
            spin_ns = settings.spin_ns
            runner = Runner(node, name, run_dir, links, network, spin_ns, configure, remotes, graph)
            realtime.freeze_garbage()
            runner.run(stop, facts)
            realtime.be_ordinary()
            return runner.status()
    finally:
        node.close()
