"""The four-hop loop of the real graph, with a device that waits for the answer.

``controller`` and ``environment`` are the nodes of a launch file in the live runner, placed and
scheduled by the launch file's settings. The real device takes an answer at its next write and does
not know its arrival; so ``device`` is a probe here, in the same runner with the same codec and
sockets: it publishes a state on an absolute schedule, sleeps until the answer comes, and takes the
time when the decoded packet reaches the node. The round trip counts from the state's ``time_ns``.

::

    python -m forcebound.benchmark.graph_loop ROLE FOLDER LAUNCH_FILE PERIOD_NS COUNT
"""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from forcebound.benchmark.workers import READY, TIMEOUT_NS, WARMUP, Stopwatch, enter_contestant
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.launch.build import build_node
from forcebound.launch.links import build_links
from forcebound.messages.packets import DeviceState, ForceCommand, Packet
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.nodes.events import EventLog
from forcebound.process import Runner, Stop, run
from forcebound.realtime import (
    Settings,
    choose_core,
    enter,
    freeze_garbage,
    wait_until,
)


class ProbeNode(Node):
    """Publishes a state when it is due and notes when the answer to it comes."""

    subscribes: ClassVar[tuple[type[Packet], ...]] = (ForceCommand,)
    publishes: ClassVar[tuple[type[Packet], ...]] = (DeviceState,)
    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = 0  # of the next state, in ns

    def __init__(self) -> None:
        self.events = EventLog("device")
        self.round_trip_ns: int | None = None  # of the last state; None while there is no answer
        self._seq = -1
        self._sent_ns = 0

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Take the answer, or send the state that is due; see :class:`forcebound.nodes.Node`."""
        for packet in received:
            if type(packet) is ForceCommand and packet.device_seq == self._seq:
                self.round_trip_ns = time.monotonic_ns() - self._sent_ns
                self.wake_ns = None
        if self.wake_ns is None or time_ns < self.wake_ns:
            return []
        self._seq += 1
        self._sent_ns = time_ns
        self.round_trip_ns = None
        self.wake_ns = None
        return [DeviceState(self._seq, time_ns, 1.5, (0.012,), (0.1,), (1.5,))]


def drive(
    runner: Runner, node: ProbeNode, stop: Stop, spin_ns: int, timing: tuple[int, int]
) -> None:
    """Measure round trips and write them to standard output.

    Args:
        runner: Of ``node``.
        node: The probe.
        stop: Never requested; its descriptor is part of the runner's wait.
        spin_ns: Of the wait for the next tick, in ns.
        timing: Period in ns, and number of ticks that count.
    """
    period_ns, count = timing
    times_ns: list[int] = []
    missed, watch = 0, Stopwatch()
    index = -WARMUP
    next_ns = time.monotonic_ns()
    ready_ns = next_ns + round(READY * 1e9)
    is_closed = False  # subscriptions take a moment
    while index < count:
        if index == 0:
            times_ns.clear()
            missed, watch = 0, Stopwatch()
        next_ns += period_ns
        node.wake_ns = next_ns
        runner.turn(wait_until(next_ns, spin_ns))
        give_up_ns = next_ns + TIMEOUT_NS
        while node.round_trip_ns is None and (now := time.monotonic_ns()) < give_up_ns:
            runner.wait(stop.descriptor)
        round_trip_ns = node.round_trip_ns
        is_closed = is_closed or round_trip_ns is not None
        if not is_closed and now > ready_ns:
            sys.exit("the loop of the graph did not close: one of its processes is missing")
        if round_trip_ns is not None:
            times_ns.append(round_trip_ns)
        if round_trip_ns is None or round_trip_ns > period_ns:
            missed += 1
        next_ns += period_ns * max(0, (time.monotonic_ns() - next_ns) // period_ns)
        index += is_closed
    watch.write_times(times_ns, missed)


def settings_of(config: GraphConfig) -> Settings:
    """Return the real-time settings of the nodes of ``config``."""
    settings = config.realtime
    return Settings(
        policy=settings.policy,
        core=choose_core(settings.cores),
        lock_memory=settings.lock_memory,
        deep_sleep=settings.deep_sleep,
        spin_ns=round(settings.spin * 1e9),
    )


def main(role: str, folder: Path, launch_file: str, period_ns: int, count: int) -> None:
    """Run one of the three processes; only the device ends by itself."""
    enter_contestant()
    config = load(launch_file)
    settings = settings_of(config)
    stop = Stop()
    if role != "device":
        run(build_node(role, config), role, folder, build_links(config), settings, stop)
        return
    enter(settings, role)
    node = ProbeNode()
    runner = Runner(node, role, folder, build_links(config), Network(), settings.spin_ns)
    freeze_garbage()
    drive(runner, node, stop, settings.spin_ns, (period_ns, count))
    os._exit(0)  # without waiting for the sockets


if __name__ == "__main__":
    _role, _folder, _launch_file, _period_ns, _count = sys.argv[1:]
    main(_role, Path(_folder), _launch_file, int(_period_ns), int(_count))
