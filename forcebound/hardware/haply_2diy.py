"""The Haply 2DIY on its hAPI board: a five-bar of two motors, at a serial port.

How exchanges, stamps and the limits of torque work: docs/devices.md. A positive torque on the wire
turns towards larger angles; a positive torque of forcebound resists that. Both motors are counted
so, whatever the wiring.

What goes wrong ends in zero torque and a DeviceError, once: a reply that is short, of another
address, or not in whole counts; a board that was reset; unexpected bytes; silence for
half of the watchdog limit; a port that is gone; a guardian that is gone or had to step in
(:mod:`forcebound.hardware.line`). A late reply is counted and used: it makes a late tick, whose
force the ledger knows. Nothing can say that the arm is in its home pose when it is set up, but the
user who puts it there.
"""

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from forcebound.errors import DeviceError
from forcebound.haptics.devices.five_bar import DISTAL, PROXIMAL, FiveBarNumbers
from forcebound.haptics.hands import Operator
from forcebound.hardware.hapi import (
    LARGEST_TORQUE,
    REPLY_SIZE,
    WIRINGS,
    exchange_message,
    held_torque,
    parse_reply,
    rest_message,
    setup_message,
)
from forcebound.hardware.line import Line
from forcebound.hardware.serial_device import (
    FIRST_EXCHANGES,
    Exchange,
    Exchanges,
    SerialDevice,
    SerialJoints,
)
from forcebound.messages.packets import Vector
from forcebound.quantities import Range, Time

FIRST = 1.0  # s, what a board may need for its first reply
HOME_TOLERANCE = math.radians(1.0)  # the arm may move between set-up and first reading
# Sine of the angle between two links in line: no torque below the first, all of it above the other.
NO_FORCE_SINE, FULL_FORCE_SINE = 0.1, 0.3

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Haply2DIY(FiveBarNumbers, SerialJoints):
    """Parameters of a Haply 2DIY, versions 2 and 3, on a hAPI board.

    Its damping, friction and inertia are not published: ``forcebound identify`` measures them. The
    board has no watchdog: a guardian process ends a force that nobody renews.

    Attributes:
        version: Of the hardware; version 2 has both motors on one axis.
        address: Of the device on its board.
    """

    board: ClassVar[str] = "haply_2diy"
    simulated_in: ClassVar[str] = "five_bar_wall"  # launch file for virtual time

    write_delay: Annotated[Time, Range(at_least=0)] = 3e-4  # measured, with the emulator
    version: Literal[2, 3] = 3
    address: Annotated[int, Range(at_least=1, at_most=254)] = 5

    @property
    def links(self) -> tuple[float, float, float]:
        return PROXIMAL, DISTAL, WIRINGS[self.version].base

    def open(self, operator: Operator | None, hold_limit: float) -> "OpenHaply":
        rest = rest_message(self.address, WIRINGS[self.version])
        with self.line(rest, operator, reply=REPLY_SIZE) as line:
            return OpenHaply(self, line)


class OpenHaply(SerialDevice):
    """A Haply 2DIY on a line; DeviceError if the board does not answer as a hAPI board does."""

    def __init__(
        self, model: Haply2DIY, line: Line, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        exchanges = Exchanges(line, model.reply_within, clock)
        super().__init__(line, exchanges, model.reply_within, clock)
        self._model = model
        self._wiring = WIRINGS[model.version]
        self._torque: Vector = (0.0, 0.0)  # on the wire
        self.axes, self.kinematics, self._geometry = 2, model.kinematics(), model.geometry()
        line.send(setup_message(model.address, self._wiring), has_force=False)
        home = [math.radians(angle) for angle in self._wiring.home]
        exchanges.longest_wait = FIRST
        self._angles = self._exchange().reply
        exchanges.longest_wait = line.silence
        if math.dist(self._angles, home) > HOME_TOLERANCE:
            degrees = ", ".join(f"{math.degrees(angle):.1f}" for angle in self._angles)
            found = DeviceError(
                f"right after the set-up the board should report the home pose, {self._wiring.home}"
                f" degrees, but reports {degrees}: another firmware, or another version of the"
                " device (version: 2 or 3)"
            )
            self._line.fail(found)
            raise found
        for _ in range(FIRST_EXCHANGES):
            self._exchange()
        exchanges.restart()
        tip = ", ".join(f"{1e3 * x:.1f} mm" for x in self._geometry.position(self._angles))
        _logger.info("the present pose of the arm is now its home pose, its tip at %s", tip)

    def read(self, time_ns: int) -> Vector:
        exchange = self._exchange()
        self._read_ns, self._jitter_ns = exchange.sent_ns, exchange.excess_ns
        self._angles = exchange.reply
        return self._angles

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold torques, in N m, or less."""
        if self._line.is_at_rest and not any(force):
            return force  # the last zero after a failure, which was written then
        scale = self._scale(force)
        scaled = tuple([scale * torque for torque in force]) if scale > 0.0 else (0.0, 0.0)
        self._torque = tuple([-torque for torque in scaled])
        exchange = self._exchange()
        self._came_ns, self._angles = exchange.came_ns, exchange.reply
        self._effect_ns = exchange.sent_ns + exchange.excess_ns
        return tuple([held_torque(torque) for torque in scaled])

    def close(self) -> None:
        self._line.close()
        self.exchanges.log(_logger)

    def _exchange(self) -> Exchange[Vector]:
        """Send the torque; the reply has the angles, in rad."""
        address = self._model.address
        return self.exchanges.exchange(
            "exchange",
            exchange_message(address, self._torque),
            lambda until_ns: self._line.port.read(REPLY_SIZE, until_ns),
            lambda reply: parse_reply(reply, address, self._wiring),
            has_force=any(self._torque),
        )

    def _scale(self, force: Vector) -> float:
        """Return the share of a torque, in N m, that is applied in this pose, 0 to 1."""
        if not math.isfinite(math.hypot(*force)):
            return 0.0
        largest = max(map(abs, force))
        sine = link_sine(self._geometry.jacobian(self._angles), PROXIMAL)
        fading = (sine - NO_FORCE_SINE) / (FULL_FORCE_SINE - NO_FORCE_SINE)
        if largest == 0.0 or fading <= 0.0:
            return 0.0
        within = self._model.saturation / math.hypot(*force)
        return min(1.0, fading, LARGEST_TORQUE / largest, within)


def link_sine(jacobian: tuple[Vector, ...], proximal: float) -> float:
    """Return the least sine of the angles between links that meet: at the tip, at both elbows.

    A column of the Jacobian (m/rad; zeros: a singular pose) is at right angles to the distal link
    of the other side, so the angle at the tip is that of the columns; the length of column k is
    :math:`l s_k / s`, with the length l of the ``proximal`` links and the sines :math:`s_k` at its
    elbow and :math:`s` at the tip.
    """
    (xx, xy), (yx, yy) = jacobian
    right, left = math.hypot(xx, yx), math.hypot(xy, yy)
    if right == 0.0 or left == 0.0:
        return 0.0
    tip = abs(xx * yy - xy * yx) / (right * left)
    return min(tip, tip * right / proximal, tip * left / proximal)
