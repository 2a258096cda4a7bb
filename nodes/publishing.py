"""Signals of a part, on their way into the packets and events of its node."""

from collections.abc import Callable, Collection, Mapping
from math import isfinite
from typing import get_args

from msgspec import UNSET, UnsetType

from forcebound.files import printable
from forcebound.haptics.parts.signals import Publisher, Signal
from forcebound.messages.events import REMOTE, EventLog, Kind
from forcebound.messages.packets import MAX_NAME, Event

EVENTS_PER_SECOND = 10  # of one part; further ones are counted


class Signals:
    """Takes what a part publishes; ``reject`` counts what its model does not declare.

    A name that is not declared, or a value that is no number, is dropped; the first is reported,
    and the number of the others at the end.
    """

    def __init__(
        self,
        part: Publisher,
        declared: Collection[Signal],
        log: EventLog,
        reject: Callable[[str], None],
    ) -> None:
        self.watch(part)
        self._names = frozenset(signal.name for signal in declared)
        self._log, self._reject = log, reject
        self._dropped, self._why = 0, ""  # numbers so far; the first, not reported yet
        self._begin_ns = 0  # of the second in which `_left` events may still be sent
        self._left = EVENTS_PER_SECOND

    def watch(self, part: Publisher) -> None:
        """Take what this part publishes from now on."""
        self._held, self._waiting = part.published.numbers, part.published.events

    def numbers(self) -> Mapping[str, float] | UnsetType:
        """Return the finite numbers of now, for a packet; unset without any."""
        held = self._held
        if not held:
            return UNSET
        try:
            if held.keys() <= self._names:
                return {n: float(value) for n, value in held.items() if isfinite(value)} or UNSET
        except Exception:  # a value of any type, which is no number
            pass
        self._drop()
        return self.numbers()

    def events(self, time_ns: int) -> list[Event]:
        """Return the events since the last call."""
        if not self._waiting and not self._why:
            return []
        if time_ns - self._begin_ns >= 1_000_000_000:
            self._begin_ns, self._left = time_ns, EVENTS_PER_SECOND
        sent = []
        for event, message, is_fault in self._waiting:
            is_text = isinstance(event, str) and isinstance(message, str)
            if self._left and is_text and _is_kind(event):
                self._left -= 1
                words = printable(message or event)
                sent.append(self._log.publish(time_ns, event, words, is_fault=is_fault is True))
            else:
                self._reject("event")
        self._waiting.clear()
        if self._why:
            sent.append(self._log.emit(time_ns, "signal_refused", self._why, is_fault=True))
            self._why = ""
        return sent

    def last_events(self, time_ns: int) -> list[Event]:
        """Return how many numbers were dropped after the first, at the end of a run."""
        more = self._dropped - 1
        if more < 1:
            return []
        words, data = f"numbers dropped since: {more}", {"suppressed": str(more - 1)}
        return [self._log.emit(time_ns, "signal_refused", words, data, is_fault=True)]

    def _drop(self) -> None:
        for name, value in tuple(self._held.items()):
            if name in self._names and _is_number(value):
                continue
            del self._held[name]
            self._reject("signal")
            if not self._dropped:
                known = ", ".join(sorted(self._names)) or "none"
                self._why = f"signal {name!r}: expected a number, under a name of: {known}"
            self._dropped += 1


def _is_number(value: float) -> bool:
    try:
        isfinite(value)
    except Exception:
        return False
    return True


def _is_kind(event: str) -> bool:
    is_reserved = event in get_args(Kind) or event.startswith(REMOTE)
    return 0 < len(event) <= MAX_NAME and event.isprintable() and not is_reserved
