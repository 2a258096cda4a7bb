"""Reference of the four-hop loop: the graph's sockets and bytes in bare pyzmq.

One process per role. ``device`` sends a state on an absolute schedule and waits for the answer;
``controller`` forwards it as a query, waits for the reply and forwards that as a command;
``environment`` answers. Frames are real packets as opaque bytes, encoded once; the last eight bytes
are overwritten with the number of the tick, so that a late answer is never mistaken for the next.
Nothing is decoded.

The sockets are those of the graph (:func:`forcebound.network.sockets.make_socket`): the same kinds
and options, so no CONFLATE, and the same compiled calls to send and receive. The controller waits
for the two streams alternately, which a real one cannot, and there are no control sockets: no
faster way to use these sockets is known.

With CORE -1 placement and scheduling are the kernel's. Otherwise they are set by the function that
sets them for the real nodes (:func:`forcebound.realtime.enter`).
"""

import os
import struct
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import zmq
from zmq.backend import Socket as _CompiledSocket

from forcebound.benchmark.paced import pace
from forcebound.benchmark.workers import READY, TIMEOUT_NS, enter_contestant
from forcebound.messages.codec import encode
from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
)
from forcebound.network.sockets import Publisher, make_socket
from forcebound.realtime import Settings, enter, freeze_garbage

Send: TypeAlias = Callable[[bytes], object]
Receive: TypeAlias = Callable[[], bytes]

_TICK = struct.Struct("<q")
_SPIN_NS = Settings().spin_ns
_NOW, _BIG = 2**60 + 1, 10**6  # as long on the wire as a real stamp and sequence number
PACKETS: tuple[Packet, ...] = (
    DeviceState(_BIG, _NOW, 1.5, (0.012,), (0.1,), (1.5,)),
    EnvironmentQuery(_BIG, _NOW, _BIG, _NOW, 1.5, (0.012,), (0.1,), "e"),
    EnvironmentReply(_BIG, _NOW, _BIG, _NOW, _BIG, _NOW, (1.5,), "e"),
    ForceCommand(_BIG, _NOW, _BIG, _NOW, (1.5,)),
)


def _sender(context: "zmq.Context[zmq.Socket[bytes]]", folder: str, kind: type[Packet]) -> Send:
    packet = next(packet for packet in PACKETS if type(packet) is kind)
    head = encode(packet)[: -_TICK.size]
    endpoint = f"ipc://{folder}/{TOPIC_OF[kind]}"
    send = Publisher(make_socket(context, zmq.PUB, endpoint, bind=True)).send
    return lambda tick: send(head + tick)


def _receiver(
    context: "zmq.Context[zmq.Socket[bytes]]", folder: str, kind: type[Packet]
) -> Receive:
    socket = make_socket(context, zmq.SUB, f"ipc://{folder}/{TOPIC_OF[kind]}", bind=False)
    socket.rcvtimeo = TIMEOUT_NS // 1_000_000
    receive = partial(_CompiledSocket.recv, socket)
    return lambda: receive()[-_TICK.size :]


def _serve_environment(queries: Receive, reply: Send) -> None:
    while True:
        try:
            reply(queries())
        except zmq.Again:
            continue


def _serve_controller(states: Receive, query: Send, replies: Receive, command: Send) -> None:
    while True:
        try:
            query(tick := states())
            while (reply := replies()) != tick:
                pass  # of a tick that was given up
            command(reply)
        except zmq.Again:
            continue


def _answer(tick: bytes, commands: Receive) -> int | None:
    """Wait for the answer to ``tick``; return when it came, in ns, or None if it did not."""
    try:
        while commands() != tick:
            pass
    except zmq.Again:
        return None
    return time.monotonic_ns()


def _drive(states: Send, commands: Receive, period_ns: int, count: int) -> None:
    """Measure ``count`` round trips, one a period, and write them to standard output."""
    deadline = time.monotonic() + READY
    number = 0
    while True:  # until the loop is closed: subscriptions take a moment
        tick = _TICK.pack(number)
        states(tick)
        if _answer(tick, commands) is not None:
            break
        if time.monotonic() > deadline:
            sys.exit("the bare loop did not close: one of its processes is missing")
        number += 1

    def exchange() -> int | None:
        nonlocal number
        number += 1
        tick = _TICK.pack(number)
        sent_ns = time.monotonic_ns()
        states(tick)
        arrived_ns = _answer(tick, commands)
        return None if arrived_ns is None else arrived_ns - sent_ns

    pace(exchange, _SPIN_NS, period_ns, count)


def main(role: str, folder: str, core: int, policy: str, period_ns: int, count: int) -> None:
    """Run one of the three processes; only the device ends by itself."""
    enter_contestant()
    if core >= 0:
        enter(Settings(policy=policy, core=core), role)
    context = zmq.Context()
    freeze_garbage()
    if role == "device":
        _drive(
            _sender(context, folder, DeviceState),
            _receiver(context, folder, ForceCommand),
            period_ns,
            count,
        )
        os._exit(0)  # the context's threads have nothing left to send
    elif role == "controller":
        _serve_controller(
            _receiver(context, folder, DeviceState),
            _sender(context, folder, EnvironmentQuery),
            _receiver(context, folder, EnvironmentReply),
            _sender(context, folder, ForceCommand),
        )
    else:
        _serve_environment(
            _receiver(context, folder, EnvironmentQuery),
            _sender(context, folder, EnvironmentReply),
        )


if __name__ == "__main__":
    _role, _folder, _core, _policy, _period_ns, _count = sys.argv[1:]
    main(_role, _folder, int(_core), _policy, int(_period_ns), int(_count))
