"""Joints at a serial port: the common part of the drivers that ship."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Generic, Literal, NamedTuple, TypeVar

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Device, Truth
from forcebound.haptics.devices.arms import StatedJoints
from forcebound.haptics.hands import Operator
from forcebound.hardware.line import EMULATED, Line
from forcebound.hardware.port import Port
from forcebound.hardware.ports import check_serial_number, find, serial_number
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Inertia, Name, Range, Time

# s. Nobody is in danger at an emulator, and a busy machine should not end the run: at a load of 5
# on two cores the longest of 200 000 replies took 33 ms.
LIMIT, EMULATED_LIMIT = 0.02, 0.1
SILENT = "is this the port of the board that the launch file names, does it have power?"
STARVED = (
    "the emulator got no processor for so long (try again, or"
    ' watchdog_limit:="100 ms"), or has a fault that was asked for'
)
FIRST_EXCHANGES = 50  # without force, for the quickest exchange
LONGEST_WAIT = 0.5  # s, for a board that has not been given a force yet

Reply = TypeVar("Reply")


@dataclass(frozen=True, kw_only=True)
class DriverNumbers:
    """Stated numbers of a driver, whatever the device.

    Attributes:
        watchdog_limit: Age at which a force ends that nobody renews; a board that is silent for
            half of it is lost. auto: 20 ms at a port; 100 ms if the port is emulated, on a
            machine that may be busy.
        port: Path of the serial port, auto, the serial number of its USB device, or emulated.
        serial_number: Of the USB device whose numbers these are; `forcebound identify` writes it,
            and a launch refuses a port with another one. Empty, or a port without one: any.
        on_loss: Of the device, while the force is on: end ends the graph; wait keeps it, without
            force, until the device is in order and the user says so (`forcebound device resume`). A
            device whose guardian is gone or silent waits in either case.
        reply_within: A reply that takes so much longer than the quickest of its kind is counted as
            late; a reading that came with a write serves the next state if it is younger than this.
    """

    watchdog: Literal["none"] = "none"
    watchdog_limit: Annotated[Time, Range(at_least=0.005, at_most=100.0)] | Literal["auto"] = "auto"
    port: Name = EMULATED
    serial_number: Name = ""
    on_loss: Literal["end", "wait"] = "end"
    reply_within: Annotated[Time, POSITIVE] = 3e-4

    @property
    def longest_force(self) -> float:
        """The watchdog limit, in s; see the class."""
        if self.watchdog_limit != "auto":
            return self.watchdog_limit
        return EMULATED_LIMIT if self.port == EMULATED else LIMIT


@dataclass(frozen=True, kw_only=True)
class SerialNumbers(DriverNumbers):
    """Stated numbers of a driver of a board at a serial port."""

    board: ClassVar[str]  # kind of device

    def check_here(self) -> None:
        """Check, before anything starts, the port and its serial number; DeviceError if wrong."""
        if self.port != EMULATED:
            path = find(self.port, self.board)
            Port(path).close()
            check_serial_number(path, self.serial_number)

    @contextmanager
    def line(
        self, zero: bytes, operator: Operator | None, baud: int = 115_200, reply: int = 0
    ) -> Iterator[Line]:
        """Open the line to the board, which is closed if what follows fails; see :class:`Line`."""
        numbers: dict[str, Any] = {"baud": baud, "zero_reply": reply, "operator": operator}
        numbers["model"] = self
        line = Line(self.board, self.port, zero, self.longest_force, **numbers)
        try:
            yield line
        except BaseException:
            line.close()
            raise


@dataclass(frozen=True, kw_only=True)
class SerialJoints(  # pyright: ignore[reportIncompatibleVariableOverride]
    SerialNumbers, StatedJoints
):
    """Stated numbers of joints at a serial port."""

    inertia: Annotated[Inertia, POSITIVE] = 1e-4  # assumed; of the emulator alone


class Exchange(NamedTuple, Generic[Reply]):
    """A message and its reply."""

    sent_ns: int
    came_ns: int
    excess_ns: int  # that it took longer than the quickest of its kind so far
    reply: Reply


class Exchanges:
    """Exchanges with the board on a line, counted; one is late by ``within`` s after the quickest.

    ``silent`` says what to try when none comes from a real board.

    Attributes:
        longest_wait: A board that is silent for longer is lost, in s.
        count: Of the replies since the last :meth:`restart`.
        late: Of those that were late.
        longest_ns: That one of them took, in ns.
    """

    def __init__(
        self, line: Line, within: float, clock: Callable[[], int], silent: str = SILENT
    ) -> None:
        self._line, self._clock = line, clock
        self.silent = silent if line.truth is None else STARVED
        self._late_ns = round(within * 1e9)
        self._quickest_ns: dict[str, int] = {}
        self.longest_wait = line.silence
        self.count = self.late = self.longest_ns = 0

    def exchange(
        self,
        kind: str,
        message: bytes,
        receive: Callable[[int], bytes],
        parse: Callable[[bytes], Reply],
        has_force: bool = False,
    ) -> Exchange[Reply]:
        """Send a message, ``receive`` what comes until a time (ns), and ``parse`` it.

        Messages of a ``kind`` should take equally long. DeviceError, after zero force was written,
        if the reply is not what is expected.
        """
        try:
            sent_ns = self._clock()
            self._line.send(message, has_force)
            data = receive(sent_ns + round(self.longest_wait * 1e9))
            came_ns = self._clock()
            if not data:
                raise DeviceError(f"no reply within {1e3 * self.longest_wait:g} ms: {self.silent}")
            reply = parse(data)
        except DeviceError as failure:
            self._line.fail(failure)
            raise
        took_ns = came_ns - sent_ns
        self.count += 1
        self.longest_ns = max(self.longest_ns, took_ns)
        quickest_ns = min(self._quickest_ns.get(kind, took_ns), took_ns)
        self.late += took_ns - quickest_ns > self._late_ns
        self._quickest_ns[kind] = quickest_ns
        return Exchange(sent_ns, came_ns, took_ns - quickest_ns, reply)

    def quickest_ns(self, kind: str) -> int:
        """Return what a message of this kind took at best, in ns."""
        return self._quickest_ns[kind]

    def restart(self) -> None:
        """Count from now on."""
        self.count = self.late = self.longest_ns = 0

    def log(self, logger: logging.Logger) -> None:
        """Log the counts, if a reply has come."""
        if self.count:
            share, late = 100.0 * self.late / self.count, ""
            if self.late:
                late = (
                    f", {share:.2f} % of them {1e-6 * self._late_ns:.2g} ms or more after the rest"
                )
            words = "%d replies of the device, the longest wait %.2g ms%s"
            logger.info(words, self.count, 1e-6 * self.longest_ns, late)


class SerialDevice(Device):
    """An open device on a line; its driver adds reading and writing.

    A reading is fresh for ``reply_within`` s. The counts of ``exchanges`` are those since it was
    opened.
    """

    is_exchange = True
    kinematics: Any  # ArmKinematics; None: others see the joints

    def __init__(
        self,
        line: Line,
        exchanges: Exchanges,
        reply_within: float,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._line, self._clock = line, clock
        self.exchanges = exchanges
        self._fresh_ns = round(reply_within * 1e9)
        self._read_ns = self._effect_ns = self._jitter_ns = 0
        self._came_ns = 0  # when the last write's reply had come
        self._angles: Vector = ()  # newest, rad

    @property
    def serial_number(self) -> str:
        """Serial number of the USB device; empty if it has none."""
        return serial_number(self._line.port.path)

    def engage(self, time_ns: int) -> None:
        if self._line.truth is not None:
            self._line.truth.engage(time_ns)

    def stamps(self) -> tuple[int, int]:
        return self._read_ns, max(self._effect_ns, self._read_ns)

    def fresh_reading(self) -> Vector | None:
        is_fresh = self._clock() - self._came_ns <= self._fresh_ns
        return self._angles if is_fresh else None

    def latch_jitter(self) -> int:
        return self._jitter_ns

    def truth(self) -> Truth | None:
        return None if self._line.truth is None else self._line.truth.read()
