"""A line to a board: its port, the guardian of its force, and its emulator where there is one.

A line fails once: it writes zero force, then refuses every message with the same reason. Nothing
searches for the next reply in a stream that has lost its order: the user closes the device, puts it
into its home pose and starts again.
"""

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress

from forcebound.errors import DeviceError
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.devices.truth_file import TruthFile, truth_beside
from forcebound.haptics.hands import Operator
from forcebound.hardware.emulated import start
from forcebound.hardware.guardian import Guardian
from forcebound.hardware.port import Port
from forcebound.hardware.ports import find

EMULATED = "emulated"  # a port's name
# Shares of the watchdog limit: after the first a silent board is lost, after the other the guardian
# ends the force; the rest is for waking.
SILENCE, TIMEOUT = 0.5, 0.75
QUIET = 0.05  # s; the reply to a former user's last zero may still be on its way
ACKNOWLEDGED_NS = 100_000_000  # within which a board answers zero force, on a busy machine too

_logger = logging.getLogger(__name__)


class Line:
    """An open line to the board of a kind of device, at a port of this name (see :func:`find`).

    ``zero`` is the message of zero force, whatever the board has received before; the board answers
    it with ``zero_reply`` bytes. A force ends that nobody renews within ``watchdog_limit`` s.
    ``baud`` matters to a UART; ``model`` and ``operator`` to an emulator, the port ``emulated``.
    ``opens`` opens what is no serial port, which then has a ``zero`` of its own.

    Raises:
        DeviceError: If port, guardian or emulator cannot be opened.

    Attributes:
        port: Open. Write with :meth:`send`.
        silence: A board that is silent for longer is lost, in s.
        is_at_rest: Whether its last force was ended, and the board has answered if it does.
        truth: The ground truth of an emulated device; None: it is a real one.
    """

    def __init__(
        self,
        kind: str,
        name: str,
        zero: bytes,
        watchdog_limit: float,
        *,
        baud: int = 115_200,
        zero_reply: int = 0,
        opens: Callable[[str], Port] | None = None,
        model: DeviceModel | None = None,
        operator: Operator | None = None,
    ) -> None:
        self._zero_reply = zero_reply
        self._had_force = False
        self.silence = SILENCE * watchdog_limit
        self.is_at_rest = False
        self._failure: DeviceError | None = None
        with ExitStack() as opened:
            if name == EMULATED and model is not None:
                emulator = start(kind, model, operator)
                opened.callback(emulator.close)
                name = emulator.link
            self.port = Port(find(name, kind), baud) if opens is None else opens(name)
            opened.callback(self.port.close)
            self.port.drain(QUIET)  # what a former user has left
            self._zero = zero or self.port.zero
            self.truth: TruthFile | None = truth_beside(self.port.path)
            if self.truth is not None:
                opened.callback(self.truth.close)
                self.truth.announce()
            self._guardian = Guardian(self.port.descriptor, self._zero, TIMEOUT * watchdog_limit)
            opened.callback(self._guardian.close)
            self._opened = opened.pop_all()

    @property
    def has_failed(self) -> bool:
        """Whether it refuses every message."""
        return self._failure is not None

    def send(self, message: bytes, has_force: bool) -> None:
        """Write a message in one piece; the replies of all before have been read.

        ``has_force``: the board gives a force after it. The guardian watches from before a force
        until after a zero. DeviceError if it cannot be written, unexpected bytes have come, the
        guardian has ended the force, or the line has failed before.
        """
        if self._failure is not None:
            raise self._failure
        guardian = self._guardian
        if has_force:
            self._had_force = True
            guardian.beat(time.monotonic_ns())
        guardian.check()
        if foreign := self.port.drain():
            found = foreign[:20].hex(" ")
            raise DeviceError(f"the device at {self.port.path} sends unexpected bytes: {found}")
        self.port.write(message)
        if not has_force:
            guardian.beat(0)
        guardian.check()

    def fail(self, failure: DeviceError) -> None:
        """Write zero force, if the port still takes it, and refuse every message from now on.

        If the guardian has ended the force, that is what has failed first, and is raised: a board
        may answer its zero, too.
        """
        try:
            if self._failure is None:
                self._failure = failure
                self._guardian.check()
        except DeviceError as first:
            self._failure = first
            raise
        finally:
            self._rest()

    def close(self) -> None:
        """Write zero force, then close everything."""
        self._rest()
        self._opened.close()

    def _rest(self) -> None:
        """Write zero force; log it, once, if the board may not have taken it."""
        with suppress(DeviceError):
            self.port.drain()
            self.port.write(self._zero)
            if not self.is_at_rest:
                until_ns = time.monotonic_ns() + ACKNOWLEDGED_NS
                reply = self.port.read(self._zero_reply, until_ns)
                self.is_at_rest = len(reply) >= self._zero_reply
        self.is_at_rest = self.is_at_rest or self.port.is_over
        if self._had_force and not self.is_at_rest:
            self._had_force = False
            _logger.error(
                "a force may still be on: the device at %s has not acknowledged zero force: take"
                " the power from its motors",
                self.port.path,
            )
