"""Driving a device along a path: position control with what is roughly known of each axis."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from forcebound.identification.rig import Controller, Rig, Trace, rest
from forcebound.identification.stalls import Result, recover, repeated
from forcebound.messages.packets import Vector

BANDWIDTH = 60.0  # rad/s, of the position control
OBSERVER = 4.0  # times that: of the filter of position and speed
STEADY = 0.9  # share of the friction that is fed forward: less than all, or it would push at rest
SETTLE = 0.15  # s, until a controlled axis rests


@dataclass(frozen=True)
class Rough:
    """What is roughly known of an axis, enough to drive it.

    Attributes:
        inertia: In kg (joints: kg m^2).
        friction: In N (N m).
        damping: In N s/m (N m s).
    """

    inertia: float
    friction: float
    damping: float = 0.0


@dataclass(frozen=True)
class Way:
    """A straight way of one axis: even acceleration, even speed, even deceleration.

    Attributes:
        start: In m (rad).
        end: In m (rad).
        speed: In between, in m/s (rad/s), > 0; less if the way is too short.
        acceleration: In m/s^2 (rad/s^2), > 0.
    """

    start: float
    end: float
    speed: float
    acceleration: float

    @cached_property
    def top_speed(self) -> float:
        """Speed that is reached, in m/s."""
        return min(self.speed, math.sqrt(abs(self.end - self.start) * self.acceleration))

    @cached_property
    def duration(self) -> float:
        """In s."""
        top = self.top_speed
        if top == 0.0:
            return 0.0
        return abs(self.end - self.start) / top + top / self.acceleration

    @cached_property
    def rise(self) -> float:
        """Time until the speed is even, in s."""
        return self.top_speed / self.acceleration

    def is_even(self, elapsed: float) -> bool:
        """Return whether it has its even speed at a time, in s, since its start."""
        return self.rise <= elapsed <= self.duration - self.rise

    def at(self, elapsed: float) -> tuple[float, float, float]:
        """Return position, speed and acceleration at a time, in s, since its start."""
        side, top, total = math.copysign(1.0, self.end - self.start), self.top_speed, self.duration
        steep, rise = side * self.acceleration, self.rise
        if elapsed >= total:
            return self.end, 0.0, 0.0
        if elapsed < rise:
            return self.start + 0.5 * steep * elapsed**2, steep * elapsed, steep
        rest = total - elapsed
        if rest < rise:
            return self.end - 0.5 * steep * rest**2, steep * rest, -steep
        return self.start + side * top * (elapsed - 0.5 * rise), side * top, 0.0


class Follower:
    """Control of one axis: a filter of position and speed, stiffness, damping, what is known.

    Args:
        rough: Of the axis.
        period: In s.
        reading: At the start, at rest.
    """

    def __init__(self, rough: Rough, period: float, reading: float) -> None:
        self._rough, self._period, self._elapsed = rough, period, -period
        self._x, self._v, self._a = reading, 0.0, 0.0
        self._stiffness = rough.inertia * BANDWIDTH**2
        self._loss = 2.0 * rough.inertia * BANDWIDTH

    def begin(self) -> None:
        """Begin a run: its time counts from 0."""
        self._elapsed = -self._period

    def force(self, elapsed: float, reading: float, wanted: tuple[float, float, float]) -> float:
        """Return the force, in N, positive against positive motion.

        Args:
            elapsed: Time since the run began, in s.
            reading: Now.
            wanted: Position, speed and acceleration.
        """
        dt = max(elapsed - self._elapsed, self._period)
        self._elapsed = elapsed
        decay = math.exp(-OBSERVER * BANDWIDTH * dt)
        # Predict with the acceleration that is wanted: a filter without it lags when that changes.
        self._x += (self._v + 0.5 * self._a * dt) * dt
        self._v += self._a * dt
        miss = reading - self._x
        self._x += (1.0 - decay**2) * miss
        self._v += (1.0 - decay) ** 2 / dt * miss
        x, v, a = wanted
        self._a = a
        rough = self._rough
        push = self._stiffness * (x - self._x) + self._loss * (v - self._v)
        push += rough.inertia * a + rough.damping * v
        if v:
            push += math.copysign(STEADY * rough.friction, v)
        return -push


@dataclass(frozen=True)
class Ripple:
    """A force that jumps up and down around that of the control.

    Attributes:
        force: By which it jumps to either side, in N (N m).
        half: Time between two jumps, in s; the first comes after half of it, so that the speed
            changes to both sides alike.
    """

    force: float
    half: float

    def at(self, elapsed: float) -> float:
        """Return the force at a time since it began, in s."""
        return -self.force if int(elapsed / self.half + 0.5) % 2 else self.force


class Drive:
    """Moves the axes of a rig.

    Args:
        rig: With the device.
        rough: What is known of each axis.

    Attributes:
        load: Force of each axis that is added to that of the control, in N (N m).
    """

    def __init__(self, rig: Rig, rough: Sequence[Rough]) -> None:
        self.rig = rig
        self.rough = list(rough)
        self.load = [0.0] * rig.axes
        self.wanted: list[float] = []
        self.take_over(rest(rig, rig.period).readings[-1])

    def acceleration(self, axis: int) -> float:
        """Return the acceleration of ways of an axis, in m/s^2 (rad/s^2)."""
        rough, most = self.rough[axis], 0.5 * self.rig.limits.force
        return max(min(4.0 * rough.friction, most - rough.friction), 0.2 * most) / rough.inertia

    def pass_along(
        self, axis: int, end: float, speed: float, ripple: Ripple | None = None
    ) -> tuple[Way, Trace]:
        """Move one axis to a position, in m (rad), and hold the others; return way and trace.

        A ripple is added while the axis should move at its even speed.
        """
        return self.steadily(lambda: self._pass_along(axis, end, speed, ripple))

    def _pass_along(
        self, axis: int, end: float, speed: float, ripple: Ripple | None = None
    ) -> tuple[Way, Trace]:
        way = Way(self.wanted[axis], end, speed, self.acceleration(axis))

        def wanted(one: int, elapsed: float) -> tuple[float, float, float]:
            return way.at(elapsed) if one == axis else (self.wanted[one], 0.0, 0.0)

        still = self._controller(wanted)

        def rippled(elapsed: float, reading: Vector) -> Vector:
            forces = list(still(elapsed, reading))
            if ripple is not None and way.is_even(elapsed):
                forces[axis] += ripple.at(elapsed - way.rise)
            return tuple(forces)

        trace = self.rig.run(way.duration, still if ripple is None else rippled)
        self.wanted[axis] = end
        return way, trace

    def go(self, axis: int, end: float, speed: float) -> Trace:
        """Move one axis, wait until it rests, and return the trace of the rest."""
        self.pass_along(axis, end, speed)
        return self.hold(SETTLE)

    def hold(self, seconds: float) -> Trace:
        """Hold all axes where they are wanted."""
        return self.steadily(lambda: self._hold(seconds))

    def steadily(self, movement: Callable[[], Result]) -> Result:
        """Return what a movement gives; after a stall of the machine it begins anew.

        Raises:
            DeviceError: If the machine stalls each time.
        """
        begin = list(self.wanted)
        return repeated(self.rig, movement, lambda: self._return(begin))

    def _return(self, begin: Sequence[float]) -> None:
        """Go to where a movement begins, from wherever a stall has left the device."""
        rig = self.rig
        limits, place = rig.limits, recover(rig)
        farthest = max(abs(a - b) for a, b in zip(place, rig.start, strict=True))
        self.take_over(place)
        rig.limits = replace(limits, reach=limits.reach + farthest)
        try:
            for axis, end in enumerate(begin):
                self._pass_along(axis, end, limits.reach)  # in about 1 s
            self._hold(SETTLE)
        finally:
            rig.limits = limits

    def _hold(self, seconds: float) -> Trace:
        still = self._controller(lambda one, elapsed: (self.wanted[one], 0.0, 0.0))
        return self.rig.run(seconds, still)

    def _controller(self, wanted: Callable[[int, float], tuple[float, float, float]]) -> Controller:
        """Forces that keep each axis where it is wanted at a time."""
        for follower in self._followers:
            follower.begin()

        def controller(elapsed: float, reading: Vector) -> Vector:
            axes = enumerate(zip(self._followers, reading, self.load, strict=True))
            return tuple(
                [load + one.force(elapsed, q, wanted(i, elapsed)) for i, (one, q, load) in axes]
            )

        return controller

    def take_over(self, reading: Sequence[float]) -> None:
        """Begin anew from where the axes rest: they were moved without control."""
        self.wanted = list(reading)
        self._followers = self._new(self.wanted)

    def _new(self, readings: Sequence[float]) -> list[Follower]:
        return [
            Follower(rough, self.rig.period, reading)
            for rough, reading in zip(self.rough, readings, strict=True)
        ]
