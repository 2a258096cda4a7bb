"""The Haply Inverse3, through its maker's service: a point with three axes.

How exchanges, stamps and the certificate work: docs/devices.md. The service adds a positive force
of its own coordinates to the hand's; a positive force of forcebound resists that.

One message is on its way at a time, and each has one reply. What goes wrong ends in zero force and
a DeviceError, once (:mod:`forcebound.hardware.line`): a reply that is malformed, doubled, of
another session or without the device; a device that is no longer ready; an event of the service
about its safety; a session that has ended; silence for half of the watchdog limit; a guardian that
is gone or had to step in. A late reply is counted and used: it makes a late tick, whose force the
ledger knows. The zero force that is written then ends the session, too.
"""

import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, ClassVar, Literal

from forcebound.errors import DeviceError
from forcebound.haptics.devices import AxesModel, Source
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.bounder import saturated
from forcebound.haptics.laws.dissipation import (
    Attenuates,
    DampingOfAxes,
    FrictionOfAxes,
    LengthOfAxes,
)
from forcebound.hardware import inverse_service
from forcebound.hardware.inverse_messages import Grip, chosen, framed
from forcebound.hardware.inverse_session import NO_FORCE, Session, claim
from forcebound.hardware.line import EMULATED, Line
from forcebound.hardware.serial_device import (
    FIRST_EXCHANGES,
    DriverNumbers,
    Exchange,
    Exchanges,
    SerialDevice,
)
from forcebound.messages.packets import Quaternion, Vector
from forcebound.quantities import (
    POSITIVE,
    Force,
    Length,
    Mass,
    Name,
    Range,
    Ratio,
    Speed,
    Time,
)

GUESSED = "damping friction resolution saturation mass largest_speed write_delay cycle origin"
NOTICEABLE = 0.02  # of a force: by how much the service's report may differ, and N
SILENT = (
    "is the Haply service running, and its device plugged in? (a busy machine may be late: see"
    " `forcebound doctor`, or take a longer watchdog_limit)"
)

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class HaplyInverse3(  # pyright: ignore[reportIncompatibleVariableOverride]
    DriverNumbers, AxesModel
):
    """Parameters of a Haply Inverse3, driven through its maker's service of version 3.5.

    The maker publishes neither its largest force nor damping, friction and resolution: all are
    assumed. It is an arm, whose axes at the tip are coupled, so ``forcebound identify`` only makes
    these numbers more careful. The service's filters may give less than the force written, at any
    time.

    Attributes:
        axes: x, y and z of the service.
        port: Id of the device at the service; auto: the only one that it has; emulated; or the link
            of an emulator that was started by hand.
        service: Address of the service, for simulations and settings.
        origin: Position of the cursor, in the service's coordinates, that is 0 m here.
        basis: Permutation of the service's axes, of this session.
        force_gate: Gain of the service's filter against oscillations, of this session.
        torque_scaling: Whether the service scales torques. A setting of the device, which outlives
            the session: the driver sets it, and puts it back at the end.
        gravity_compensation: Whether the service carries the device's weight, to be compared with
            the device: a difference is refused.
        attenuates: What the service's filters may leave out of a force. One of them, against
            oscillations, cannot be switched off. never: what they leave out is in the service's
            current_cursor_force, which then takes the place of the written force in the ledger.
        cycle: Longest time by which a reading may be older than its request, and a force act later
            than its reply: a period of the service's exchange with the device.
        mass: Of the tip; of the emulator alone.
    """

    simulated_in: ClassVar[str] = "three_axes"  # launch file for virtual time
    has_coupled_axes: ClassVar[bool] = True

    axes: Literal[3] = 3
    damping: DampingOfAxes = (0.2, 0.2, 0.2)
    friction: FrictionOfAxes = (0.1, 0.1, 0.1)
    resolution: LengthOfAxes = 5e-5
    saturation: Annotated[Force, POSITIVE] = 5.0
    largest_speed: Annotated[Speed, POSITIVE] | None = 5.0
    write_delay: Annotated[Time, Range(at_least=0)] = 1.5e-3  # both exchanges, two cycles
    attenuates: Attenuates = "freely"
    service: Name = "localhost:10001"
    origin: tuple[Length, Length, Length] = (0.0, -0.12, 0.15)  # of the maker's example
    basis: Name = "XYZ"
    force_gate: Annotated[Ratio, Range(at_least=0, at_most=1)] = 0.0
    torque_scaling: bool = True
    gravity_compensation: bool = True
    cycle: Annotated[Time, Range(at_least=0)] = 3.3e-4  # 3 kHz, as SOFA's plug-in reports
    mass: Annotated[Mass, POSITIVE] = 0.1
    sources: Mapping[str, Source] = field(
        default_factory=lambda: dict.fromkeys(GUESSED.split(), "assumed"), hash=False
    )

    def check_here(self) -> None:
        if self.port != EMULATED:
            address = inverse_service.address_of(self.port, self.service)
            inverse_service.check_version(address)
            claim(chosen(inverse_service.devices(address), self.port), address).close()

    def open(self, operator: Operator | None, hold_limit: float) -> "OpenInverse3":
        kind, limit, opens = "haply_inverse3", self.longest_force, partial(Session, self)
        line = Line(
            kind, self.port, b"", limit, zero_reply=1, opens=opens, model=self, operator=operator
        )
        try:
            return OpenInverse3(self, line)
        except BaseException:
            line.close()
            raise


class OpenInverse3(SerialDevice):
    """An Inverse3 in a session of its own; DeviceError if it is not as the model states."""

    def __init__(
        self, model: HaplyInverse3, line: Line, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        exchanges = Exchanges(line, model.reply_within, clock, SILENT)
        super().__init__(line, exchanges, model.reply_within, clock)
        assert isinstance(line.port, Session)
        self._model, self._session = model, line.port
        self._cycle_ns = round(1e9 * model.cycle)
        self.axes = 3
        self._force = self._reported = NO_FORCE  # N, along the service's axes
        self._grip: Grip | None = None
        self._less = self._more = 0  # replies with less, or more, force than written
        exchanges.longest_wait = max(inverse_service.CONNECT, line.silence)
        for _ in range(FIRST_EXCHANGES):
            self._exchange()
        exchanges.longest_wait = line.silence
        exchanges.restart()
        if assumed := [name for name, source in model.sources.items() if source == "assumed"]:
            words = "assumed, not measured: %s; `forcebound identify haply_inverse3` tests them"
            _logger.warning(words, ", ".join(assumed))

    @property
    def serial_number(self) -> str:
        """Id of the device; empty if it is emulated."""
        return "" if self._line.truth is not None else self._session.device_id

    def read(self, time_ns: int) -> Vector:
        exchange = self._exchange()
        self._read_ns = exchange.sent_ns - self._cycle_ns
        self._jitter_ns = exchange.excess_ns + self._cycle_ns
        self._angles = exchange.reply
        asked, given = (math.hypot(*force) for force in (self._force, self._reported))
        asked *= self._session.force_scale
        self._less += given < (1.0 - NOTICEABLE) * asked - NOTICEABLE
        self._more += given > (1.0 + NOTICEABLE) * asked + NOTICEABLE
        return self._angles

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold a force, in N, or less."""
        if self._line.is_at_rest and not any(force):
            return force  # the last zero after a failure, which was written then
        is_finite = math.isfinite(math.hypot(*force))
        limited = saturated(force, self._model.saturation) if is_finite else NO_FORCE
        x, y, z = map(float, limited)  # numbers of numpy would be no JSON
        self._force = (-x, -y, -z)
        exchange = self._exchange()
        self._came_ns, self._angles = exchange.came_ns, exchange.reply
        self._effect_ns = exchange.sent_ns + exchange.excess_ns + self._cycle_ns
        if self._model.attenuates == "never":
            x, y, z = self._reported
            return (-x, -y, -z)
        scale = self._session.force_scale
        return (scale * x, scale * y, scale * z)

    def orientation(self) -> Quaternion | None:
        """Return that of the grip, if there is one."""
        if self._grip is None:
            return None
        w, x, y, z = (self._grip.state.orientation.get(name, 0.0) for name in "wxyz")
        return (w, x, y, z)

    def buttons(self) -> int | None:
        """Return those of the grip: one, or a, b and c."""
        if self._grip is None:
            return None
        named = self._grip.state.buttons
        down = [named[name] for name in sorted(named)] or [self._grip.state.button]
        return sum(is_down << place for place, is_down in enumerate(down))

    def close(self) -> None:
        self._line.close()
        self.exchanges.log(_logger)
        if self._less or self._more:
            words = "of the forces that the service reports, %d were less than written, %d more"
            _logger.warning(words, self._less, self._more)

    def _exchange(self) -> Exchange[Vector]:
        """Send the force; the reply has the position, in m."""
        try:
            if not self._line.has_failed:
                self._session.check()
        except DeviceError as failure:
            self._line.fail(failure)
            raise
        return self.exchanges.exchange(
            "exchange",
            framed(self._session.force(self._force)),
            lambda until_ns: self._session.read(0, until_ns),
            self._position,
            has_force=any(self._force),
        )

    def _position(self, data: bytes) -> Vector:
        """Return the position in a reply, in m; DeviceError if it is not that of this device."""
        message = self._session.state(data)
        state = message.inverse3[0].state
        at, force, origin = state.cursor_position, state.current_cursor_force, self._model.origin
        self._reported = (force.x, force.y, force.z)
        self._grip = next((grip for _, grip in message.grips), None)
        position = (at.x - origin[0], at.y - origin[1], at.z - origin[2])
        if not math.isfinite(math.hypot(*position, *self._reported)):
            raise DeviceError("the reply has a position or a force that is no number")
        return position
