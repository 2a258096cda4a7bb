"""Experiments: what a device is made to do, and what is seen of it.

All are done by the device's own motors, with nobody's hand on it. Forces begin small and grow, and
the limits of the rig stop whatever moves too fast or too far.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from forcebound.errors import DeviceError
from forcebound.lab.identification.drive import Drive, Profile, Ripple, Rough
from forcebound.lab.identification.estimators import Point
from forcebound.lab.identification.rig import Floats, Rig, Trace, come_to_rest, rest
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


SPEED_SAMPLES = 8  # to either side, of which a speed is taken
FEWEST = 8  # samples of a part


class Pass(NamedTuple):
    """One axis, moved once along its range at an even speed."""

    axis: int
    pose: int  # number of the pose of the others
    level: int  # number of the speed, from the slowest
    profile: Profile  # of its motion, as planned
    trace: Trace  # what happened


def start_to_move(rig: Rig, axis: int, side: int) -> float:
    """Return the force, in N (N m), at which an axis begins to move.

    A slow ramp pushes it in the direction ``side`` of its reading.

    Raises:
        DeviceError: If it does not move, moves the other way, or another axis moves instead.
    """
    start, distance = come_to_rest(rig), STARTED * rig.limits.reach
    steepness = -side * rig.limits.force / RAMP
    trace = rig.run(
        RAMP,
        lambda elapsed, reading: _along(rig.axes, axis, steepness * elapsed),
        lambda reading: bool(np.abs(start - reading).max() >= distance),
    )
    moved = trace.readings[-1] - start
    force = float(abs(trace.forces[-1, axis]))
    _check_motion(axis, side, moved, distance, force)
    rest(rig, STOPPING)
    return force


def _check_motion(axis: int, side: int, moved: Floats, distance: float, force: float) -> None:
    name, farthest = f"axis {axis + 1}", int(np.argmax(np.abs(moved)))
    if abs(moved[farthest]) < distance:
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


class Kick(NamedTuple):
    """An axis that was pushed evenly and then left to itself; all without sign."""

    force: float  # of the push, in N (N m)
    gained: float  # acceleration under the push, in m/s^2 (rad/s^2)
    lost: float  # deceleration without it
    pushed_speed: float  # mean speed under the push, in m/s (rad/s)
    speed: float  # mean speed while it coasted

    def inertia(self, damping: float) -> float:
        """Return that of the axis: friction slows both parts alike, damping the faster one more."""
        force = self.force + damping * (self.speed - self.pushed_speed)
        return force / (self.gained + self.lost)


def kick(rig: Rig, axis: int, side: int, started: float) -> Kick:
    """Push an axis, let it coast, and return force, accelerations and speeds.

    Args:
        rig: With the device.
        axis: To be pushed.
        side: 1 or -1.
        started: Force at which it begins to move, in N (N m).
    """
    start = come_to_rest(rig)
    force = min(max(KICK * started, 0.05 * rig.limits.force), rig.limits.force)
    distance = KICKED * rig.limits.reach
    pushed = rig.run(
        0.3,
        lambda elapsed, reading: _along(rig.axes, axis, -side * force),
        lambda reading: abs(reading[axis] - start[axis]) >= distance,
    )
    left = pushed.readings[-1, axis]
    coasted = rest(rig, COAST, lambda reading: abs(reading[axis] - left) >= 2.0 * distance)
    _brake(rig, axis, side, force)
    rest(rig, STOPPING)
    gone = np.abs(coasted.readings[:, axis] - coasted.readings[0, axis])
    moving = max(8, int(np.searchsorted(gone, 0.9 * gone[-1])))
    gained, pushed_speed = _parabola(pushed.read, pushed.readings[:, axis])
    lost, speed = _parabola(coasted.read[1:moving], coasted.readings[1:moving, axis])
    return Kick(force, gained, lost, pushed_speed, speed)


def _parabola(time: Floats, position: Floats) -> tuple[float, float]:
    """Return acceleration and mean speed, without sign, of the parabola nearest to a motion."""
    half, speed, _ = np.polyfit(time - time.mean(), position, 2)
    return float(abs(2.0 * half)), float(abs(speed))


def _brake(rig: Rig, axis: int, side: int, force: float) -> None:
    """Push against the motion of an axis until it has ended."""
    seen: list[float] = []

    def has_ended(reading: Vector) -> bool:
        seen.append(side * reading[axis])
        return len(seen) > BRAKE_TICKS and seen[-1] <= seen[-1 - BRAKE_TICKS]

    rig.run(0.3, lambda elapsed, reading: _along(rig.axes, axis, side * force), has_ended)


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


def there_and_back(
    drive: Drive, axis: int, reach: float, speed: float, count: int, pose: int = 0, level: int = 0
) -> list[Pass]:
    """Pass along the range of an axis at an even speed; the axis is at its lower end.

    Args:
        drive: Of the device.
        axis: To be moved.
        reach: To either side of the middle, in m (rad).
        speed: In m/s (rad/s).
        count: Of passes, even.
        pose: Number of the pose of the others.
        level: Number of the speed.
    """
    middle, found = drive.rig.start[axis], []
    for number in range(count):
        end = middle + (-reach if number % 2 else reach)
        found.append(Pass(axis, pose, level, *drive.pass_along(axis, end, speed)))
    return found


def strokes(drive: Drive, axis: int, speed: float, reach: float, count: int) -> list[Pass]:
    """Pass along the range of an axis, there and back, with a force that jumps.

    It makes the speed ripple, but never turn. Arguments as :func:`there_and_back`.
    """
    rig, middle, inertia = drive.rig, drive.rig.start[axis], drive.rough[axis].inertia
    drive.go(axis, middle - reach, speed)
    found = []
    for number in range(count):
        even = speed * (0.7 + 0.3 * ((number * GOLDEN) % 1.0))  # other steps of the encoder
        momentum = 2.0 * RIPPLE * even * inertia  # that the force between two jumps gives
        least = RIPPLE_TICKS + number // 2 % 4
        half = max(least, math.ceil(momentum / (0.5 * rig.limits.force) / rig.period))
        ripple = Ripple(momentum / (half * rig.period), half * rig.period)
        end = middle + (-reach if number % 2 else reach)
        found.append(Pass(axis, 0, 0, *drive.pass_along(axis, end, even, ripple)))
    drive.go(axis, middle, speed)
    return found


def pushes(drive: Drive, forces: Vector, count: int) -> Floats:
    """Push all axes below their friction and release them, at many places.

    Args:
        drive: Of the device.
        forces: Of each axis, in N (N m), less than its friction.
        count: How often; each time a little farther on.

    Returns:
        How far each axis came back, in m (rad), shape (count, axes).
    """
    found = []
    for number in range(count):
        _shift(drive, number)
        found.append(_push(drive, forces, 1.0 if number % 2 else -1.0))
    return np.array(found)


def _push(drive: Drive, forces: Vector, side: float) -> Floats:
    rig = drive.rig

    def pushed(seconds: float, share: Callable[[float], float]) -> Floats:
        """Mean readings while a share of the forces acts, which changes with the time."""
        trace = rig.run(seconds, lambda t, reading: tuple([-side * share(t) * f for f in forces]))
        return np.asarray(trace.readings.mean(axis=0))

    rest(rig, SETTLED)
    pushed(PUSH_RAMP, lambda elapsed: _smooth(elapsed / PUSH_RAMP))
    held = pushed(PUSH_LOOK, lambda elapsed: 1.0)
    pushed(PUSH_RAMP, lambda elapsed: _smooth(1 - elapsed / PUSH_RAMP))
    released = rest(rig, PUSH_LOOK).readings
    drive.take_over(rest(rig, rig.period).readings[-1].tolist())
    return np.asarray(side * (held - released.mean(axis=0)))


def _smooth(share: float) -> float:
    """From 0 to 1 without a corner, which would make an axis ring."""
    return 0.5 - 0.5 * math.cos(math.pi * min(max(share, 0.0), 1.0))


def _shift(drive: Drive, number: int) -> None:
    """Move every axis to another place, and so to another phase of its encoder."""
    rig = drive.rig
    for axis in range(rig.axes):
        place = rig.start[axis] + 0.4 * rig.limits.reach * (((number + 1) * GOLDEN) % 1.0 - 0.5)
        drive.pass_along(axis, place, 2.0 * rig.limits.reach)


def _along(axes: int, axis: int, force: float) -> Vector:
    return tuple([force if one == axis else 0.0 for one in range(axes)])


def rough_of(kicks: list[Kick], started: float) -> Rough:
    """Return inertia and friction of an axis, from kicks and the force at which it starts."""
    inertia = float(np.median([one.inertia(0.0) for one in kicks]))
    lost = float(np.median([one.lost for one in kicks]))
    return Rough(inertia, min(started, inertia * lost))


def points_of(passes: Sequence[Pass], low: float, high: float, parts: int) -> list[Point]:
    """Return a point for each pair of passes, there and back, and each part of the range.

    Args:
        passes: Of one axis, each followed by its way back.
        low: Least place, in m (rad).
        high: Largest place.
        parts: Of the range.
    """
    edges = np.linspace(low, high, parts + 1)
    points = []
    for there, back in zip(passes[::2], passes[1::2], strict=True):
        for part in range(parts):
            a, b = (_means(one, edges[part], edges[part + 1]) for one in (there, back))
            if a is not None and b is not None:
                speed, loss, gained = (0.5 * (a - b)).tolist()
                _, load, load_gained = (0.5 * (a + b)).tolist()
                points.append(Point((there.pose, part), speed, loss, load, gained, load_gained))
    return points


def _means(one: Pass, low: float, high: float) -> Floats | None:
    """Mean speed, force that moves the axis, and acceleration between two places.

    All are positive with positive motion. None: there are too few samples, or a late one.
    """
    trace, q = one.trace, one.trace.readings[:, one.axis]
    inside = np.flatnonzero((q >= low) & (q <= high))
    if inside.size < FEWEST or trace.late[inside[0] : inside[-1]].any():
        return None
    ends = [int(inside[0]), int(inside[-1])]
    given = np.interp(trace.read[ends], trace.effect, impulse_of(one))
    speeds = [_speed_at(trace.read, q, end) for end in ends]
    changes = [q[ends[1]] - q[ends[0]], given[0] - given[1], speeds[1] - speeds[0]]
    return np.asarray(np.array(changes) / (trace.read[ends[1]] - trace.read[ends[0]]))


def impulse_of(one: Pass) -> Floats:
    """Return the time integral of the force of a pass up to each of its effects, in N s (N m s)."""
    forces = one.trace.forces[:-1, one.axis]
    return np.concatenate([[0.0], np.cumsum(forces * np.diff(one.trace.effect))])


def _speed_at(time: Floats, q: Floats, index: int) -> float:
    part = slice(max(0, index - SPEED_SAMPLES), index + SPEED_SAMPLES + 1)
    return float(np.polyfit(time[part] - time[index], q[part], 1)[0])
