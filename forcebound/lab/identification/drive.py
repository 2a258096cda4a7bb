"""Driving a device along a path: position control with what is roughly known of each axis."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

from forcebound.lab.identification.rig import Controller, Rig, Trace, rest
from forcebound.messages.packets import Vector

BANDWIDTH = 60.0  # rad/s, of the position control
OBSERVER = 4.0  # times that: of the filter of position and speed
STEADY = 0.9  # share of the friction that is fed forward: less than all, or it would push at rest
SETTLE = 0.15  # s, until a controlled axis rests

Motion: TypeAlias = tuple[float, float, float]  # position, speed and acceleration of an axis


class Rough(NamedTuple):
    """Rough numbers of an axis, enough to drive it."""

    inertia: float  # kg (joints: kg m^2)
    friction: float  # N (N m)


class Profile:
    """A motion of one axis from place to place: even acceleration, even speed, even deceleration.

    From ``start`` to ``end``, in m (rad), with a ``speed``, in m/s (rad/s), in between, or less if
    the distance is too short; ``acceleration`` in m/s^2 (rad/s^2).
    """

    def __init__(self, start: float, end: float, speed: float, acceleration: float) -> None:
        self.start, self.end, self.acceleration = start, end, acceleration
        length = abs(end - start)
        self.top_speed = min(speed, math.sqrt(length * acceleration))
        self.rise = self.top_speed / acceleration  # s, until the speed is even
        self.duration = length / self.top_speed + self.rise if length else 0.0

    def is_even(self, elapsed: float) -> bool:
        """Return whether it has its even speed at a time, in s, since its start."""
        return self.rise <= elapsed <= self.duration - self.rise

    def at(self, elapsed: float) -> Motion:
        """Return the motion at a time, in s, since its start."""
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

    def force(self, elapsed: float, reading: float, motion: Motion) -> float:
        """Return the force, in N, positive against positive motion.

        Args:
            elapsed: Time since the run began, in s.
            reading: Now.
            motion: That it should have now.
        """
        dt = max(elapsed - self._elapsed, self._period)
        self._elapsed = elapsed
        decay = math.exp(-OBSERVER * BANDWIDTH * dt)
        # Predict with the acceleration that it should have: a filter without it lags.
        self._x += (self._v + 0.5 * self._a * dt) * dt
        self._v += self._a * dt
        miss = reading - self._x
        self._x += (1.0 - decay**2) * miss
        self._v += (1.0 - decay) ** 2 / dt * miss
        x, v, a = motion
        self._a = a
        rough = self._rough
        push = self._stiffness * (x - self._x) + self._loss * (v - self._v)
        push += rough.inertia * a
        return -(push + math.copysign(STEADY * rough.friction, v) if v else push)


class Ripple(NamedTuple):
    """A force that jumps up and down around that of the control.

    The first jump comes after half the time between two, so that the speed changes to both sides
    alike.
    """

    force: float  # N (N m), by which it jumps to either side
    half: float  # s, between two jumps

    def at(self, elapsed: float) -> float:
        """Return the force at a time since it began, in s."""
        return -self.force if int(elapsed / self.half + 0.5) % 2 else self.force


class Drive:
    """Moves the axes of a rig; ``rough``: what is known of each axis."""

    def __init__(self, rig: Rig, rough: Sequence[Rough]) -> None:
        self.rig = rig
        self.rough = list(rough)
        self.load = [0.0] * rig.axes  # N (N m), added to the force of the control
        self.goal: list[float] = []  # m (rad), where each axis is held
        self.take_over(rest(rig, rig.period).readings[-1])

    def acceleration(self, axis: int) -> float:
        """Return the acceleration of motions of an axis, in m/s^2 (rad/s^2)."""
        rough, most = self.rough[axis], 0.5 * self.rig.limits.force
        return max(min(4.0 * rough.friction, most - rough.friction), 0.2 * most) / rough.inertia

    def pass_along(
        self, axis: int, end: float, speed: float, ripple: Ripple | None = None
    ) -> tuple[Profile, Trace]:
        """Move one axis to a position, in m (rad), and hold the others; return profile and trace.

        A ripple is added while the axis should move at its even speed.
        """
        profile = Profile(self.goal[axis], end, speed, self.acceleration(axis))
        still = self._controller(
            lambda one, elapsed: profile.at(elapsed) if one == axis else (self.goal[one], 0.0, 0.0)
        )

        def rippled(elapsed: float, reading: Vector) -> Vector:
            forces = list(still(elapsed, reading))
            if ripple is not None and profile.is_even(elapsed):
                forces[axis] += ripple.at(elapsed - profile.rise)
            return tuple(forces)

        trace = self.rig.run(profile.duration, still if ripple is None else rippled)
        self.goal[axis] = end
        return profile, trace

    def go(self, axis: int, end: float, speed: float) -> Trace:
        """Move one axis, wait until it rests, and return the trace of the rest."""
        self.pass_along(axis, end, speed)
        return self.hold(SETTLE)

    def hold(self, seconds: float) -> Trace:
        """Hold all axes at their goals."""
        still = self._controller(lambda one, elapsed: (self.goal[one], 0.0, 0.0))
        return self.rig.run(seconds, still)

    def _controller(self, motion: Callable[[int, float], Motion]) -> Controller:
        """Forces that keep each axis on its motion, which is given by axis and time."""
        for follower in self._followers:
            follower.begin()

        def controller(elapsed: float, reading: Vector) -> Vector:
            axes = enumerate(zip(self._followers, reading, self.load, strict=True))
            return tuple(
                [load + one.force(elapsed, q, motion(i, elapsed)) for i, (one, q, load) in axes]
            )

        return controller

    def take_over(self, reading: Sequence[float]) -> None:
        """Hold the axes where they rest now: they were moved without control."""
        self.goal = list(reading)
        self._followers = [
            Follower(rough, self.rig.period, x)
            for rough, x in zip(self.rough, reading, strict=True)
        ]
