"""Signals of a part, on their way into the packets and events of its node."""

from collections.abc import Callable, Collection, Mapping
from typing import get_args

from msgspec import UNSET, UnsetType

from forcebound.files import printable
from forcebound.haptics.parts.signals import Publisher, Signal
from forcebound.messages.events import REMOTE, EventKind, EventLog
from forcebound.messages.packets import MAX_NAME, Event

EVENTS_PER_SECOND = 10  # of one part; further ones are counted


class Signals:
    """Takes what a part publishes; ``reject`` counts events that are none.

    A number that is not declared is an error where the part publishes it
    (:class:`forcebound.haptics.parts.signals.SignalError`), or here if it did so in its ``open``.

    Attributes:
        waiting: Events of the part that were not taken yet; without any, there is nothing to do.
    """

    def __init__(
        self,
        part: Publisher,
        declared: Collection[Signal],
        log: EventLog,
        reject: Callable[[str], None],
    ) -> None:
        self._declared, self._log, self._reject = declared, log, reject
        self.watch(part)
        self._begin_ns = 0  # of the second in which `_left` events may still be sent
        self._left = EVENTS_PER_SECOND

    def watch(self, part: Publisher) -> None:
        """Take what this part publishes from now on."""
        part.published.declare(self._declared)
        self._held, self.waiting = part.published.numbers, part.published.events

    def numbers(self) -> Mapping[str, float] | UnsetType:
        """Return the numbers of now, for a packet; unset without any."""
        return dict(self._held) if self._held else UNSET

    def events(self, time_ns: int) -> list[Event]:
        """Return the events since the last call."""
        if time_ns - self._begin_ns >= 1_000_000_000:
            self._begin_ns, self._left = time_ns, EVENTS_PER_SECOND
        sent = []
        for event, message, is_fault in self.waiting:
            is_text = isinstance(event, str) and isinstance(message, str)
            if self._left and is_text and _is_kind(event):
                self._left -= 1
                words = printable(message or event)
                sent.append(self._log.publish(time_ns, event, words, is_fault=is_fault is True))
            else:
                self._reject("event")
        self.waiting.clear()
        return sent


def _is_kind(event: str) -> bool:
    is_reserved = event in get_args(EventKind) or event.startswith(REMOTE)
    return 0 < len(event) <= MAX_NAME and event.isprintable() and not is_reserved
