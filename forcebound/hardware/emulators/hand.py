"""The hand on an emulated device: it holds, carries, and then moves as an operator does."""

from forcebound.haptics.devices.simulated import pad
from forcebound.haptics.hands import Operator
from forcebound.messages.packets import Vector

CARRY = 1.0  # s, to bring the tip from one place to another


class CarryingHand(Operator):
    """A hand that holds the tip in the pose of the set-up until it is sent elsewhere.

    A real arm is held in a known pose, ``home`` (m), while the board is set up, and only then
    brought to where the operator's path begins. All times are those of ``target``.
    """

    def __init__(self, operator: Operator, home: Vector) -> None:
        self.mass, self.stiffness = operator.mass, operator.stiffness
        self.damping = operator.damping
        self._operator = operator
        self._home = home
        self._begin = pad(operator.target(0.0), len(home))
        self._from = self._to = home
        self._carried_at = -CARRY
        self._moves_at: float | None = None

    @property
    def is_home(self) -> bool:
        """Whether the tip is held in the pose of the set-up, or brought there."""
        return self._to == self._home and self._moves_at is None

    def carry_out(self, elapsed: float) -> None:
        """Bring the tip to where the path begins."""
        self._carry(elapsed, self._begin)

    def carry_home(self, elapsed: float) -> None:
        """Bring the tip back to the pose of the set-up."""
        self._carry(elapsed, self._home)

    def move(self, elapsed: float) -> None:
        """Move along the path, as soon as the tip is where that begins."""
        if self._moves_at is None:
            self._moves_at = max(elapsed, self._carried_at + CARRY)

    def target(self, elapsed: float) -> Vector:
        if self._moves_at is not None and elapsed >= self._moves_at:
            return pad(self._operator.target(elapsed - self._moves_at), len(self._home))
        share = min(max((elapsed - self._carried_at) / CARRY, 0.0), 1.0)
        smooth = share * share * (3.0 - 2.0 * share)
        return tuple([a + smooth * (b - a) for a, b in zip(self._from, self._to, strict=True)])

    def _carry(self, elapsed: float, to: Vector) -> None:
        self._from, self._to = self.target(elapsed), to
        self._carried_at = elapsed
        self._moves_at = None
