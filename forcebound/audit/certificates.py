"""The certificates: what a device may do, and what the law has to know of it.

To add one: an entry in :data:`CERTIFICATES`, its numbers in :data:`NUMBERS`, and what they mean to
the truth in ``plan.py``.
"""

import math
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
    "gain_side": Range(-1.0, 1.0),  # the gain of the first and third motor within its error
    "other_gain_side": Range(-1.0, 1.0),  # of the second
    "lag": Range(2e-5, 2e-3, is_logarithmic=True),  # s
    "damping_ratio": Range(0.1, 10.0, is_logarithmic=True),  # of each axis to the one before
    "friction_ratio": Range(0.1, 10.0, is_logarithmic=True),
    "resolution_ratio": Range(0.1, 10.0, is_logarithmic=True),
    "watchdog_tolerance": Range(0.01, 0.3),
    "cut_side": Range(-1.0, 1.0),  # of the watchdog's time within its tolerance
    "hold_change": Range(0.1, 3.0),  # largest change of the hold limit, as a share of it
    "guard_period": Range(1e-5, 9e-4, is_logarithmic=True),  # s
    "watchdog_limit": Range(1.5, 50.0, is_logarithmic=True),  # in periods
    "allowance": Range(1e-6, 1e-2, is_logarithmic=True),  # J
    "weight_share": Range(0.02, 0.9),  # of the least friction: error of the compensated weight
    "weight_side": Range(-1.0, 1.0),  # of the weight within its error
    "energy_cap": Range(1e-5, 1e-2, is_logarithmic=True),  # J
    "largest_speed": Range(0.05, 2.0, is_logarithmic=True),  # m/s
    "glitches": Range(0.01, 0.3, is_logarithmic=True),  # share of readings that are no numbers
    "wild_readings": Range(0.01, 0.3, is_logarithmic=True),  # share of readings where errors begin
    "shortest": Range(1.0, 1000.0, is_logarithmic=True),  # ns, of a sample interval
}


@dataclass(frozen=True)
class Certificate:
    """What a certificate is about.

    Attributes:
        summary: A few words for a table.
        numbers: Keys of :data:`NUMBERS` that its cases draw.
        unstated: Fields of :class:`forcebound.bounding.Dissipation` as the law gets them when it is
            not informed; None: that of the first axis, or of the first hold, for all. Empty:
            nothing can be left out.
        watchdog: Of the device, one of :data:`forcebound.bounding.dissipation.WATCHDOGS`.
    """

    summary: str
    numbers: tuple[str, ...] = ()
    unstated: Mapping[str, Any] = field(default_factory=dict)
    watchdog: str = "silent"


OWN_NUMBERS_OF_AXES = ("axes", "damping_ratio", "friction_ratio", "resolution_ratio")

IMPERFECTIONS = (
    "write_delay",
    "presliding",
    "gain_error",
    "gain_side",
    "other_gain_side",
    "lag",
    "weight_share",
    "weight_side",
    "energy_cap",
    "glitches",
    "shortest",
)
UNINFORMED = {"write_delay": 0.0, "presliding": 0.0, "gain_error": 0.0, "lag": 0.0}

CERTIFICATES: dict[str, Certificate] = {
    "plain": Certificate("damping, friction, resolution; late ticks", ("axes",)),
    "own_axes": Certificate(
        "own damping, friction, resolution of each axis",
        OWN_NUMBERS_OF_AXES,
        {"damping": None, "friction": None, "resolution": None},
    ),
    "readings": Certificate(
        "readings that are no numbers, or too soon", ("axes", "glitches", "shortest")
    ),
    "speed_gate": Certificate(
        "readings wrong by 1 km, a largest speed",
        ("axes", "wild_readings", "largest_speed"),
        {"largest_speed": math.inf},
    ),
    "write_delay": Certificate(
        "time between reading and writing, to 0.4 T", ("axes", "write_delay"), {"write_delay": 0.0}
    ),
    "slow_write_delay": Certificate(
        "the same with a largest speed",
        ("axes", "write_delay", "largest_speed"),
        {"write_delay": 0.0},
    ),
    "presliding": Certificate(
        "friction that yields before it slides",
        (*OWN_NUMBERS_OF_AXES, "presliding"),
        {"presliding": 0.0},
    ),
    "gain_error": Certificate(
        "error of the motor's gain, to 20 %",
        ("axes", "gain_error", "gain_side", "other_gain_side"),
        {"gain_error": 0.0},
    ),
    "lag": Certificate("lag of the amplifier, to 2 T", ("axes", "lag"), {"lag": 0.0}),
    "watchdog_range": Certificate(
        "silent watchdog, to 30 % early or late",
        ("axes", "watchdog_tolerance", "cut_side"),
        {"watchdog_tolerance": 0.0},
    ),
    "reporting": Certificate("watchdog that reports its cuts", ("axes",), watchdog="reporting"),
    "guarding": Certificate(
        "watchdog that guards a late force",
        ("axes", "guard_period"),
        watchdog="guarding",
    ),
    "hold_change": Certificate(
        "hold limit that changes from hold to hold",
        ("axes", "hold_change"),
        {"hold_limit": None},
    ),
    "hold_change_reporting": Certificate(
        "the same, with a watchdog that reports",
        ("axes", "hold_change"),
        {"hold_limit": None},
        watchdog="reporting",
    ),
    "no_watchdog": Certificate(
        "no watchdog, no allowance",
        ("axes", "watchdog_limit"),
        {"watchdog": "silent"},
        watchdog="none",
    ),
    "allowance": Certificate(
        "no watchdog, an allowance for late holds",
        ("axes", "watchdog_limit", "allowance"),
        {"watchdog": "silent"},
        watchdog="none",
    ),
    "energy_cap": Certificate("a cap of the ledger", ("axes", "energy_cap")),
    "weight": Certificate(
        "weight that is compensated up to an error",
        ("axes", "weight_share", "weight_side"),
        {"weight_error": 0.0},
    ),
    "all": Certificate(
        "all of this, silent watchdog",
        (*OWN_NUMBERS_OF_AXES, *IMPERFECTIONS, "watchdog_tolerance", "cut_side", "hold_change"),
        UNINFORMED,
    ),
    "all_slow": Certificate(
        "the same with a largest speed and wild readings",
        (
            *OWN_NUMBERS_OF_AXES,
            *IMPERFECTIONS,
            "watchdog_tolerance",
            "cut_side",
            "largest_speed",
            "wild_readings",
        ),
        UNINFORMED,
    ),
    "all_reporting": Certificate(
        "all of this, reporting watchdog",
        (*OWN_NUMBERS_OF_AXES, *IMPERFECTIONS, "hold_change"),
        UNINFORMED,
        watchdog="reporting",
    ),
    "all_guarding": Certificate(
        "all of this but lag and write delay, guarding watchdog",
        (
            *OWN_NUMBERS_OF_AXES,
            *(name for name in IMPERFECTIONS if name not in ("lag", "write_delay")),
            "guard_period",
            "hold_change",
        ),
        {"presliding": 0.0, "gain_error": 0.0},
        watchdog="guarding",
    ),
    "all_allowance": Certificate(
        "all of this, no watchdog, an allowance",
        (*OWN_NUMBERS_OF_AXES, *IMPERFECTIONS, "watchdog_limit", "allowance", "hold_change"),
        UNINFORMED,
        watchdog="none",
    ),
}
