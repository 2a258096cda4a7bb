"""Measures this machine: how punctual wake-ups are, and the graph's loop beside bare sockets.

Contestants take turns, each in processes of its own: on a shared machine only ratios of
neighbouring rounds mean something. ``benchmarks/`` measures more, with the same functions.
"""

import math
import os
import signal
import struct
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import zmq
from msgspec import structs
from zmq.backend import Socket as _CompiledSocket

from forcebound import realtime
from forcebound.errors import RunError
from forcebound.graph.loader import load
from forcebound.messages import packets
from forcebound.messages.codec import encode
from forcebound.messages.events import EventLog
from forcebound.messages.topology import ONE_HAND, endpoint
from forcebound.network.sockets import Network, make_socket
from forcebound.network.streams import Publisher
from forcebound.nodes import Node
from forcebound.realtime import Settings
from forcebound.roles import CONTROLLER, DEVICE, ENVIRONMENT
from forcebound.run.build import build_links, build_node
from forcebound.run.process.runner import Runner, run
from forcebound.stop import Stop

LAUNCH_FILE = "stiff_wall"
SHARES = {"p50": 0.5, "p99": 0.99, "p99_9": 0.999, "max": 1.0}
WARMUP = 100  # exchanges of each round before the first that counts
READY = 60.0  # s for the processes of a contestant to find each other, on a busy machine
TIMEOUT_NS = 100_000_000  # an answer that takes longer counts as lost

Exchange = Callable[[int], int | None]  # takes the instant when it is due; ns, None: no answer
Timing = tuple[int, int]  # period, in ns, and number of exchanges that count
_TICK = struct.Struct("<q")
_NOW, _SEQ = 2**60 + 1, 10**6  # as long on the wire as a real stamp and sequence number
_STATE = packets.DeviceState(_SEQ, _NOW, 1.5, (0.012,), (0.1,), (1.5,))
_QUERY = packets.EnvironmentQuery(_SEQ, _NOW, _SEQ, _NOW, 1.5, (0.012,), (0.1,), "e")
_REPLY = packets.EnvironmentReply(_SEQ, _NOW, _SEQ, _NOW, _SEQ, _NOW, (1.5,), "e")
_COMMAND = packets.ForceCommand(_SEQ, _NOW, _SEQ, _NOW, (1.5,))


class Round(NamedTuple):
    """What one round of a contestant has measured; all times in ns."""

    times_ns: Sequence[int]
    missed: int = 0  # exchanges that were lost or took longer than a period
    processor_ns: int = 0
    elapsed_ns: int = 0


def percentile(rounds: Iterable[Round], name: str) -> int:
    """Return the smallest measured time that a share of all do not exceed, a key of ``SHARES``."""
    ordered = sorted(time_ns for one in rounds for time_ns in one.times_ns)
    if not ordered:
        raise RunError("nothing was measured: every answer was lost")
    return ordered[max(0, math.ceil(SHARES[name] * len(ordered)) - 1)]


def plan(duration: float, contestants: int, rate: float) -> tuple[int, Timing]:
    """Divide ``duration``, in s: return the number of rounds, of about 1 s, and their timing."""
    rounds = max(1, int(duration / contestants))
    return rounds, (round(1e9 / rate), max(20, round(duration / contestants / rounds * rate)))


def measure(duration: float, rate: float) -> dict[str, list[Round]]:
    """Return the rounds of wake-ups in each permitted scheduling class, and of both loops."""
    core = realtime.choose_core("auto")
    policies = ("other", "fifo") if realtime.permits_fifo() else ("other",)
    settings = [Settings(policy=policy, core=core) for policy in policies]
    names = {f"wake-up, {one.policy}": partial(apart, wake_ups, one) for one in settings}
    names |= {
        "loop of the graph": partial(loop, graph, settings[-1]),
        "loop of bare sockets": partial(loop, bare, settings[-1]),
    }
    number, timing = plan(duration, len(names), rate)
    turns = [{name: one(timing) for name, one in names.items()} for _ in range(number)]
    return {name: [turn[name] for turn in turns] for name in names}


def pace(exchange: Exchange, settings: Settings | None, timing: Timing) -> Round:
    """Run an exchange each period, as a servo: instants that have passed are skipped."""
    period_ns, exchanges = timing
    spin_ns, times_ns, missed = (settings or Settings()).spin_ns, list[int](), 0
    ready_ns = time.monotonic_ns() + round(READY * 1e9)
    while exchange(time.monotonic_ns()) is None:  # until all processes have found each other
        if time.monotonic_ns() > ready_ns:
            raise RunError("a process of the contestant is missing")
    next_ns = time.monotonic_ns() + period_ns
    for index in range(-WARMUP, exchanges):
        if index == 0:
            times_ns, missed = [], 0
            processor_ns, began_ns = time.process_time_ns(), time.monotonic_ns()
        realtime.wait_until(next_ns, spin_ns)
        took_ns = exchange(next_ns)
        if took_ns is not None:
            times_ns.append(took_ns)
        missed += took_ns is None or took_ns > period_ns
        next_ns += period_ns * max(1, 1 + (time.monotonic_ns() - next_ns) // period_ns)
    used_ns, now_ns = time.process_time_ns() - processor_ns, time.monotonic_ns()
    return Round(times_ns, missed, used_ns, now_ns - began_ns)


@contextmanager
def serving(function: Callable[..., object], *arguments: object) -> Iterator[None]:
    """Run a function in a process of its own during the body; it ends with this one in any case."""
    process = get_context("spawn").Process(target=_serve, args=(function, *arguments), daemon=True)
    process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()


def _serve(function: Callable[..., object], *arguments: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    realtime.die_with_parent(signal.SIGKILL)
    function(*arguments)


def apart(function: Callable[..., Any], *arguments: Any) -> Round:
    """Return the round that a function runs in a process of its own; the last argument times it.

    Raises:
        RunError: If it failed, or did not end in time.
    """
    period_ns, exchanges = arguments[-1]
    most = 2 * READY + 4 * (WARMUP + exchanges) * period_ns * 1e-9
    receiver, sender = get_context("spawn").Pipe(duplex=False)
    with serving(_answer, sender, function, *arguments):
        sender.close()
        with suppress(EOFError):
            if receiver.poll(most):
                found: Round = receiver.recv()
                return found
    raise RunError(f"{function.__name__} failed in its process, or did not end within {most:.0f} s")


def _answer(sender: Any, function: Callable[..., Any], *arguments: object) -> None:
    sender.send(function(*arguments))
    os._exit(0)  # without waiting for sockets that it has left open


def loop(function: Callable[..., Any], settings: Settings | None, timing: Timing) -> Round:
    """Run a round of :func:`graph` or :func:`bare`, with a process for each node."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="forcebound-")))
        *others, device = ONE_HAND.loop
        for role in others:
            stack.enter_context(serving(function, role, folder, settings, timing))
        return apart(function, device, folder, settings, timing)


def wake_ups(settings: Settings, timing: Timing) -> Round:
    """Measure how late a servo wakes up that does nothing."""
    realtime.enter(settings, DEVICE)
    realtime.freeze_garbage()
    return pace(lambda due_ns: time.monotonic_ns() - due_ns, settings, timing)


class _Probe(Node):
    """A device that waits for its answer: the real one does not know when that has come."""

    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = None
    sent_ns, seq = 0, -1

    def __init__(self) -> None:
        self.events = EventLog(DEVICE)
        self.took_ns: int | None = None

    def step(self, time_ns: int, received: Sequence[packets.Packet]) -> list[packets.Packet]:
        """Take the answer, or send the state that is due; see :class:`forcebound.nodes.Node`."""
        for packet in received:
            if type(packet) is packets.ForceCommand and packet.device_seq == self.seq:
                self.took_ns = time.monotonic_ns() - self.sent_ns
        if self.wake_ns is None:
            return []
        self.sent_ns, self.wake_ns, self.took_ns = time_ns, None, None
        self.seq += 1
        return [structs.replace(_STATE, seq=self.seq, time_ns=time_ns)]


def graph(role: str, folder: Path, settings: Settings, timing: Timing) -> Round | None:
    """Run one process of the loop: a node of ``LAUNCH_FILE`` in the live runner, or the probe."""
    config, stop = load(LAUNCH_FILE), Stop()
    if role != DEVICE:
        run(build_node(role, config), role, folder, build_links(config), settings, stop)
        return None
    realtime.enter(settings, role)
    node = _Probe()
    runner = Runner(node, role, folder, build_links(config), Network(), settings.spin_ns)
    realtime.freeze_garbage()

    def exchange(_: int) -> int | None:
        node.wake_ns = time.monotonic_ns()
        give_up_ns = node.wake_ns + TIMEOUT_NS
        runner.turn(node.wake_ns)
        while node.took_ns is None and time.monotonic_ns() < give_up_ns:
            runner.wait(stop.descriptor)
        return node.took_ns

    return pace(exchange, settings, timing)


def bare(role: str, folder: Path, settings: Settings | None, timing: Timing) -> Round:
    """Run one process of the loop in bare pyzmq: the graph's sockets and bytes, nothing decoded.

    The controller waits for its two streams in turns, which a real one cannot; no faster way to use
    these sockets is known. Without settings, placement and scheduling are the kernel's. The last
    bytes of a frame are the number of its tick, so that a late answer is not taken for the next.
    """
    if settings is not None:
        realtime.enter(settings, role)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()

    def sender(packet: packets.Packet) -> Callable[[bytes], object]:
        head = encode(packet)[: -_TICK.size]
        send = Publisher(make_socket(context, zmq.PUB, _endpoint(folder, packet), bind=True)).send
        return lambda tick: send(head + tick)

    def receiver(packet: packets.Packet) -> Callable[[], bytes]:
        socket = make_socket(context, zmq.SUB, _endpoint(folder, packet), bind=False)
        socket.rcvtimeo = TIMEOUT_NS // 1_000_000
        receive = partial(_CompiledSocket.recv, socket)  # as the graph's subscribers do
        return lambda: receive()[-_TICK.size :]

    sends, hears = {
        DEVICE: ((_STATE,), (_COMMAND,)),
        CONTROLLER: ((_QUERY, _COMMAND), (_STATE, _REPLY)),
        ENVIRONMENT: ((_REPLY,), (_QUERY,)),
    }[role]
    send, receive = [sender(one) for one in sends], [receiver(one) for one in hears]
    realtime.freeze_garbage()
    if role == DEVICE:
        return pace(_round_trip(send[0], receive[0]), settings, timing)
    while True:
        with suppress(zmq.Again):
            send[0](tick := receive[0]())
            if role == CONTROLLER:
                while receive[1]() != tick:
                    pass  # of a tick that was given up
                send[1](tick)


def _endpoint(folder: Path, packet: packets.Packet) -> str:
    return endpoint(folder, ONE_HAND.named(packets.TOPIC_OF[type(packet)])[0])


def _round_trip(send: Callable[[bytes], object], receive: Callable[[], bytes]) -> Exchange:
    numbers = count()

    def exchange(_: int) -> int | None:
        tick, sent_ns = _TICK.pack(next(numbers)), time.monotonic_ns()
        send(tick)
        with suppress(zmq.Again):
            while receive() != tick:
                pass
            return time.monotonic_ns() - sent_ns
        return None

    return exchange
