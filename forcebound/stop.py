"""Signals that end a command, as bytes on a descriptor, and the request that ends a loop."""

import os
import signal
from collections.abc import Iterable
from types import FrameType
from typing import Any, Self

INTERRUPTED = 130  # exit status of a command that such a signal ended, as shells have it


def ending_signals() -> tuple[int, ...]:
    """Return the signals that end a command: Ctrl-C, SIGTERM, a closed terminal (unless ignored).

    ``nohup`` and ``&`` in a script start a command that ignores Ctrl-C, which is to end it all the
    same. An ignored SIGHUP stays ignored: for that a user types ``nohup``.
    """
    hangs_up = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hangs_up else []))


class SignalPipe:
    """Makes a descriptor readable when one of some signals arrives, even just before a sleep.

    It gives a byte for each signal, its number. Within the ``with`` block the signals have no other
    effect, unless a subclass adds one.
    """

    def __init__(self, signals: Iterable[int]) -> None:
        self._signals = tuple(signals)
        self.descriptor, self._wake_descriptor = os.pipe()
        os.set_blocking(self.descriptor, False)
        os.set_blocking(self._wake_descriptor, False)
        self._before: dict[int, Any] = {}
        self._wake_before = -1

    def __enter__(self) -> Self:
        self._wake_before = signal.set_wakeup_fd(self._wake_descriptor, warn_on_full_buffer=False)
        for number in self._signals:
            self._before[number] = signal.signal(number, self._caught)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wake_before)
        self.close()

    def close(self) -> None:
        """Close the descriptors."""
        os.close(self.descriptor)
        os.close(self._wake_descriptor)

    def _caught(self, number: int, frame: FrameType | None) -> None:
        """Ignore the signal: its byte on the descriptor is enough."""


class Stop(SignalPipe):
    """A request to end the loop, from a signal or :meth:`request`: ``requested``."""

    def __init__(self) -> None:
        super().__init__(ending_signals())
        self.requested = False

    def request(self) -> None:
        """Request the end of the loop."""
        self.requested = True
        os.write(self._wake_descriptor, b"\0")

    def _caught(self, number: int, frame: FrameType | None) -> None:
        self.requested = True
