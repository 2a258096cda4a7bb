"""Nodes: functions of time and packets that decide what each process does.

A node owns no clock, socket, thread or file. A runner (:mod:`forcebound.run.process` live,
:mod:`forcebound.run.simulation` in virtual time) calls :meth:`Node.step` with the time and the
packets that have arrived, publishes what it returns, and calls again when packets arrive or when
:attr:`Node.wake_ns` has come. A node does not know which of the two runs it; which packets it
receives, and who receives its packets, says :mod:`forcebound.messages.topology`.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.control import Answer, NodeStatus, Refused, Request
from forcebound.messages.events import EventLog
from forcebound.messages.packets import Event, Packet

if __name__ != "forcebound.nodes":
    raise ImportError(f"import forcebound.nodes, not {__name__}")

_logger = logging.getLogger(__name__)


class Node(Protocol):
    """A node, as its runner sees it.

    A node that derives from this class has the methods that most nodes do not need.
    """

    wakes_on_arrival: ClassVar[bool]  # False: packets wait for the node's time
    requests: ClassVar[tuple[type[Request], ...]] = ()  # that its :meth:`handle` takes
    events: EventLog  # of its process: the runner makes events with it, too
    rejected: Mapping[str, int] = MappingProxyType({})  # packets so far, by reason

    @property
    def wake_ns(self) -> int | None:
        """When the next step is due even if nothing arrives, in ns; None: only on arrival."""
        ...

    @property
    def needs_packets(self) -> bool:
        """True if the next step uses what has arrived; else it may wait for a later step."""
        return True

    @property
    def awaits_requests(self) -> bool:
        """True if a request is to be looked for after this step, not only every 10 ms."""
        return False

    def step(self, time_ns: int, received: Sequence[Packet]) -> Sequence[Packet]:
        """Advance to ``time_ns`` with what has arrived since the last step; return what to send.

        Never raises for anything that a peer sent.
        """
        ...

    def admit(self, packet: Packet, source: str, time_ns: int) -> bool:
        """Return whether a packet that has just arrived at ``time_ns`` may enter its link.

        Asked in a live run only, where others can send; a packet that is not admitted is counted.
        ``source`` is the public key or connection of a peer, empty on this machine.
        """
        return True

    def reject(self, reason: str) -> None:
        """Count a packet that was rejected before it reached the node, or by it."""
        self.rejected = {**self.rejected, reason: self.rejected.get(reason, 0) + 1}

    def status(self) -> NodeStatus:
        """Return how the node is doing; its runner adds what it counts."""
        return NodeStatus(rejected=dict(self.rejected))

    def handle(self, request: Any) -> Answer:
        """Execute a request of one of the classes in :attr:`requests`, and return the answer."""
        return Refused(f"this node takes no such request: {request}")

    def stop(self, time_ns: int) -> None:
        """Come to rest, now and for good: a device writes zero force."""
        return

    def last_events(self, time_ns: int) -> Sequence[Event]:
        """Return what the node reports of the run at its end."""
        return ()

    def close(self) -> None:
        """Close all that the node has opened; called exactly once."""
        return


def close_part(close: Callable[[], None], name: str) -> None:
    """Close a part; a failure of its code is logged, with ``name``, and does not end the node."""
    try:
        close()
    except Exception as error:
        _logger.warning("the %s failed to close: %s", name, describe_user_error(error))
