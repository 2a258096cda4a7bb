"""The lease of environments: one environment serves a graph at a time.

The first one that answers gets the lease: every query names it, and answers of others are rejected.
The lease ends when its holder has been silent for longer than ``lease_ns`` or, if its process is
known to have ended, for longer than ``dead_lease_ns``. Both are longer than the age limit of a
force, so the force is zero between two environments and returns over the engage ramp.

Every query carries the name of the holder, so a name proves nothing. In a live run the lease is
bound to the *source* of the answers: the key of a peer, without keys its connection. A reply is
looked at when it arrives (:meth:`Lease.admit`), before an impaired link orders the packets: an
answer of another one must not displace that of the holder there.
"""

from forcebound.messages.events import EventKind, EventLog
from forcebound.messages.packets import MAX_COUNT, Event, Packet

LEASE_NS = 1_000_000_000  # by default; twice the age limit where that is more
REJECTED_INTERVAL_NS = 1_000_000_000  # between two events about rejected environments


class Lease:
    """Which environment serves: ``holder``; None: the first that answers will.

    ``lease_ns`` is the silence after which another one may serve, ``dead_lease_ns`` the same if the
    process of the holder is known to be gone; None: no shorter.
    """

    def __init__(self, events: EventLog, lease_ns: int, dead_lease_ns: int | None) -> None:
        self._events = events
        self._lease_ns = lease_ns
        self._dead_lease_ns = lease_ns if dead_lease_ns is None else dead_lease_ns
        self._is_dead = False  # whether the holder has ended
        self.heard_ns = 0  # last answer of the holder; set by the node that receives it
        self._emitted_ns: int | None = None
        self.holder: str | None = None
        self.due_ns = MAX_COUNT  # after that, :meth:`check` has something to do
        self._claim: tuple[str, str] | None = None  # name and source whose replies are admitted
        self._claimed_ns = 0  # when the last of these arrived
        self._to_emit: list[Packet] = []

    def check(self, time_ns: int) -> list[Packet]:
        """End the lease of a holder that has been silent for too long; return what happened."""
        events, self._to_emit = self._to_emit, []
        lease_ns = self._dead_lease_ns if self._is_dead else self._lease_ns
        self.due_ns = MAX_COUNT if self.holder is None else self.heard_ns + lease_ns
        if self.holder is None or time_ns <= self.due_ns:
            return events
        environment, self.holder, self.due_ns = self.holder, None, MAX_COUNT
        self._claim = None
        silence = (time_ns - self.heard_ns) * 1e-9
        how = "is gone" if self._is_dead else f"has been silent for {silence:.1f} s"
        self._is_dead = False
        message = f"environment {environment} {how}; the next one to answer will serve"
        events.append(self._event(time_ns, "environment_lost", message, environment, is_fault=True))
        return events

    def admit(self, environment: str, source: str, time_ns: int) -> bool:
        """Return whether a reply that arrives is of the one environment that may answer now.

        While the lease is free, that is the first to answer until it has been silent for a lease.
        """
        claim = (environment, source)
        if self._claim is None:
            is_free = self.holder in (None, environment)
        else:
            is_free = self.holder is None and time_ns - self._claimed_ns > self._lease_ns
        if is_free:
            self._claim = claim
        if claim != self._claim:
            serving = self._claim[0] if self._claim is not None else str(self.holder)
            self._to_emit += self._reject(environment, serving, time_ns)
            self.due_ns = 0
            return False
        self._claimed_ns = time_ns
        return True

    def is_of(self, source: str) -> bool:
        """Return whether the one environment that may answer now is at a source."""
        return self._claim is not None and self._claim[1] == source

    def request(self, environment: str, time_ns: int) -> list[Packet]:
        """Give a free lease to an environment that does not hold it; return what happened."""
        if self.holder is not None:
            return self._reject(environment, self.holder, time_ns)
        self.holder = environment
        self.heard_ns = time_ns
        self.due_ns = 0
        message = f"environment {environment} serves now"
        return [self._event(time_ns, "environment_serves", message, environment)]

    def process_ended(self, process: str) -> None:
        """Shorten the lease of an environment whose process has ended.

        Args:
            process: Beginning of its name, as far as the launcher knows it.
        """
        if self.holder is not None:
            self._is_dead = self._is_dead or self.holder.startswith(process)
            self.due_ns = 0
        elif self._claim is not None and self._claim[0].startswith(process):
            self._claim = None

    def _reject(self, environment: str, serving: str, time_ns: int) -> list[Packet]:
        if self._emitted_ns is not None and time_ns - self._emitted_ns < REJECTED_INTERVAL_NS:
            return []
        self._emitted_ns = time_ns
        message = f"rejected environment {environment}: {serving} serves this graph"
        if environment == serving:
            message = (
                f"rejected an answer in the name of {environment}, which serves this graph over "
                "another connection"
            )
        return [self._event(time_ns, "environment_refused", message, environment, is_fault=True)]

    def _event(
        self,
        time_ns: int,
        event: EventKind,
        message: str,
        environment: str,
        *,
        is_fault: bool = False,
    ) -> Event:
        data = {"environment": environment}
        return self._events.emit(time_ns, event, message, data, is_fault=is_fault)
