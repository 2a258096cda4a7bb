"""The error of injected delays, beyond the link's own latency.

One process sends a packet each period, as a controller does; another receives it in the live runner
through an impaired link, as an environment does. A packet's time runs from before it is encoded
until the node is stepped with it, less the delay that the link drew for it; what is beyond the
median of a perfect link is the error. Of packets that jitter reorders only the newest arrive.
"""

import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import ClassVar

from benchmarks.harness import Result, alternate, beyond, chain
from forcebound.messages.events import EventLog
from forcebound.messages.packets import EnvironmentQuery, Packet
from forcebound.network.chances import Chances, Draws
from forcebound.network.impairment import Impairment
from forcebound.network.link import PACKET_SIZE, Link
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.observe.measure import WARMUP, Round, Timing, apart, serving
from forcebound.realtime import Settings, enter, freeze_garbage
from forcebound.run.process.runner import Runner
from forcebound.run.process.runner import run as run_node
from forcebound.stop import Stop

DURATION = 18.0
ASKED = "error of an injected delay of 5 ms"
SHOWN = "5 ms"  # on the page
LINKS = {
    "perfect link": Impairment(),
    "1 ms": Impairment(0.001),
    "5 ms": Impairment(0.005),
    "20 ms": Impairment(0.020),
    "5 ms ± 2 ms uniform": Impairment(0.005, 0.002),
    "20 ms ± 4 ms normal": Impairment(0.020, 0.004, distribution="normal"),
}
SEED = 1


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    contestants = {name: partial(_round, link) for name, link in LINKS.items()}
    own, *impaired = found = alternate(duration, rate, contestants)
    targets = {"p50": 100.0, "p99": 500.0}
    return found, [
        beyond(one, own, share, target, f"({share})" if one.label == SHOWN else "")
        for one in impaired
        for share, target in targets.items()
    ]


def _round(link: Impairment, timing: Timing) -> Round:
    settings = chain()
    with tempfile.TemporaryDirectory(prefix="forcebound-") as name, ExitStack() as stack:
        folder = Path(name)
        stack.enter_context(serving(send, folder, settings, timing[0]))
        return apart(receive, link, folder, settings, timing)


class SenderNode(Node):
    """Publishes a query each period."""

    wakes_on_arrival: ClassVar[bool] = False
    wake_ns: int | None = None  # an attribute in place of the property

    def __init__(self, period_ns: int) -> None:
        self.events = EventLog("controller")
        self.wake_ns = time.monotonic_ns() + period_ns
        self._period_ns = period_ns
        self._seq = -1

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Send what is due; see :class:`forcebound.nodes.Node`."""
        assert self.wake_ns is not None
        late = max(0, time_ns - self.wake_ns) // self._period_ns
        self.wake_ns += (late + 1) * self._period_ns
        seq = self._seq = self._seq + 1
        return [EnvironmentQuery(seq, time_ns, seq, time_ns, 1.5, (0.012,), (0.1,), None)]


class WatchedLink(Link[Packet]):
    """A link that keeps the delay added to each packet, in ns, by ``seq``."""

    def __init__(self, impairment: Impairment) -> None:
        super().__init__(impairment, SEED)
        self.added_ns: dict[int, int] = {}
        self._twin = Chances(impairment, Draws(SEED))  # draws what the link draws

    def accept(self, time_ns: int, packet: Packet, size: int = PACKET_SIZE) -> None:
        """Take a packet that arrives; see :meth:`forcebound.network.link.Link.accept`."""
        super().accept(time_ns, packet, size)
        self.added_ns[packet.seq] = self._twin.travel_ns() or 0


class ReceiverNode(Node):
    """Records the times of packets, in ns, until it has enough."""

    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = None

    def __init__(self, stop: Stop, link: WatchedLink | None, count: int) -> None:
        self.events = EventLog("environment")
        self.times_ns: list[int] = []
        self._stop, self._link, self._count = stop, link, count

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Take packets; see :class:`forcebound.nodes.Node`."""
        now_ns = time.monotonic_ns()
        for packet in received:
            added_ns = 0 if self._link is None else self._link.added_ns.pop(packet.seq)
            self.times_ns.append(now_ns - packet.time_ns - added_ns)
        if len(self.times_ns) >= self._count:
            self._stop.request()
        return []


def send(folder: Path, settings: Settings, period_ns: int) -> None:
    """Send packets until killed."""
    run_node(SenderNode(period_ns), "controller", folder, {}, settings, Stop())


def receive(impairment: Impairment, folder: Path, settings: Settings, timing: Timing) -> Round:
    """Return the times of packets through a link."""
    enter(settings, "environment")
    stop = Stop()
    link = None if impairment == Impairment() else WatchedLink(impairment)
    links: dict[str, Link[Packet]] = {} if link is None else {"environment_query": link}
    node = ReceiverNode(stop, link, WARMUP + timing[1])
    runner = Runner(node, "environment", folder, links, Network(), settings.spin_ns)
    freeze_garbage()
    runner.run(stop)
    return Round(node.times_ns[WARMUP:])
