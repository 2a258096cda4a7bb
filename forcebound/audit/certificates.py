"""The certificates: what a device may do, and what the law has to know of it.

To add one: an entry in :data:`CERTIFICATES`, its numbers in :data:`NUMBERS`, and what they mean to
the truth in ``plan.py``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from forcebound.audit.cases import Range

WITHOUT = "without_"  # before the name of a certificate: the law is not informed

#: Numbers of devices; those that a certificate does not name are 0.
NUMBERS: dict[str, Range] = {
    "axes": Range(1.0, 3.999),  # its whole part
    "write_delay": Range(1e-5, 4e-4, is_logarithmic=True),  # s
    "presliding": Range(1e-6, 2e-4, is_logarithmic=True),  # m
    "gain_error": Range(0.005, 0.2, is_logarithmic=True),
    "gain_side": Range(-1.0, 1.0),  # the motor's gain within its error
    "lag": Range(2e-5, 2e-3, is_logarithmic=True),  # s
    "damping_ratio": Range(0.1, 10.0, is_logarithmic=True),  # of each axis to the one before
    "friction_ratio": Range(0.1, 10.0, is_logarithmic=True),
    "resolution_ratio": Range(0.1, 10.0, is_logarithmic=True),
    "watchdog_tolerance": Range(0.01, 0.3),
    "cut_side": Range(-1.0, 1.0),  # of the watchdog's time within its tolerance
    "hold_change": Range(0.1, 3.0),  # largest change of the hold limit, as a share of it
    "watchdog_limit": Range(1.5, 50.0, is_logarithmic=True),  # in periods
    "allowance": Range(1e-6, 1e-2, is_logarithmic=True),  # J
    "energy_cap": Range(1e-5, 1e-2, is_logarithmic=True),  # J
    "largest_speed": Range(0.05, 2.0, is_logarithmic=True),  # m/s
    "glitches": Range(0.01, 0.3, is_logarithmic=True),  # share of readings
    "shortest": Range(1.0, 1000.0, is_logarithmic=True),  # ns, of a sample interval
}


@dataclass(frozen=True)
class Certificate:
    """What a certificate is about.

    Attributes:
        summary: A few words for a table.
        numbers: Keys of :data:`NUMBERS` that its cases draw.
        unstated: Fields of :class:`forcebound.bounding.Dissipation` as the law gets them when it is
            not informed; None: those of the first axis, for all. Empty: nothing can be left out.
        watchdog: Of the device: "silent", "reporting" or "none".
    """

    summary: str
    numbers: tuple[str, ...] = ()
    unstated: Mapping[str, Any] = field(default_factory=dict)
    watchdog: str = "silent"


OWN_NUMBERS_OF_AXES = ("axes", "damping_ratio", "friction_ratio", "resolution_ratio")

CERTIFICATES: dict[str, Certificate] = {
    "plain": Certificate("damping, friction, resolution; late ticks", ("axes",)),
    "own_axes": Certificate(
        "own damping, friction, resolution of each axis",
        OWN_NUMBERS_OF_AXES,
        {"damping": None, "friction": None, "resolution": None},
    ),
}
