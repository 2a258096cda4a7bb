"""The velocity estimate of the device node: a low-pass on the backward difference.

Pure functions of numbers; :mod:`forcebound.lab.one_axis` compiles them.
"""

import math


def low_pass_gain(cutoff: float, dt: float) -> float:
    """Return the share of a difference that a first-order low-pass takes over in ``dt`` s, 0 to 1.

    Backward Euler, so it is stable for any ``dt``; ``cutoff`` is in Hz.
    """
    angle = 2.0 * math.pi * cutoff * dt
    return angle / (1.0 + angle)


def low_pass(value: float, measured: float, gain: float) -> float:
    """Return the next value of the low-pass; ``gain`` is that of :func:`low_pass_gain`."""
    return value + gain * (measured - value)
