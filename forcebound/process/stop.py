"""How the loop of a process is ended: by a signal, or by anyone who holds a request."""

import os
import signal
from types import FrameType, TracebackType
from typing import Any, Self


class Stop:
    """A request to end the loop, from a signal or from anyone who holds it.

    Within the ``with`` block SIGTERM and SIGINT set :attr:`requested` and make
    :attr:`descriptor` readable, also when they come just before a sleep.
    """

    _SIGNALS = (signal.SIGTERM, signal.SIGINT)

    def __init__(self) -> None:
        self.requested = False
        self.descriptor, self._wake_descriptor = os.pipe()
        os.set_blocking(self._wake_descriptor, False)
        self._before: dict[int, Any] = {}
        self._wake_before = -1

    def request(self) -> None:
        """Ask the loop to end."""
        self.requested = True
        os.write(self._wake_descriptor, b"\0")

    def __enter__(self) -> Self:
        self._wake_before = signal.set_wakeup_fd(self._wake_descriptor, warn_on_full_buffer=False)
        for number in self._SIGNALS:
            self._before[number] = signal.signal(number, self._caught)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wake_before)
        self.close()

    def close(self) -> None:
        """Close the descriptors."""
        os.close(self.descriptor)
        os.close(self._wake_descriptor)

    def _caught(self, number: int, frame: FrameType | None) -> None:
        self.requested = True
