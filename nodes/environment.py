"""The environment node: serves one virtual environment, and takes the time that it takes.

While an answer is computed nothing else is answered, as in a real computation: throughput falls. A
query that comes meanwhile waits, and only the newest waits. The injected ``compute_delay`` comes
on top of what the environment's own code needs.
"""

import logging
from collections.abc import Sequence
from typing import ClassVar

from forcebound.environments import Environment
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply, Packet, Vector

_logger = logging.getLogger(__name__)


class EnvironmentNode:
    """Answers the newest query, one at a time, each after ``compute_delay``."""

    subscribes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentQuery,)
    publishes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentReply,)
    wakes_on_arrival: ClassVar[bool] = True

    def __init__(self, environment: Environment, compute_delay_ns: int = 0) -> None:
        self._environment = environment
        self._compute_delay_ns = compute_delay_ns
        self._answering: tuple[EnvironmentQuery, Vector] | None = None
        self._waiting: EnvironmentQuery | None = None
        self._done_ns = 0
        self._seq = 0
        self.faults = 0  # queries that the environment's code failed to answer

    @property
    def wake_ns(self) -> int | None:
        """When the answer in work is ready, in ns; None while there is none."""
        return None if self._answering is None else self._done_ns

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Take queries, give finished answers; see :class:`forcebound.nodes.Node`."""
        for packet in received:
            if type(packet) is EnvironmentQuery:
                self._waiting = packet
        replies: list[Packet] = []
        if self._answering is not None and time_ns >= self._done_ns:
            replies.append(self._reply(*self._answering, time_ns))
            self._answering = None
        if self._answering is None and self._waiting is not None:
            query, self._waiting = self._waiting, None
            force = self._force(query)
            if force is None:
                return replies
            if self._compute_delay_ns == 0:
                replies.append(self._reply(query, force, time_ns))
            else:
                self._answering = (query, force)
                self._done_ns = time_ns + self._compute_delay_ns
        return replies

    def _force(self, query: EnvironmentQuery) -> Vector | None:
        # Whatever a user's environment does wrong must end in silence, which the device answers
        # with zero force, and not in a dead node.
        try:
            answer = self._environment.force(query.position, query.velocity, query.elapsed)
            force = tuple([float(f) for f in answer])
            if len(force) != len(query.position):
                raise ValueError(f"expected {len(query.position)} entries, got {len(force)}")
            return force
        except Exception:
            self.faults += 1
            if self.faults == 1:
                _logger.exception("the environment failed to answer; counting, not answering")
            return None

    def _reply(self, query: EnvironmentQuery, force: Vector, time_ns: int) -> EnvironmentReply:
        seq = self._seq
        self._seq += 1
        return EnvironmentReply(
            seq, time_ns, query.device_seq, query.device_time_ns, query.seq, query.time_ns, force
        )
