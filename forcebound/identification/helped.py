"""Experiments that need the user's hands: a hanging weight, and the fastest motion by hand.

Both are optional. The user is told what to do; that it is done is seen in forces and readings, for
the hands are busy. What is not done in time stays unmeasured, and is said.
"""

import math
from collections.abc import Callable

import numpy as np

from forcebound.errors import DeviceError
from forcebound.identification.drive import Drive
from forcebound.identification.estimators import Bounded, Floats, student
from forcebound.identification.experiments import Pass
from forcebound.identification.rig import SPEED_TICKS, Limits, Rig, Trace, rest
from forcebound.identification.windows import points_of

PATIENCE = 120.0  # s, for the user
LOOK = 1.0  # s, for which a weight hangs still
HANGS = 0.4  # share of its force that the motor then holds, or more
STILL = 0.1  # share of it by which the force may change meanwhile
LIGHTEST = 2.0  # times the friction
HEAVIEST = 0.6  # share of the largest force
PARTS, PAIRS = 3, 4  # of the range, of passes
EVEN = 0.8  # share of the range, without the turning
GIVEN = 0.01  # share by which the weight may be another than the user says
UNSEEN = 1.25  # times the largest speed that was seen

Say = Callable[[str], None]


def gain(
    drive: Drive, axis: int, weight: float, friction: float, way: tuple[float, float], say: Say
) -> Bounded | None:
    """Return what a motor gives over what it is told; None if the weight was not hung.

    Slow passes, with the weight and without: the mean of what both directions need differs by the
    weight, whatever the friction.

    Args:
        drive: Of the device.
        axis: Whose motor it is.
        weight: Force of the weight on the axis, in N (N m).
        friction: Of the axis, in N (N m).
        way: Reach of the passes to either side, in m (rad), and their speed, in m/s (rad/s).
        say: Tells the user what to do.

    Raises:
        DeviceError: If the axis does not move evenly.
    """
    name = f"axis {axis + 1}"
    least, most = LIGHTEST * friction, HEAVIEST * drive.rig.limits.force
    if not least <= weight <= most:
        say(
            f"{name}: the weight pulls with {weight:.3g}; it should be {least:.3g} ({LIGHTEST:g}"
            f" times the friction) to {most:.3g} ({HEAVIEST:g} of --force): gain not measured"
        )
        return None
    without = _loads(drive, axis, *way)
    nothing = -float(without.mean())
    say(
        f"{name}: the motor holds. Hang the weight so that it pulls with {weight:.3g} at this axis"
        f" alone, either way, and let go; within {PATIENCE:.0f} s"
    )
    held = _wait(drive, axis, lambda force: abs(force - nothing) >= HANGS * weight, weight)
    if held is None:
        say(f"{name}: no weight was seen to hang: gain not measured")
        return None
    drive.load[axis] = held
    hanging = _loads(drive, axis, *way)
    say(f"{name}: take the weight off; within {PATIENCE:.0f} s")
    drive.load[axis] = 0.0
    _wait(drive, axis, lambda force: abs(force - nothing) < HANGS * weight, weight)
    told = np.abs(hanging - without.mean(axis=0))
    mean = float(told.mean())
    error = student(told.size - 1) * float(told.std(ddof=1)) * math.sqrt(2.0 / told.size)
    error += GIVEN * mean
    return Bounded(weight / mean, weight / (mean + error), weight / max(mean - error, 1e-3 * mean))


def _loads(drive: Drive, axis: int, half: float, speed: float) -> Floats:
    """Return the push that the place needs: a row for each pair of passes, a column for a part."""
    middle = drive.rig.start[axis]
    drive.go(axis, middle - half, speed)
    passes = []
    for number in range(2 * PAIRS):
        side = -1 if number % 2 else 1
        way, trace = drive.pass_along(axis, middle + side * half, speed)
        passes.append(Pass(axis, 0, 0, side, way, trace))
    drive.go(axis, middle, speed)
    inner = EVEN * half
    points = points_of(passes, middle - inner, middle + inner, PARTS)
    if len(points) < PARTS * PAIRS:
        raise DeviceError(
            f"axis {axis + 1}: {len(points)} of {PARTS * PAIRS} parts of passes can be used: it did"
            " not follow its way, or ticks were late; see `forcebound doctor`"
        )
    inertia = drive.rough[axis].inertia
    return np.array([one.at_rest(inertia).load for one in points]).reshape(PAIRS, PARTS)


def _wait(drive: Drive, axis: int, is_done: Callable[[float], bool], weight: float) -> float | None:
    """Hold an axis until its force is even, and done; return it; None if that takes too long."""
    for _ in range(math.ceil(PATIENCE / LOOK)):
        forces = drive.hold(LOOK).forces[:, axis]
        if np.ptp(forces) <= STILL * weight and is_done(float(forces.mean())):
            return float(forces.mean())
    return None


def largest_speed(rig: Rig, way: float, seconds: float, say: Say) -> Bounded | None:
    """Return the largest speed of a device that is moved by hand; None if nobody moves it.

    Its upper bound is a quarter above what was seen, a rule: a hand may be faster another day.

    Args:
        rig: With the device.
        way: By which a hand has moved it, in m (rad).
        seconds: How long it is watched, from its first motion on.
        say: Tells the user what to do.
    """
    rig.limits = Limits(rig.limits.force, math.inf, math.inf)
    say(
        f"no force: move it by hand, as fast as anybody ever will, for {seconds:g} s; it counts"
        f" from the first motion, within {PATIENCE:.0f} s"
    )
    start = rest(rig, rig.period).readings[-1]
    waited = rest(rig, PATIENCE, lambda reading: math.dist(reading, start) >= way)
    if math.dist(waited.readings[-1], start) < way:
        say("nobody moved it: largest speed not measured")
        return None
    speeds = speeds_of(rest(rig, seconds))
    most = float(speeds.max())
    return Bounded(most, most, UNSEEN * most)


def speeds_of(trace: Trace) -> Floats:
    """Return the speeds of a motion, of all axes together, each over some ticks."""
    moved = trace.readings[SPEED_TICKS:] - trace.readings[:-SPEED_TICKS]
    took = trace.read[SPEED_TICKS:] - trace.read[:-SPEED_TICKS]
    return np.asarray(np.sqrt((moved**2).sum(axis=1)) / took)
