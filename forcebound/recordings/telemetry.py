"""Telemetry of a run as columns, one array per field."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import chain
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Self, get_args

from forcebound.messages.packets import EnvironmentReply, Packet, Telemetry, Vector, field_types
from forcebound.messages.topology import HAND

if TYPE_CHECKING:  # a launcher starts without numpy
    import numpy as np
    from numpy.typing import NDArray

_KINDS: dict[Any, str] = {int: "int64", float: "float64", Vector: "vector"}  # of columns
_WAITING = 256  # packets at once, column by column: one by one takes five times as long


@dataclass(frozen=True)
class TelemetryColumns:
    """The telemetry of a run, one array per field; ``n`` samples, oldest first.

    ``None`` in a packet is NaN here (-1 in a column of whole numbers). Contacts are those of the
    state of the same tick, whenever the environment answered it. A device that was lost and
    returned begins to count again; here the counts go on.
    """

    time: NDArray[np.float64]  # (n,), s since the first sample with an engaged force
    time_ns: NDArray[np.int64]  # (n,), ns, device's clock
    seq: NDArray[np.int64]  # (n,), tick number
    elapsed: NDArray[np.float64]  # (n,), s since the force engaged for the first time
    read_ns: NDArray[np.int64]  # (n,), ns, when the position was read; -1: not recorded
    write_ns: NDArray[np.int64]  # (n,), ns, from when on the force acts; likewise
    cut_ns: NDArray[np.int64]  # (n,), ns, when the watchdog dropped the force before; -1: not
    ahead_ns: NDArray[np.int64]  # (n,), ns, sum of the latch jitter so far; -1: not reported
    position: NDArray[np.float64]  # (n, axes), m, reading
    velocity: NDArray[np.float64]  # (n, axes), m/s, filtered; NaN: of recordings of before
    joints: NDArray[np.float64]  # (n, axes), rad, reading of an arm; else NaN
    commanded_force: NDArray[np.float64]  # (n, axes), N, before saturation
    applied_force: NDArray[np.float64]  # (n, axes), N
    torques: NDArray[np.float64]  # (n, axes), N m, of an arm; else NaN
    force_limit: NDArray[np.float64]  # (n,), N
    estimated_energy: NDArray[np.float64]  # (n,), J
    true_energy: NDArray[np.float64]  # (n,), J
    true_position: NDArray[np.float64]  # (n, axes), m
    hand_force: NDArray[np.float64]  # (n, axes), N
    engagement: NDArray[np.float64]  # (n,), 0 to 1
    device_seq: NDArray[np.int64]  # (n,), tick that the force answers; -1: none
    loop_delay: NDArray[np.float64]  # (n,), s
    reply_age: NDArray[np.float64]  # (n,), s, of the environment's reply in use
    given_energy: NDArray[np.float64]  # (n,), J, so far to the energy partner; NaN: has none
    received_energy: NDArray[np.float64]  # (n,), J, so far from it; likewise
    deadline_misses: NDArray[np.int64]  # (n,), ticks skipped so far
    is_answered: NDArray[np.bool_]  # (n,), whether the environment's answer to this tick is known
    proxy: NDArray[np.float64]  # (n, axes), m; NaN without a contact
    normal: NDArray[np.float64]  # (n, axes), outward unit normal at the proxy; NaN likewise
    rejected: Mapping[str, int]  # packets rejected by the end of the run, by reason
    hand: str = HAND  # its name

    @staticmethod
    def from_packets(
        packets: Iterable[Telemetry], replies: Iterable[EnvironmentReply] = ()
    ) -> TelemetryColumns:
        """Return the columns of ``packets``; without packets, empty columns of one axis.

        Args:
            packets: Of the run, oldest first.
            replies: Of the run's environment, for the contacts.

        Raises:
            ValueError: If the packets differ in their number of axes.
        """
        collector = TelemetryCollector()
        for packet in packets:
            collector.take(packet)
        for reply in replies:
            collector.take_reply(reply)
        return collector.columns()

    def slice(self, chosen: NDArray[np.bool_]) -> Self:
        """Return the chosen samples, a mask of shape (n,); times and counts stay as they are."""
        columns = {
            field.name: getattr(self, field.name)[chosen]
            for field in fields(self)
            if field.name not in ("rejected", "hand")
        }
        return replace(self, **columns)


def _kinds(packet: type[Packet], names: Collection[str]) -> dict[str, str]:
    """Return the kind of column for each of these fields of a packet; of other types: none."""
    found = {}
    for name, hint in field_types(packet).items():
        plain = hint if hint in _KINDS else next(iter(get_args(hint)), None)  # of float | None
        if name in names and plain in _KINDS:
            found[name] = _KINDS[plain]
    return found


_SAMPLE = _kinds(Telemetry, {field.name for field in fields(TelemetryColumns)})
_CONTACT = _kinds(EnvironmentReply, ("device_seq", "device_time_ns", "proxy", "normal"))


class TelemetryCollector:
    """Makes :class:`TelemetryColumns` of packets that come one by one, and keeps few of them."""

    def __init__(self) -> None:
        self._samples: _Table | None = None
        self._replies: dict[int, _Table] = {}  # by number of axes
        self._rejected: Counter[str] = Counter()  # in earlier lives of the device
        self._last: Any = None

    def __bool__(self) -> bool:
        """Whether there is a sample."""
        return self._last is not None

    def take(self, packet: Telemetry) -> None:
        """Take the next packet."""
        if self._samples is None:
            self._samples = _Table(_SAMPLE, len(packet.position))
        elif packet.seq < self._last.seq:
            self._rejected += Counter(self._last.rejected)
        self._last = packet
        self._samples.add(packet)

    def take_reply(self, reply: EnvironmentReply) -> None:
        """Take a reply of the run's environment, for the contacts; likewise."""
        axes = len(reply.force)
        if axes not in self._replies:
            self._replies[axes] = _Table(_CONTACT, axes)
        self._replies[axes].add(reply)

    def columns(self) -> TelemetryColumns:
        """Return the columns; nothing can be taken after that.

        Raises:
            ValueError: If the packets differ in their number of axes.
        """
        import numpy as np

        samples = self._samples or _Table(_SAMPLE, 1)
        columns = samples.columns()
        time_ns, seq, elapsed = (columns[name] for name in ("time_ns", "seq", "elapsed"))
        start = int(np.argmax(columns["engagement"] > 0.0)) if self else 0
        time = (time_ns - time_ns[start]) * 1e-9 if self else elapsed
        if self:
            self._rejected += Counter(self._last.rejected)
        replies = self._replies.get(samples.axes, _Table(_CONTACT, samples.axes)).columns()
        returns = np.flatnonzero(np.diff(seq) < 0) + 1  # samples at which a device has returned
        if returns.size:
            life = np.searchsorted(returns, np.arange(seq.size), "right")
            ticks = _before(seq + 1, returns)
            lives = np.searchsorted(time_ns[returns - 1], replies["device_time_ns"])
            replies["device_seq"] += ticks[lives]
            answered, misses = columns["device_seq"], columns["deadline_misses"]
            columns["device_seq"] = np.where(answered < 0, answered, answered + ticks[life])
            columns["deadline_misses"] = misses + _before(misses, returns)[life]
            columns["elapsed"] = np.where(life > 0, elapsed[start] + time, elapsed)
            columns["seq"] = seq = seq + ticks[life]
        contacts = _contacts(seq, replies)
        counts, hand = dict(self._rejected), self._last.hand if self else HAND
        return TelemetryColumns(time=time, rejected=counts, hand=hand, **columns, **contacts)


class _Table:
    """Fields of packets of one kind as columns.

    Args:
        kinds: Of the columns, by the fields.
        axes: Length of the vectors.
    """

    def __init__(self, kinds: Mapping[str, str], axes: int) -> None:
        self.axes = axes
        self._columns: dict[str, tuple[str, array[Any]]] = {
            name: (kind, array("q" if kind == "int64" else "d")) for name, kind in kinds.items()
        }
        self._nothing = {"int64": -1, "float64": math.nan, "vector": (math.nan,) * axes}
        self._counts: set[int] = {axes}  # of the entries of vectors
        self._waiting: list[Any] = []

    def add(self, packet: Any) -> None:
        self._waiting.append(packet)
        if len(self._waiting) == _WAITING:
            self._add_waiting()

    def _add_waiting(self) -> None:
        for name, (kind, column) in self._columns.items():
            values = list(map(attrgetter(name), self._waiting))
            if None in values:
                nothing = self._nothing[kind]
                values = [nothing if value is None else value for value in values]
            if kind == "vector":
                self._counts.update(map(len, values))
                column.extend(chain.from_iterable(values))
            else:
                column.extend(values)
        self._waiting.clear()

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return all packets until now as columns, which this table then no longer has."""
        import numpy as np

        self._add_waiting()
        if len(self._counts) > 1:
            counts = " and ".join(map(str, sorted(self._counts)))
            raise ValueError(f"telemetry has {counts} axes; a run has one number")
        found = {}
        for name in list(self._columns):  # one after the other: of a long run they are large
            kind, column = self._columns.pop(name)
            values = np.array(column)
            found[name] = values if kind in ("int64", "float64") else values.reshape(-1, self.axes)
        return found


def _contacts(
    seq: NDArray[np.int64], replies: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return of each tick whether its answer is known, and the contact in the last one.

    Args:
        seq: Numbers of the ticks.
        replies: Columns of the replies; ``device_seq`` counts as ``seq`` does.
    """
    import numpy as np

    ticks = replies["device_seq"]
    if not ticks.size:
        nowhere = np.broadcast_to(math.nan, (seq.size, replies["proxy"].shape[1]))
        return {"is_answered": np.zeros(seq.size, np.bool_), "proxy": nowhere, "normal": nowhere}
    order = np.argsort(ticks, kind="stable")
    last = np.searchsorted(ticks, seq, "right", sorter=order) - 1  # -1: any, since no answer
    reply = order[last]
    is_answered = ticks[reply] == seq
    return {
        "is_answered": is_answered,
        "proxy": np.where(is_answered[:, np.newaxis], replies["proxy"][reply], math.nan),
        "normal": np.where(is_answered[:, np.newaxis], replies["normal"][reply], math.nan),
    }


def _before(counts: NDArray[np.int64], returns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return what was counted before each life of a device; one begins at each of ``returns``."""
    import numpy as np

    return np.concatenate(([0], np.cumsum(counts[returns - 1], dtype=np.int64)))
