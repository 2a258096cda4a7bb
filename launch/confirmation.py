"""The word of the user that a lost device is in order: Enter, in the launcher's terminal."""

import os
import selectors
import termios
from contextlib import suppress

STANDARD_INPUT = 0
CHUNK = 4096  # bytes; more than a line


class Confirmation:
    """Waits for Enter when asked to; in a pipe, or in the background, nobody can press it.

    Args:
        selector: Of the launcher's loop, which calls :meth:`read`.
        descriptor: Of the terminal.
    """

    def __init__(self, selector: selectors.BaseSelector, descriptor: int = STANDARD_INPUT) -> None:
        self._selector, self._descriptor = selector, descriptor
        self._is_given = False

    def ask(self) -> None:
        """Wait for Enter from now on; what was typed before does not count."""
        if self._is_in_foreground():
            termios.tcflush(self._descriptor, termios.TCIFLUSH)
            self._selector.register(self._descriptor, selectors.EVENT_READ, self)

    def withdraw(self) -> None:
        """Wait no longer."""
        with suppress(KeyError):  # not asked for, or pressed
            self._selector.unregister(self._descriptor)

    def read(self) -> bool:
        """Take what was typed; return whether to wait on."""
        if self._is_in_foreground():  # else reading would suspend the launcher
            self._is_given = os.read(self._descriptor, CHUNK).endswith(b"\n")
        return False

    def take(self) -> bool:
        """Return whether Enter was pressed since the last call."""
        is_given, self._is_given = self._is_given, False
        return is_given

    def _is_in_foreground(self) -> bool:
        try:
            return os.tcgetpgrp(self._descriptor) == os.getpgrp()
        except OSError:  # no terminal
            return False
