"""Contestant of the delay benchmark: one link of the real graph, a sender and a receiver.

Both are nodes in the live runner (:mod:`forcebound.process`), placed and scheduled as controller
and environment of a launch file. The receiver's link is impaired, or perfect as most links are; the
time of a packet is the one from its ``time_ns``, taken before it is encoded, until the node is
stepped with it, less the delay that the link drew for it.

::

    python -m forcebound.benchmark.link_delay ROLE FOLDER LAUNCH_FILE LINK PERIOD_NS COUNT
"""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from forcebound.benchmark.graph_loop import settings_of
from forcebound.benchmark.workers import WARMUP, Stopwatch, enter_contestant
from forcebound.config.loader import load
from forcebound.messages.packets import EnvironmentQuery, Packet
from forcebound.network.chances import Chances, Draws
from forcebound.network.impairment import Impairment
from forcebound.network.link import PACKET_SIZE, Link
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.nodes.events import EventLog
from forcebound.process import Runner, Stop, run
from forcebound.realtime import enter, freeze_garbage

TOPIC = "environment_query"

LINKS = {
    "own": Impairment(),
    "1_ms": Impairment(0.001),
    "5_ms": Impairment(0.005),
    "20_ms": Impairment(0.020),
    "5_ms_uniform": Impairment(0.005, 0.002),
    "20_ms_normal": Impairment(0.020, 0.004, distribution="normal"),
}

_SEED = 1


class SenderNode(Node):
    """Publishes a query each period."""

    subscribes: ClassVar[tuple[type[Packet], ...]] = ()
    publishes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentQuery,)
    wakes_on_arrival: ClassVar[bool] = False
    wake_ns: int | None = None  # an attribute in place of the property

    def __init__(self, period_ns: int, begin_ns: int) -> None:
        self.events = EventLog("controller")
        self.wake_ns = begin_ns
        self._period_ns = period_ns
        self._seq = 0

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Send what is due; see :class:`forcebound.nodes.Node`."""
        assert self.wake_ns is not None
        late = max(0, time_ns - self.wake_ns) // self._period_ns
        self.wake_ns += (late + 1) * self._period_ns
        query = EnvironmentQuery(
            seq=self._seq,
            time_ns=time_ns,
            device_seq=self._seq,
            device_time_ns=time_ns,
            elapsed=1.5,
            position=(0.012,),
            velocity=(0.1,),
            environment=None,
        )
        self._seq += 1
        return [query]


class WatchedLink(Link[Packet]):
    """A link that records the delay added to each packet.

    Attributes:
        added_ns: By ``seq``, in ns, for packets not yet taken.
    """

    def __init__(self, impairment: Impairment) -> None:
        super().__init__(impairment, _SEED)
        self.added_ns: dict[int, int] = {}
        self._twin = Chances(impairment, Draws(_SEED))  # draws what the link draws

    def accept(self, time_ns: int, packet: Packet, size: int = PACKET_SIZE) -> None:
        """Take a packet that arrives; see :meth:`forcebound.network.link.Link.accept`."""
        super().accept(time_ns, packet, size)
        self.added_ns[packet.seq] = self._twin.travel_ns()


class ReceiverNode(Node):
    """Records the arrival of packets; requests a stop when it has enough.

    Attributes:
        times_ns: From sending to the node, less what the link added, in ns.
        missed: Packets replaced by a newer one before they were read, except by jitter.
    """

    subscribes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentQuery,)
    publishes: ClassVar[tuple[type[Packet], ...]] = ()
    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = None

    def __init__(self, stop: Stop, link: WatchedLink | None, count: int) -> None:
        self.events = EventLog("environment")
        self.times_ns: list[int] = []
        self.missed = 0
        self._watch = Stopwatch()
        self._left = WARMUP + count
        self._count = count
        self._stop = stop
        self._link = link
        self._last = -1

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Take packets; see :class:`forcebound.nodes.Node`."""
        now_ns = time.monotonic_ns()
        for packet in received:
            if self._left == 0:
                break
            added_ns = 0 if self._link is None else self._link.added_ns.pop(packet.seq)
            self._left -= 1
            if self._left == self._count:
                self._watch, self._last = Stopwatch(), packet.seq
            elif self._left < self._count:
                self._count_missed(packet.seq)
                self.times_ns.append(now_ns - packet.time_ns - added_ns)
            if self._left == 0:
                self._stop.request()
        return []

    def finish(self) -> None:
        """Write the times for the benchmark."""
        self._watch.write_times(self.times_ns, self.missed)

    def _count_missed(self, seq: int) -> None:
        if self._link is None:
            self.missed += seq - self._last - 1
            self._last = seq


def main(role: str, folder: Path, launch_file: str, link: str, timing: tuple[int, int]) -> None:
    """Run one of the two processes; only the receiver (``environment``) ends by itself.

    Args:
        role: ``"controller"`` sends, ``"environment"`` receives.
        folder: Of the sockets.
        launch_file: Source of the real-time settings.
        link: A key of :data:`LINKS`.
        timing: Period in ns, and number of packets that count.
    """
    enter_contestant()
    settings = settings_of(load(launch_file))
    period_ns, count = timing
    stop = Stop()
    if role == "controller":
        begin_ns = time.monotonic_ns() + period_ns
        run(SenderNode(period_ns, begin_ns), role, folder, {}, settings, stop)
        return
    enter(settings, role)
    impairment = LINKS[link]
    model = None if impairment == Impairment() else WatchedLink(impairment)
    node = ReceiverNode(stop, model, count)
    links = {} if model is None else {TOPIC: model}
    runner = Runner(node, role, folder, links, Network(), settings.spin_ns)
    freeze_garbage()
    runner.run(stop)
    node.finish()
    os._exit(0)  # without waiting for the sockets


if __name__ == "__main__":
    _role, _folder, _launch_file, _link, _period_ns, _count = sys.argv[1:]
    main(_role, Path(_folder), _launch_file, _link, (int(_period_ns), int(_count)))
