"""Telemetry of a run as columns, one array per field."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Self

from forcebound.messages.packets import Contact, EnvironmentReply, Telemetry, Vector

if TYPE_CHECKING:  # a launcher starts without numpy
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class TelemetryColumns:
    """The telemetry of a run, one array per field; ``n`` samples, oldest first.

    ``None`` in a packet is NaN here (-1 in ``device_seq``). Contacts are those of the state of the
    same tick, whenever the environment answered it. A device that was lost and returned begins its
    counts anew; here they go on.
    """

    time: NDArray[np.float64]  # (n,), s since the first sample with an engaged force
    time_ns: NDArray[np.int64]  # (n,), ns, device's clock
    seq: NDArray[np.int64]  # (n,), tick number
    elapsed: NDArray[np.float64]  # (n,), s since the force engaged for the first time
    position: NDArray[np.float64]  # (n, axes), m, reading
    commanded_force: NDArray[np.float64]  # (n, axes), N
    applied_force: NDArray[np.float64]  # (n, axes), N
    force_limit: NDArray[np.float64]  # (n,), N
    estimated_energy: NDArray[np.float64]  # (n,), J
    true_energy: NDArray[np.float64]  # (n,), J
    true_position: NDArray[np.float64]  # (n, axes), m
    hand_force: NDArray[np.float64]  # (n, axes), N
    engagement: NDArray[np.float64]  # (n,), 0 to 1
    device_seq: NDArray[np.int64]  # (n,), tick that the force answers; -1: none
    loop_delay: NDArray[np.float64]  # (n,), s
    deadline_misses: NDArray[np.int64]  # (n,), ticks skipped so far
    is_told: NDArray[np.bool_]  # (n,), whether the environment's answer to this tick is known
    proxy: NDArray[np.float64]  # (n, axes), m; NaN without a contact
    normal: NDArray[np.float64]  # (n, axes), outward unit normal at the proxy; NaN likewise
    rejected: Mapping[str, int]  # packets rejected by the end of the run, by reason

    @classmethod
    def from_packets(
        cls, packets: Sequence[Telemetry], replies: Sequence[EnvironmentReply] = ()
    ) -> Self:
        """Return the columns of ``packets``; without packets, empty columns of one axis.

        Args:
            packets: Of the run, oldest first.
            replies: Of the run's environment, for the contacts.

        Raises:
            ValueError: If the packets differ in their number of axes.
        """
        import numpy as np

        axes = len(packets[0].position) if packets else 1
        nothing = (math.nan,) * axes

        def floats(values: list[float | None]) -> NDArray[np.float64]:
            return np.array(values, dtype=np.float64)  # None becomes NaN

        def integers(values: list[int]) -> NDArray[np.int64]:
            return np.array(values, dtype=np.int64)

        def vectors(values: list[Vector]) -> NDArray[np.float64]:
            return np.array(values, dtype=np.float64).reshape(len(packets), axes)

        time_ns = integers([p.time_ns for p in packets])
        engagement = floats([p.engagement for p in packets])
        start = int(np.argmax(engagement > 0.0)) if packets else 0
        time = (time_ns - time_ns[start]) * 1e-9 if packets else floats([])
        seq = integers([p.seq for p in packets])
        returns = np.flatnonzero(np.diff(seq) < 0) + 1  # samples at which a device has returned
        life = np.searchsorted(returns, np.arange(len(packets)), "right")
        ticks = _before(seq + 1, returns)
        seq = seq + ticks[life]
        answered = integers([-1 if p.device_seq is None else p.device_seq for p in packets])
        elapsed = floats([p.elapsed for p in packets])
        misses = integers([p.deadline_misses for p in packets])
        ends = [packets[end - 1].rejected for end in (*returns.tolist(), len(packets)) if end]
        lives = np.searchsorted(time_ns[returns - 1], integers([r.device_time_ns for r in replies]))
        told = {
            reply.device_seq + before: reply.contact
            for reply, before in zip(replies, ticks[lives].tolist(), strict=True)
            if len(reply.force) == axes
        }
        contacts = [told.get(tick) or Contact(nothing, nothing) for tick in seq.tolist()]
        return cls(
            time=time,
            time_ns=time_ns,
            seq=seq,
            elapsed=np.where(life > 0, elapsed[start : start + 1] + time, elapsed),
            position=vectors([p.position for p in packets]),
            commanded_force=vectors([p.commanded_force for p in packets]),
            applied_force=vectors([p.applied_force for p in packets]),
            force_limit=floats([p.force_limit for p in packets]),
            estimated_energy=floats([p.estimated_energy for p in packets]),
            true_energy=floats([p.true_energy for p in packets]),
            true_position=vectors([p.true_position or nothing for p in packets]),
            hand_force=vectors([p.hand_force or nothing for p in packets]),
            engagement=engagement,
            device_seq=np.where(answered < 0, answered, answered + ticks[life]),
            loop_delay=floats([p.loop_delay for p in packets]),
            deadline_misses=misses + _before(misses, returns)[life],
            is_told=np.array([tick in told for tick in seq.tolist()], dtype=np.bool_),
            proxy=vectors([contact.proxy for contact in contacts]),
            normal=vectors([contact.normal for contact in contacts]),
            rejected=dict(sum(map(Counter, ends), Counter())),
        )

    def slice(self, chosen: NDArray[np.bool_]) -> Self:
        """Return the chosen samples, a mask of shape (n,); times and counts stay as they are."""
        columns = {
            field.name: getattr(self, field.name)[chosen]
            for field in fields(self)
            if field.name != "rejected"
        }
        return replace(self, **columns)


def _before(counts: NDArray[np.int64], returns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return what was counted before each life of a device; one begins at each of ``returns``."""
    import numpy as np

    return np.concatenate(([0], np.cumsum(counts[returns - 1], dtype=np.int64)))
