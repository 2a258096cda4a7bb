"""The gain of a motor, by a weight that the user hangs on its axis.

The user is asked to hang it and to take it off; that it is done is seen in the force of the motor,
for the hands are busy. What is not done in time stays unmeasured, and is reported.
"""

import math
from collections.abc import Callable

import numpy as np

from forcebound.errors import DeviceError
from forcebound.lab.identification.drive import Drive
from forcebound.lab.identification.estimators import Bounded, Floats, mean_of
from forcebound.lab.identification.experiments import points_of, there_and_back

USER_TIMEOUT = 120.0  # s
LOOK = 1.0  # s, for which a weight hangs still
HANGS = 0.4  # share of its force that the motor then holds, or more
STILL = 0.1  # share of it by which the force may change in that time
LIGHTEST = 2.0  # times the friction
HEAVIEST = 0.6  # share of the largest force
PARTS, PAIRS = 3, 4  # of the range, of passes
EVEN = 0.8  # share of the range, without the turning
GIVEN = 0.01  # share by which the weight may be another than the user says


def gain(
    drive: Drive,
    axis: int,
    weight: float,
    friction: float,
    reach: float,
    speed: float,
    report: Callable[[str], None],
) -> Bounded | None:
    """Return the force of a motor over its command; None if the weight was not hung.

    Slow passes, with the weight and without: the mean of what both directions need differs by the
    weight, whatever the friction.

    Args:
        drive: Of the device.
        axis: Whose motor it is.
        weight: Force of the weight on the axis, in N (N m).
        friction: Of the axis, in N (N m).
        reach: Of the passes to either side, in m (rad).
        speed: Of the passes, in m/s (rad/s).
        report: Shows the user what to do.

    Raises:
        DeviceError: If the axis does not move evenly.
    """
    name = f"axis {axis + 1}"
    least, most = LIGHTEST * friction, HEAVIEST * drive.rig.limits.force
    if not least <= weight <= most:
        report(
            f"{name}: the weight pulls with {weight:.3g}; it should be {least:.3g} ({LIGHTEST:g}"
            f" times the friction) to {most:.3g} ({HEAVIEST:g} of --force): gain not measured"
        )
        return None
    without = _loads(drive, axis, reach, speed)
    nothing = -float(without.mean())
    report(
        f"{name}: the motor holds. Hang the weight so that it pulls with {weight:.3g} at this axis"
        f" alone, either way, and let go; within {USER_TIMEOUT:.0f} s"
    )
    held = _wait(drive, axis, lambda force: abs(force - nothing) >= HANGS * weight, weight)
    if held is None:
        report(f"{name}: no weight was seen to hang: gain not measured")
        return None
    drive.load[axis] = held
    hanging = _loads(drive, axis, reach, speed)
    report(f"{name}: take the weight off; within {USER_TIMEOUT:.0f} s")
    drive.load[axis] = 0.0
    _wait(drive, axis, lambda force: abs(force - nothing) < HANGS * weight, weight)
    mean, error = mean_of(np.abs(hanging - without.mean(axis=0)))
    error = math.sqrt(2.0) * error + GIVEN * mean
    return Bounded(weight / mean, weight / (mean + error), weight / max(mean - error, 1e-3 * mean))


def _loads(drive: Drive, axis: int, half: float, speed: float) -> Floats:
    """Return the push that the place needs: a row for each pair of passes, a column for a part."""
    middle = drive.rig.start[axis]
    drive.go(axis, middle - half, speed)
    passes = there_and_back(drive, axis, half, speed, 2 * PAIRS)
    drive.go(axis, middle, speed)
    points = points_of(passes, middle - EVEN * half, middle + EVEN * half, PARTS)
    if len(points) < PARTS * PAIRS:
        raise DeviceError(
            f"axis {axis + 1}: {len(points)} of {PARTS * PAIRS} parts of passes can be used: it did"
            " not follow its way, or ticks were late; see `forcebound doctor`"
        )
    inertia = drive.rough[axis].inertia
    return np.array([one.at_rest(inertia).load for one in points]).reshape(PAIRS, PARTS)


def _wait(drive: Drive, axis: int, is_done: Callable[[float], bool], weight: float) -> float | None:
    """Hold an axis until its force is even, and done; return it; None if that takes too long."""
    for _ in range(math.ceil(USER_TIMEOUT / LOOK)):
        forces = drive.hold(LOOK).forces[:, axis]
        if np.ptp(forces) <= STILL * weight and is_done(float(forces.mean())):
            return float(forces.mean())
    return None
