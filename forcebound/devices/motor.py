"""The motor of a simulated device: when a written force begins to act, and when it ends."""

from collections import deque
from typing import Protocol

from forcebound.devices.stated import Watchdog
from forcebound.messages.packets import Vector

NEVER = 1 << 62  # ns


class MotorModel(Protocol):
    """What the motor asks of a device's parameters; see ``stated.py``."""

    @property
    def axes(self) -> int:
        """Number of axes."""
        ...

    @property
    def write_delay(self) -> float:
        """From a write to the moment when its force acts, in s."""
        ...

    @property
    def watchdog(self) -> Watchdog:
        """What drops a force that is too old."""
        ...

    @property
    def watchdog_tolerance(self) -> float:
        """Share of the hold limit by which it may be late."""
        ...

    @property
    def watchdog_limit(self) -> float | None:
        """Age at which a force ends without a watchdog, in s; None: never."""
        ...


class Motor:
    """The force that the motor is told to give, over time.

    A written force acts after the write delay, in place of the one before. The watchdog drops a
    force that has acted for longer than the hold limit that held when it was written, as late as
    its tolerance permits.

    Attributes:
        force: What the motor is told to give now, per axis, in N.
        next_ns: When ``force`` changes next, in ns.
        effect_ns: When the force of the last write acts, in ns.
        cut_ns: When the watchdog dropped a force after the last write, in ns; None if it did not.
    """

    def __init__(self, model: MotorModel, hold_limit: float) -> None:
        self._zero: Vector = (0.0,) * model.axes
        self._delay_ns = round(model.write_delay * 1e9)
        self._hold_share = 1.0 + model.watchdog_tolerance
        self._fixed_hold_ns: int | None = None
        if model.watchdog == "none":
            limit = model.watchdog_limit
            self._fixed_hold_ns = NEVER if limit is None else round(limit * 1e9)
        self._waiting: deque[tuple[int, int, Vector]] = deque()  # effect, hold, force
        self._drop_ns = NEVER
        self.force = self._zero
        self.next_ns = NEVER
        self.effect_ns = 0
        self.cut_ns: int | None = None
        self.set_hold_limit(hold_limit)

    def set_hold_limit(self, seconds: float) -> None:
        """Set the hold limit of the forces from the next write on, in s."""
        hold_ns = self._fixed_hold_ns
        self._hold_ns = round(seconds * self._hold_share * 1e9) if hold_ns is None else hold_ns

    def write(self, time_ns: int, force: Vector) -> None:
        """Take a new force; ``time_ns`` is not before ``next_ns``'s last change."""
        self.cut_ns = None
        self.effect_ns = time_ns + self._delay_ns
        self._waiting.append((self.effect_ns, self._hold_ns, force))
        if self._delay_ns == 0:
            self._begin()
        self._plan()

    def change(self) -> bool:
        """Make the change that is due at ``next_ns``; return whether the watchdog made it."""
        is_cut = self._drop_ns == self.next_ns and not self._is_due()
        if is_cut:
            self.cut_ns, self._drop_ns, self.force = self._drop_ns, NEVER, self._zero
        else:
            self._begin()
        self._plan()
        return is_cut

    def _is_due(self) -> bool:
        return bool(self._waiting) and self._waiting[0][0] <= self.next_ns

    def _begin(self) -> None:
        effect_ns, hold_ns, self.force = self._waiting.popleft()
        self._drop_ns = effect_ns + hold_ns

    def _plan(self) -> None:
        self.next_ns = min(self._drop_ns, self._waiting[0][0] if self._waiting else NEVER)
