"""Experiments: what a device is made to do, and what is seen of it.

All are done by the device's own motors, with nobody's hand on it. Forces begin small and grow, and
the limits of the rig stop whatever moves too fast or too far.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from forcebound.errors import DeviceError
from forcebound.identification.drive import Drive, Ripple, Rough, Way
from forcebound.identification.rig import Controller, Floats, Rig, Trace, come_to_rest, rest
from forcebound.messages.packets import Vector

RAMP = 1.5  # s, from no force to the largest
STARTED = 0.02  # share of the reach that is a motion, not the yielding of friction
KICKED = 0.1  # share of the reach over which an axis is accelerated
KICK = 3.0  # times the force at which the axis began to move
COAST = 0.06  # s
BRAKE_TICKS = 3
STOPPING = 0.2  # s
SETTLED, PUSH_RAMP, PUSH_LOOK = 0.15, 0.3, 0.3  # s; an axis rings on friction that yields
RIPPLE = 0.6  # share of the speed
RIPPLE_TICKS = 6  # between two jumps, or more
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # places that repeat late


@dataclass(frozen=True)
class Pass:
    """One axis, moved once along its range at an even speed.

    Attributes:
        axis: That was moved.
        pose: Number of the pose of the others.
        level: Number of the speed, from the slowest.
        side: 1 or -1.
        way: That was wanted.
        trace: What happened.
    """

    axis: int
    pose: int
    level: int
    side: int
    way: Way
    trace: Trace


@dataclass(frozen=True)
class Push:
    """A push below the friction, and its release.

    Attributes:
        forces: Of each axis, without sign, in N (N m).
        yielded: How far each axis came back, in m (rad).
    """

    forces: Vector
    yielded: Vector


def start_to_move(rig: Rig, axis: int, side: int) -> float:
    """Return the force, in N (N m), at which an axis begins to move.

    A slow ramp pushes it in the direction ``side`` of its reading.

    Raises:
        DeviceError: If it does not move, moves the other way, or another axis moves instead.
    """
    start = come_to_rest(rig, rig.limits.reach)
    way, most = STARTED * rig.limits.reach, rig.limits.force

    def controller(elapsed: float, reading: Vector) -> Vector:
        return _along(rig.axes, axis, -side * most * elapsed / RAMP)

    def has_moved(reading: Vector) -> bool:
        return bool(np.abs(start - reading).max() >= way)

    trace = rig.run(RAMP, controller, has_moved)
    moved = trace.readings[-1] - start
    force = float(abs(trace.forces[-1, axis]))
    _check_motion(axis, side, moved, way, force)
    rest(rig, STOPPING)
    return force


def _check_motion(axis: int, side: int, moved: Floats, way: float, force: float) -> None:
    name, farthest = f"axis {axis + 1}", int(np.argmax(np.abs(moved)))
    if abs(moved[farthest]) < way:
        raise DeviceError(
            f"{name} does not move at a force of {force:.3g}: is the motor on, is the axis free? A"
            " larger --force lets it push harder"
        )
    if farthest != axis:
        raise DeviceError(
            f"the motor of {name} moves axis {farthest + 1}: motors or encoders are swapped"
        )
    if moved[axis] * side < 0.0:
        raise DeviceError(
            f"the torque scale of {name} has the wrong sign: a force that should move its reading"
            f" {'up' if side > 0 else 'down'} moved it the other way. Change the sign of the motor"
            " or of the encoder; with this one, every wall would pull the hand in"
        )


@dataclass(frozen=True)
class Kick:
    """An axis that was pushed evenly and then left to itself.

    Attributes:
        force: Of the push, without sign, in N (N m).
        gained: Acceleration under the push, in m/s^2 (rad/s^2).
        lost: Deceleration without it.
        pushed_speed: Mean speed under the push, in m/s (rad/s).
        speed: Mean speed while it coasted.
    """

    force: float
    gained: float
    lost: float
    pushed_speed: float
    speed: float

    def inertia(self, damping: float) -> float:
        """Return that of the axis: friction slows both parts alike, damping the faster one more."""
        force = self.force + damping * (self.speed - self.pushed_speed)
        return force / (self.gained + self.lost)


def kick(rig: Rig, axis: int, side: int, started: float) -> Kick:
    """Push an axis, let it coast, and return what both say.

    Args:
        rig: With the device.
        axis: To be pushed.
        side: 1 or -1.
        started: Force at which it begins to move, in N (N m).
    """
    start = come_to_rest(rig, rig.limits.reach)
    force = min(max(KICK * started, 0.05 * rig.limits.force), rig.limits.force)
    way = KICKED * rig.limits.reach
    pushed = rig.run(
        0.3,
        lambda elapsed, reading: _along(rig.axes, axis, -side * force),
        lambda reading: abs(reading[axis] - start[axis]) >= way,
    )
    left = pushed.readings[-1, axis]
    coasted = rest(rig, COAST, lambda reading: abs(reading[axis] - left) >= 2.0 * way)
    _brake(rig, axis, side, force)
    gained, pushed_speed = curvature(pushed.read, pushed.readings[:, axis])
    gone = np.abs(coasted.readings[:, axis] - coasted.readings[0, axis])
    moving = max(8, int(np.searchsorted(gone, 0.9 * gone[-1])))
    lost, speed = curvature(coasted.read[1:moving], coasted.readings[1:moving, axis])
    return Kick(force, abs(gained), abs(lost), abs(pushed_speed), abs(speed))


def _brake(rig: Rig, axis: int, side: int, force: float) -> None:
    """Push against the motion of an axis until it has ended."""
    seen: list[float] = []

    def has_ended(reading: Vector) -> bool:
        seen.append(side * reading[axis])
        return len(seen) > BRAKE_TICKS and seen[-1] <= seen[-1 - BRAKE_TICKS]

    rig.run(0.3, lambda elapsed, reading: _along(rig.axes, axis, side * force), has_ended)


def curvature(time: Floats, position: Floats) -> tuple[float, float]:
    """Return acceleration and mean speed of the parabola nearest to a motion."""
    t = time - time.mean()
    design = np.stack([np.ones_like(t), t, 0.5 * t * t], axis=1)
    _, speed, acceleration = np.linalg.lstsq(design, position, rcond=None)[0]
    return float(acceleration), float(speed)


def centre(drive: Drive, middle: Vector, speeds: list[float]) -> None:
    """Bring every axis to the middle, one after the other; from now on the reach counts from there.

    They may be far from it, where a device is set up, so only the way there limits the reach.
    """
    rig = drive.rig
    farthest = max(abs(a - b) for a, b in zip(rig.start, middle, strict=True))
    rig.limits = replace(rig.limits, reach=rig.limits.reach + farthest)
    for axis in range(rig.axes):
        drive.go(axis, middle[axis], speeds[axis])
    rig.start = middle


def strokes(drive: Drive, axis: int, speed: float, reach: float, count: int) -> list[Pass]:
    """Pass along the range of an axis, there and back, with a force that jumps.

    It makes the speed ripple, but never turn.

    Args:
        drive: Of the device.
        axis: To be moved.
        speed: In m/s (rad/s).
        reach: To either side of the middle, in m (rad).
        count: Of strokes.
    """
    rig, middle, inertia = drive.rig, drive.rig.start[axis], drive.rough[axis].inertia
    drive.go(axis, middle - reach, speed)
    found = []
    for number in range(count):
        side = -1 if number % 2 else 1
        even = speed * (
            0.7 + 0.3 * ((number * GOLDEN) % 1.0)
        )  # meets the encoder's steps elsewhere
        momentum = 2.0 * RIPPLE * even * inertia  # that the force between two jumps gives
        least = RIPPLE_TICKS + number // 2 % 4
        half = max(least, math.ceil(momentum / (0.5 * rig.limits.force) / rig.period))
        ripple = Ripple(momentum / (half * rig.period), half * rig.period)
        way, trace = drive.pass_along(axis, middle + side * reach, even, ripple)
        found.append(Pass(axis, 0, 0, side, way, trace))
    drive.go(axis, middle, speed)
    return found


def pushes(drive: Drive, forces: Vector, count: int) -> list[Push]:
    """Push all axes below their friction and release them, at many places.

    Args:
        drive: Of the device.
        forces: Of each axis, in N (N m), less than its friction.
        count: How often; each time a little farther on.
    """
    found = []
    for number in range(count):
        _shift(drive, number)
        side = 1.0 if number % 2 else -1.0
        found.append(drive.steadily(partial(_push, drive, forces, side)))
    return found


def _push(drive: Drive, forces: Vector, side: float) -> Push:
    rig = drive.rig

    def pushed(seconds: float, share: Callable[[float], float]) -> Trace:
        # It cannot move an axis, however long it is on.
        return rig.run(seconds, _pushing(forces, side, share), stalled=math.inf)

    rest(rig, SETTLED)
    pushed(PUSH_RAMP, lambda elapsed: _smooth(elapsed / PUSH_RAMP))
    held = pushed(PUSH_LOOK, lambda elapsed: 1.0)
    pushed(PUSH_RAMP, lambda elapsed: _smooth(1 - elapsed / PUSH_RAMP))
    released = rest(rig, PUSH_LOOK).readings.mean(axis=0)
    drive.take_over(rest(rig, rig.period).readings[-1])
    return Push(forces, tuple((side * (held.readings.mean(axis=0) - released)).tolist()))


def _pushing(forces: Vector, side: float, share: Callable[[float], float]) -> Controller:
    """Forces of which a share acts, which changes with the time."""
    return lambda elapsed, reading: tuple([-side * share(elapsed) * force for force in forces])


def _smooth(share: float) -> float:
    """From 0 to 1 without a corner, which would make an axis ring."""
    return 0.5 - 0.5 * math.cos(math.pi * min(max(share, 0.0), 1.0))


def _shift(drive: Drive, number: int) -> None:
    """Move every axis to another place, and so to another phase of its encoder."""
    rig = drive.rig
    for axis in range(rig.axes):
        place = rig.start[axis] + 0.4 * rig.limits.reach * (((number + 1) * GOLDEN) % 1.0 - 0.5)
        speed = 2.0 * rig.limits.reach
        drive.pass_along(axis, place, speed)


def _along(axes: int, axis: int, force: float) -> Vector:
    return tuple([force if one == axis else 0.0 for one in range(axes)])


def rough_of(kicks: list[Kick], started: float) -> Rough:
    """Return what kicks and the force at which an axis starts say of it."""
    inertia = float(np.median([one.inertia(0.0) for one in kicks]))
    lost = float(np.median([one.lost for one in kicks]))
    return Rough(inertia, min(started, inertia * lost))
