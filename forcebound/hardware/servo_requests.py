"""Requests to the servos on a bus, and what they answer."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NoReturn

from forcebound.errors import DeviceError
from forcebound.hardware.dynamixel_frames import Status
from forcebound.hardware.line import Line
from forcebound.hardware.port import CHUNK
from forcebound.hardware.serial_device import LONGEST_WAIT, Exchange, Exchanges

SILENT = "look at its power, its cable, its id and baud rate"


class Bus(Exchanges):
    """Requests to servos, by id, each in words in ``names``; ``frames``: a protocol's module."""

    def __init__(
        self,
        line: Line,
        within: float,
        clock: Callable[[], int],
        frames: Any,
        names: Mapping[int, str],
    ) -> None:
        super().__init__(line, within, clock, SILENT)
        self.longest_wait = max(LONGEST_WAIT, line.silence)
        self._frames, self.names = frames, names

    def ask(
        self, kind: str, message: bytes, servos: Sequence[int], has_force: bool = False
    ) -> Exchange[list[Status]]:
        """Send a message that these servos answer, in this order; as :meth:`exchange`."""

        def receive(until_ns: int) -> bytes:
            return self._receive(servos, until_ns)

        return self.exchange(
            kind, message, receive, lambda data: self._parse(data, servos), has_force
        )

    def collect(self, servo: int) -> Status:
        """Return what a servo answers to what was ordered before; DeviceError as in ``ask``."""
        until_ns = self._clock() + round(self.longest_wait * 1e9)
        try:
            return self._parse(self._receive((servo,), until_ns), (servo,))[0]
        except DeviceError as failure:
            self.end(failure)

    def order(self, message: bytes, has_force: bool) -> None:
        """Send a message whose answers, if any, are collected later; as ``ask``."""
        try:
            self._line.send(message, has_force)
        except DeviceError as failure:
            self.end(failure)

    def single(self, servo: int, message: bytes, count: int) -> bytes:
        """Return the values, as many as expected, that a servo answers before the run."""
        ((_, error, values),) = self.ask("single", message, (servo,)).reply
        if len(values) != count:
            what = f"expected {count} bytes, got {len(values)}, error {error:#x}"
            self.end(DeviceError(f"{self.names[servo]} refuses {message.hex(' ')}: {what}"))
        return values

    def number(self, servo: int, address: int, count: int = 1) -> int:
        """Return what a register of a servo has."""
        message = self._frames.read(servo, address, count)
        return int.from_bytes(self.single(servo, message, count), "little")

    def keep(self, servo: int, address: int, value: int, lock: int | None = None) -> None:
        """Let a servo keep a setting, a byte; DeviceError if it does not. ``lock``: a register."""
        if self.number(servo, address) == value:
            return
        writes = [(address, value)] if lock is None else [(lock, 0), (address, value), (lock, 1)]
        for register, written in writes:
            self.single(servo, self._frames.write(servo, register, bytes((written,))), 0)
        if (after := self.number(servo, address)) != value:
            words = f"{self.names[servo]} keeps register {address} at {after}, expected {value}"
            self.end(DeviceError(words))

    def end(self, failure: DeviceError) -> NoReturn:
        """Write zero force, refuse all further messages, raise the failure."""
        self._line.fail(failure)
        raise failure

    def _receive(self, servos: Sequence[int], until_ns: int) -> bytes:
        def missing(data: bytes) -> int:
            with suppress(DeviceError):  # of what is no packet
                for _ in servos:
                    size = self._frames.size(data)
                    if not 0 < size <= len(data):
                        return CHUNK
                    data = data[size:]
            return 0

        return self._line.port.read_until(missing, until_ns) or self._miss(servos[0])

    def _parse(self, data: bytes, servos: Sequence[int]) -> list[Status]:
        found: list[Status] = []
        for servo in servos:
            try:
                size = self._frames.size(data)
                status = self._frames.status(data[:size]) if 0 < size <= len(data) else None
            except DeviceError as error:
                raise DeviceError(f"{self.names[servo]}: {error}") from error
            if status is None or status.servo != servo:
                self._miss(servo, data if status is None else b"")
            found.append(status)
            data = data[size:]
        if data:
            raise DeviceError(f"nobody was asked for what came on the bus: {data.hex(' ')}")
        return found

    def _miss(self, servo: int, rest: bytes = b"") -> NoReturn:
        cut = f", but {rest.hex(' ')}" if rest else ""
        raise DeviceError(
            f"{self.names[servo]} has not answered within {1e3 * self.longest_wait:g} ms{cut}:"
            f" {self.silent}"
        )


def orders(frames: Any, values: Iterable[tuple[int, Mapping[int, bytes]]]) -> bytes:
    """Return orders to write registers: of each its address, and values by the id of a servo."""
    return b"".join([frames.sync_write(by_id, address) for address, by_id in values if by_id])
