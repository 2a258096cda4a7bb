"""The simulated device whose motors an emulated board turns, and the hand on it."""

from dataclasses import replace
from functools import partial

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Truth
from forcebound.haptics.devices.simulated import SimulatedDevice, SimulatedModel, pad
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import NoHand
from forcebound.messages.packets import Vector

LARGEST_TORQUE = 1e6  # N m, no limit: the board has one
CARRY = 1.0  # s, to bring the tip from one place to another


class CarryingHand(Operator):
    """A hand that holds the tip in the pose of the set-up until it is sent elsewhere.

    A real arm is held in a known pose, ``home`` (m), while the board is set up, and only then
    brought to where the operator's path begins. All times are those of ``target``.
    """

    def __init__(self, operator: Operator, home: Vector) -> None:
        self.mass, self.stiffness = operator.mass, operator.stiffness
        self.damping, self.walls = operator.damping, operator.walls
        self.joint_limits, self.joint_stiffness = operator.joint_limits, operator.joint_stiffness
        self.joint_damping = operator.joint_damping
        self._operator = operator
        self.home, self.begin = home, pad(operator.target(0.0), len(home))
        self._from = self._to = home
        self._carried_at = -CARRY
        self._moves_at: float | None = None

    @property
    def is_home(self) -> bool:
        """True if the tip is held in the pose of the set-up, or brought there."""
        return self._to == self.home and self._moves_at is None

    def carry(self, elapsed: float, to: Vector) -> None:
        """Bring the tip to a place, in m, and hold it there."""
        self._from, self._to = self.target(elapsed), to
        self._carried_at = elapsed
        self._moves_at = None

    def move(self, elapsed: float) -> None:
        """Move along the path, as soon as the tip is where that begins."""
        if self._moves_at is None:
            self._moves_at = max(elapsed, self._carried_at + CARRY)

    def target(self, elapsed: float) -> Vector:
        if self._moves_at is not None and elapsed >= self._moves_at:
            return pad(self._operator.target(elapsed - self._moves_at), len(self.home))
        share = min(max((elapsed - self._carried_at) / CARRY, 0.0), 1.0)
        smooth = share * share * (3.0 - 2.0 * share)
        return tuple([a + smooth * (b - a) for a, b in zip(self._from, self._to, strict=True)])


class Mechanism:
    """A simulated device whose motors hold a board's torque until the board changes it.

    It has what its model states, as any simulated device. But its motors know no hold limit, the
    write delay is that of the line, and the largest torque that of the board.

    Without an operator nobody holds it. Then somebody puts it back into the pose of the set-up,
    whose tip is at ``home`` (m), when it is out of use; until then it stays in a singular pose,
    where a real arm lies against its stops.

    Attributes:
        angles: What the encoders read, in rad.
        torque: Commanded to the motors, in N m, positive towards larger angles.
        torque_ns: When that changed last, in ns.
    """

    def __init__(self, model: SimulatedModel, operator: Operator | None, home: Vector) -> None:
        free = replace(
            model,
            saturation=LARGEST_TORQUE,
            write_delay=0.0,
            watchdog="none",
            watchdog_limit="auto",
        )
        self._is_held = operator is not None
        self._is_stuck = self._is_away = False
        self._hand = CarryingHand(operator or NoHand(), home)
        self._new_device = partial(SimulatedDevice, free, self._hand, 1.0)
        self._device = self._new_device()
        self._start_ns = 0
        self.angles: Vector = (0.0,) * model.axes
        self.torque: Vector = (0.0,) * model.axes
        self.torque_ns = 0
        self._braking: Vector = (0.0,) * model.axes

    def start(self, time_ns: int) -> None:
        """Begin at this time, at rest."""
        self._start_ns = self.torque_ns = time_ns
        self._begin(time_ns)

    def _begin(self, time_ns: int) -> None:
        self.angles = self._device.read(time_ns)
        self._device.engage(time_ns)

    def advance(self, time_ns: int) -> None:
        """Move on under the torque; DeviceError if the hand has left where the arm can be held."""
        if self._is_stuck:
            return
        try:
            self.angles = self._device.read(time_ns)
        except DeviceError:
            if self._is_held:
                raise
            self._is_stuck = True

    def hold(self, time_ns: int, torque: Vector) -> None:
        """Hold a torque from now on, in N m."""
        if torque != self.torque:
            if not self._is_stuck:
                self._device.write(time_ns, tuple([-t for t in torque]))  # resists, where positive
            self.torque, self.torque_ns = torque, time_ns

    def brake(self, damping: Vector) -> None:
        """Let the motors brake, beside their torque, from now on, in N m s."""
        if damping != self._braking:
            self._device.brake(damping)
            self._braking = damping

    def truth(self) -> Truth:
        """Return the ground truth, at the tip."""
        return self._device.truth()

    def hold_home(self, time_ns: int) -> None:
        """Let the hand bring the tip to the pose of the set-up, if it is not there."""
        if not self._is_held:
            self._put_home(time_ns)
        elif not self._hand.is_home:
            self._hand.carry(self._elapsed(time_ns), self._hand.home)

    def use(self, time_ns: int, may_move: bool) -> None:
        """Let the hand bring the tip to where its path begins; ``may_move``: and move along it."""
        if not self._is_held:
            if not may_move:
                self._put_home(time_ns)
            self._is_away = may_move
            return
        if self._hand.is_home:
            self._hand.carry(self._elapsed(time_ns), self._hand.begin)
        if may_move:
            self._hand.move(self._elapsed(time_ns))

    def _put_home(self, time_ns: int) -> None:
        if self._is_away:
            self._is_away = self._is_stuck = False
            self._device = self._new_device()
            self._begin(time_ns)
            self._device.write(time_ns, tuple([-t for t in self.torque]))
            self._device.brake(self._braking)

    def _elapsed(self, time_ns: int) -> float:
        return (time_ns - self._start_ns) * 1e-9
