"""The motor of a simulated device: when a written force begins to act, and when it ends."""

import math
from collections import deque
from random import Random

from forcebound.haptics.devices.true_values import TrueNumbers
from forcebound.haptics.laws.dissipation import StatedNumbers
from forcebound.messages.packets import Vector

NEVER = 1 << 62  # ns
LONGEST_GUARDED = 0.1  # s, if the device states no limit


class SimulatedMotor:
    """The force commanded of the motor, over time, per axis, in N.

    A written force acts after the write delay, in place of the one before. The watchdog drops a
    force that has acted for longer than the hold limit that held when it was written. A guarding
    one looks at that very instant, then once in each guard period, and drops the force at the look
    that sees an axis moved back: against the force, from where it was when the force began to act.
    """

    def __init__(
        self, stated: StatedNumbers, true: TrueNumbers, hold_limit: float, force: Vector
    ) -> None:
        self._zero: Vector = (0.0,) * len(force)
        self._delay_ns = round(1e9 * true.write_delay)
        self._tolerance = stated.watchdog_tolerance or 0.0
        self._share = true.watchdog
        self._random = None if true.seed is None else Random(true.seed)
        self._fixed_hold: float | None = None
        if stated.watchdog == "none":
            limit = stated.watchdog_limit
            self._fixed_hold = math.inf if limit == "auto" else limit
        self.guards = stated.watchdog == "guarding"
        self._guard_ns = round(1e9 * stated.guard_period)
        limit = stated.watchdog_limit
        self._longest_ns = round(1e9 * (LONGEST_GUARDED if limit == "auto" else limit))
        # When it begins to act, for how long, the commanded force, and what was written.
        self._waiting: deque[tuple[int, int, Vector, Vector]] = deque()
        self._drop_ns = self._last_ns = NEVER
        self._written = self._reference = self._zero
        self.force = force  # commanded now
        self.next_ns = NEVER  # when that changes next
        self.effect_ns = 0  # when the force of the last write acts
        self.cut_ns: int | None = None  # when the watchdog dropped a force after it
        self.set_hold_limit(hold_limit)

    def set_hold_limit(self, seconds: float) -> float:
        """Set the hold limit of the forces from the next write on, in s; return what was set."""
        self._hold_limit = seconds if self._fixed_hold is None else self._fixed_hold
        self._hold_ns = self._hold_of(self._share)
        return seconds

    def _hold_of(self, share: float) -> int:
        return round(min(share * self._hold_limit * 1e9, NEVER))

    def write(
        self, time_ns: int, commanded: Vector, written: Vector, reading: Vector, read_ns: int
    ) -> None:
        """Take a new force; every change before ``time_ns`` has been made.

        It is ``written``, and ``commanded`` of the motor, in N; a guarding watchdog looks at the
        ``reading`` of now. The write delay counts from ``read_ns``.
        """
        self.cut_ns = None
        delay_ns, hold_ns = self._delay_ns, self._hold_ns
        if self._random is not None:
            delay_ns = round(delay_ns * self._random.random())
            hold_ns = self._hold_of(1.0 + self._tolerance * self._random.uniform(-1.0, 1.0))
        # The order of writes is kept.
        self.effect_ns = max(read_ns + delay_ns, time_ns, self.effect_ns)
        self._waiting.append((self.effect_ns, hold_ns, commanded, written))
        if self.effect_ns == time_ns:
            self._begin(reading)
        self._plan()

    def change(self, reading: Vector) -> bool:
        """Make the change due at ``next_ns``; return whether the watchdog dropped a force."""
        is_cut = False
        if self._is_due():
            self._begin(reading)
        elif self.guards and self.next_ns < self._last_ns and not self._has_moved_back(reading):
            self._drop_ns = min(self.next_ns + self._guard_ns, self._last_ns)
        else:
            is_cut = True
            self.cut_ns, self._drop_ns, self.force = self._drop_ns, NEVER, self._zero
        self._plan()
        return is_cut

    def _has_moved_back(self, reading: Vector) -> bool:
        moves = zip(self._written, reading, self._reference, strict=True)
        return any(force * (now - then) < 0.0 for force, now, then in moves)

    def _is_due(self) -> bool:
        return bool(self._waiting) and self._waiting[0][0] <= self.next_ns

    def _begin(self, reading: Vector) -> None:
        effect_ns, hold_ns, self.force, self._written = self._waiting.popleft()
        self._reference = reading
        self._drop_ns = effect_ns + hold_ns
        self._last_ns = effect_ns + max(hold_ns, self._longest_ns)

    def _plan(self) -> None:
        self.next_ns = min(self._drop_ns, self._waiting[0][0] if self._waiting else NEVER)
