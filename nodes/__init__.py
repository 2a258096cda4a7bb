"""What each process decides: a node is a function of time and packets.

A node owns no clock, socket, thread or file. A runner (:mod:`forcebound.process` live,
:mod:`forcebound.simulation` in virtual time) calls :meth:`Node.step` with the time and the packets
that have arrived, publishes what it returns, and calls again when packets arrive or when
:attr:`Node.wake_ns` has come. A node cannot tell which of the two runs it.
"""

from collections.abc import Sequence
from typing import ClassVar, Protocol

from forcebound.messages.packets import Packet
from forcebound.nodes.events import EventLog

if __name__ != "forcebound.nodes":
    raise ImportError(f"import forcebound.nodes, not {__name__}")


class Node(Protocol):
    """What a runner asks of a node."""

    subscribes: ClassVar[tuple[type[Packet], ...]]
    publishes: ClassVar[tuple[type[Packet], ...]]
    wakes_on_arrival: ClassVar[bool]  # False: what arrives waits for the node's own time
    events: EventLog  # of its process: the runner tells by it, too

    @property
    def wake_ns(self) -> int | None:
        """When it wants to be stepped even if nothing arrives, in ns; None: only on arrival."""
        ...

    def step(self, time_ns: int, received: Sequence[Packet]) -> Sequence[Packet]:
        """Advance to ``time_ns`` with what has arrived since the last step; return what to send.

        Never raises for anything that a peer sent.
        """
        ...

    def close(self) -> None:
        """Close what the node has opened; called once, whatever came before."""
        ...
