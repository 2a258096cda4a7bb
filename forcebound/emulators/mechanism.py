"""What an emulated board turns: a simulated device, in a hand, at the angles of its motors."""

from dataclasses import replace
from typing import Any

from forcebound.devices.simulated import SimulatedDevice
from forcebound.devices.truth import Truth
from forcebound.emulators.hand import CarryingHand
from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.operators.no_hand import NoHand

LARGEST_TORQUE = 1e6  # N m, no limit: the board has its own


class Mechanism:
    """A simulated device whose motors hold a board's torque until the board changes it.

    It has what its model states, as any simulated device. But its motors know no hold limit, the
    write delay is that of the line, and the largest torque that of the board.

    Args:
        model: A simulated device with a field for each of the stated imperfections.
        operator: Whose hand it is; None: nobody holds it.
        home: Where the tip is when the board is set up, in m.

    Attributes:
        angles: What the encoders read, in rad.
        torque: What the motors are told, in N m, positive towards larger angles.
        torque_ns: When that changed last, in ns.
    """

    def __init__(self, model: Any, operator: Operator | None, home: Vector) -> None:
        free = replace(
            model,
            saturation=LARGEST_TORQUE,
            write_delay=0.0,
            watchdog="none",
            watchdog_limit="auto",
        )
        self._hand = CarryingHand(operator or NoHand(), home)
        self._device = SimulatedDevice(free, self._hand, 1.0)
        self._start_ns = 0
        self.angles: Vector = (0.0,) * model.axes
        self.torque: Vector = (0.0,) * model.axes
        self.torque_ns = 0

    def start(self, time_ns: int) -> None:
        """Begin at this time, at rest."""
        self._start_ns = self.torque_ns = time_ns
        self.angles = self._device.read(time_ns)
        self._device.engage(time_ns)

    def advance(self, time_ns: int) -> None:
        """Move on under the torque that is held.

        Raises:
            DeviceError: If the hand has moved the tip to where the arm cannot be held.
        """
        self.angles = self._device.read(time_ns)

    def hold(self, time_ns: int, torque: Vector) -> None:
        """Hold a torque from now on, in N m."""
        if torque != self.torque:
            self._device.write(time_ns, tuple([-t for t in torque]))  # resists, where positive
            self.torque, self.torque_ns = torque, time_ns

    def truth(self) -> Truth:
        """Return the ground truth, at the tip."""
        return self._device.truth()

    def hold_home(self, time_ns: int) -> None:
        """Let the hand bring the tip to the pose of the set-up, if it is not there."""
        if not self._hand.is_home:
            self._hand.carry_home(self._elapsed(time_ns))

    def use(self, time_ns: int, may_move: bool) -> None:
        """Let the hand bring the tip to where its path begins; ``may_move``: and move along it."""
        if self._hand.is_home:
            self._hand.carry_out(self._elapsed(time_ns))
        if may_move:
            self._hand.move(self._elapsed(time_ns))

    def _elapsed(self, time_ns: int) -> float:
        return (time_ns - self._start_ns) * 1e-9
