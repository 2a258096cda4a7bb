"""Signals of a part, on their way into the packets and events of its node."""

from collections.abc import Callable, Collection, Mapping
from math import isfinite

from msgspec import UNSET, UnsetType

from forcebound.files import printable
from forcebound.haptics.parts.signals import Publisher, Signal
from forcebound.messages.events import PUBLISHED, RESERVED, EventLog
from forcebound.messages.packets import MAX_NAME, Event

EVENTS_PER_SECOND = 10  # of one part; further ones are counted


class Signals:
    """Takes what a part publishes; ``reject`` counts what its model does not declare.

    A name that is not declared, or a value that is no number, is dropped; the first is reported.
    """

    def __init__(
        self,
        part: Publisher,
        declared: Collection[Signal],
        log: EventLog,
        reject: Callable[[str], None],
    ) -> None:
        self.part = part
        self._names = frozenset(signal.name for signal in declared)
        self._log, self._reject = log, reject
        self._is_reported = False
        self._begin_ns = 0  # of the second in which `_left` events may still be sent
        self._left = EVENTS_PER_SECOND

    def numbers(self) -> Mapping[str, float] | UnsetType:
        """Return the finite numbers of now, for a packet; unset without any."""
        held = self.part.published.numbers
        if not held:
            return UNSET
        try:
            if held.keys() <= self._names:
                return {n: float(value) for n, value in held.items() if isfinite(value)} or UNSET
        except Exception:  # a value of any type, which is no number
            pass
        self._drop(held)
        return self.numbers()

    def events(self, time_ns: int) -> list[Event]:
        """Return the events since the last call."""
        waiting = self.part.published.events
        if not waiting:
            return []
        if time_ns - self._begin_ns >= 1_000_000_000:
            self._begin_ns, self._left = time_ns, EVENTS_PER_SECOND
        sent = []
        for event, message, is_fault in waiting:
            is_text = isinstance(event, str) and isinstance(message, str)
            if self._left and is_text and _is_kind(event):
                self._left -= 1
                words, data = printable(message or event), {PUBLISHED: "true"}
                sent.append(self._log.emit(time_ns, event, words, data, is_fault=is_fault is True))
            else:
                self._reject("event")
        waiting.clear()
        return sent

    def _drop(self, held: dict[str, float]) -> None:
        for name, value in tuple(held.items()):
            if name in self._names and _is_number(value):
                continue
            del held[name]
            self._reject("signal")
            if not self._is_reported:
                self._is_reported = True
                known = ", ".join(sorted(self._names)) or "none"
                words = f"signal {name!r}: expected a number, under a name of: {known}"
                self.part.published.events.append(("signal_refused", words, True))


def _is_number(value: float) -> bool:
    try:
        isfinite(value)
    except Exception:
        return False
    return True


def _is_kind(event: str) -> bool:
    return 0 < len(event) <= MAX_NAME and event.isprintable() and event not in RESERVED
