r"""The motor's force between two readings: its mean, and the penalty of its changes.

It is known, piece by piece: the old force until the new one takes effect, the new one until it is
replaced or the watchdog drops it, each approached as :math:`F_a(t) = F + (F_a(0) - F) e^{-t/\tau}`.
``docs/theory.md``, section 3.1, derives the *penalty*, what the hand may gain by the deviation from
the mean force, and that of a single step, where friction counts.
"""

import math

from forcebound.haptics.laws.hold_cost import hold_cost
from forcebound.haptics.laws.sample import AxisConstants


class Motor:
    """The force of one axis since the last reading."""

    target: float  # N, that the amplifier approaches
    actual: float  # N, now
    first: float  # N s, integral of the force since the last reading
    second: float  # N² s, integral of its square
    steps: float  # number of steps of the target since the last reading
    step: float  # N, the last of them
    most: float  # N, largest magnitude of the target since the last reading
    unknown: float  # N s, most that the integral can err, see ``wait``
    unknown_square: float  # N² s, the same of the integral of the square of the error


def run(motor: Motor, duration: float, lag: float) -> None:
    """Let ``duration`` pass, in s; ``lag`` is τ, in s."""
    target, away = motor.target, motor.actual - motor.target
    motor.first += target * duration
    motor.second += target * target * duration
    if away != 0.0:  # only with a lag: else the force is on its target at once
        left = math.exp(-duration / lag)
        mean = lag * (1.0 - left)
        motor.first += away * mean
        motor.second += 2.0 * target * away * mean + 0.5 * away * away * lag * (1.0 - left * left)
        away *= left
    motor.actual = target + away


def wait(motor: Motor, duration: float, lag: float) -> None:
    """Let a ``duration`` pass, in s, that the true interval need not have: the amplifier waits.

    In truth its force may have gone on towards the target: by so much it is unknown.
    """
    motor.first += motor.actual * duration
    motor.second += motor.actual * motor.actual * duration
    change = abs(motor.target - motor.actual) * (1.0 - math.exp(-duration / lag))
    motor.unknown += change * duration
    motor.unknown_square += change * change * duration


def retarget(motor: Motor, target: float, lag: float, is_first: bool) -> None:
    """Set a new target, in N; ``is_first``: right at the reading."""
    step = target - motor.target
    motor.target = target
    if lag <= 0.0:
        motor.actual = target
    motor.most = abs(target) if is_first else max(motor.most, abs(target))
    if not is_first and step != 0.0:
        motor.steps += 1.0
        motor.step = step


def begin_interval(motor: Motor) -> None:
    """Observe the motor from a reading on."""
    motor.first = motor.second = motor.steps = motor.step = 0.0
    motor.unknown = motor.unknown_square = 0.0
    motor.most = abs(motor.target)


def mean_force(motor: Motor, dt: float, lag: float) -> float:
    """Return the mean force of an interval of length ``dt``, in s; exact if nothing changed."""
    if motor.steps == 0.0 and lag == 0.0:
        return motor.target
    return motor.first / dt


def penalty(
    motor: Motor, dt: float, lag: float, gain: float, move: float, constants: AxisConstants
) -> float:
    """Return what the hand can have gained by the changes of the force in an interval, in J.

    ``motor`` is that at the end of the interval of ``dt`` s, in which the reading made a ``move``
    in m; ``gain`` is the largest of the motor.
    """
    if motor.steps == 0.0 and lag == 0.0:
        return 0.0
    deviation = max(motor.second - motor.first * motor.first / dt, 0.0)
    if motor.unknown_square > 0.0:
        deviation = (math.sqrt(deviation) + math.sqrt(motor.unknown_square)) ** 2
    if motor.steps != 1.0 or lag > 0.0 or constants.presliding > 0.0:
        return gain * gain * deviation / (4.0 * constants.damping)
    return step_penalty(motor.step, deviation, gain, move, constants)


def step_penalty(
    step: float, deviation: float, gain: float, move: float, constants: AxisConstants
) -> float:
    """Return the penalty of a single ``step``, in N, on an axis with rigid friction, in J."""
    if deviation == 0.0 or constants.friction == 0.0:
        return gain * gain * deviation / (4.0 * constants.damping)
    distance = abs(move) + 2.0 * constants.half_resolution
    share = deviation / (step * step)
    return hold_cost(gain * abs(step), 2.0 * constants.friction, distance, constants.damping, share)
