"""Settings of a servo, and what a law relies on for a device at its rate."""

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Literal

from forcebound.errors import ConfigError
from forcebound.graph.problems import unknown
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.laws import LAWS, Dissipation
from forcebound.haptics.laws.dissipation import StatedAxes, StatedNumbers
from forcebound.haptics.laws.hold_limit import FIXED, FLOOR
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    CheckedText,
    Energy,
    Frequency,
    Range,
    Ratio,
    Time,
    check_ranges,
)

SLOWEST, FASTEST = 0.1, 1e6  # Hz; beyond, a period in whole ns is coarse, or no servo
LONGEST_HOLD = 1e6  # periods


def check_law(law: str) -> None:
    """Raise ConfigError if there is no such law."""
    if law not in LAWS:
        raise ConfigError(unknown("law", law, LAWS), field="law")
    if law.endswith(")"):
        LAWS[law]  # its numbers are checked


@dataclass(frozen=True)
class ServoSettings:
    """Settings of the servo of the device node.

    Attributes:
        law: Bounding law, a key of ``forcebound.haptics.laws.LAWS``; some have numbers, as in
            ``energy_tank(refill=20)``.
        rate: Of the servo.
        reply_wait: Share of the period between reading and writing.
        readings_per_tick: 2: one for the state, one right before the write; 1: the state's is that
            of the bounder, too, so ``write_delay`` must cover ``reply_wait``; auto: 1 where a live
            device takes so long that two do not fit, else 2.
        hold_limit: Periods that a force may be held: T_max; auto: as short as the lateness of the
            ticks allows, or 1.25 for a device that cannot be given another one.
        allowance: Energy that the hand may get out of holds longer than the hold limit, which is
            paid back before more force comes; 0: none.
        energy_cap: Most energy that the law keeps for later; auto: what the saturation can use.
        age_limit: An answer to an older state gives no force.
        engage_time: From no force to full force.
        velocity_cutoff: Of the low-pass on the backward difference.
        dead_man: Bit of a button that must be held: released, there is zero force, and it comes
            back over the ramp; null: none.
        energy_partner: Hand with which the bounder exchanges energy: it gives what it can spare,
            and gets what that hand can spare; empty: none.
        partner_limit: Most energy that the bounder gets from there beyond what it has given, so the
            most that the hand can get out if the partner lies; null: any.
    """

    law: Annotated[str, CheckedText(check_law)] = "certified"
    rate: Annotated[Frequency, Range(at_least=SLOWEST, at_most=FASTEST)] = 1000.0
    reply_wait: Annotated[Ratio, Range(at_least=0, below=1)] = 0.4
    readings_per_tick: Literal["auto", 1, 2] = "auto"
    hold_limit: Literal["auto"] | Annotated[Ratio, Range(at_least=1, at_most=LONGEST_HOLD)] = "auto"
    allowance: Annotated[Energy, NOT_NEGATIVE] = 0.0
    energy_cap: Literal["auto"] | Annotated[Energy, POSITIVE] = "auto"
    age_limit: Annotated[Time, POSITIVE] = 0.1
    engage_time: Annotated[Time, NOT_NEGATIVE] = 0.1
    velocity_cutoff: Annotated[Frequency, POSITIVE] = 100.0
    dead_man: Annotated[int, Range(at_least=0, below=63)] | None = None
    energy_partner: str = ""
    partner_limit: Annotated[Energy, NOT_NEGATIVE] | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        check_law(self.law)

    @cached_property
    def period_ns(self) -> int:
        """Sampling period, in ns."""
        return round(1e9 / self.rate)

    @cached_property
    def reply_wait_ns(self) -> int:
        """Time from reading to writing, in ns."""
        return round(self.reply_wait * self.period_ns)

    @cached_property
    def age_limit_ns(self) -> int:
        """Age limit, in ns."""
        return round(self.age_limit * 1e9)

    @cached_property
    def engage_time_ns(self) -> int:
        """Time from no force to full force, in ns."""
        return round(self.engage_time * 1e9)

    @property
    def longest_hold(self) -> float:
        """Longest time that a force may be held, T_max, in s; with auto that of punctual ticks."""
        return self._periods(FLOOR)

    @property
    def opening_hold(self) -> float:
        """The hold limit with which a device is opened, in s: it may know no other one."""
        return self._periods(FIXED)

    def _periods(self, learned: float) -> float:
        periods = learned if self.hold_limit == "auto" else self.hold_limit
        return round(periods * self.period_ns) * 1e-9


def dissipation_of(model: DeviceModel, servo: ServoSettings) -> Dissipation:
    """Return what laws rely on, for this device at this rate; ConfigError if it does not fit."""
    kind = StatedAxes if isinstance(model, StatedAxes) else StatedNumbers
    stated = {each.name: getattr(model, each.name) for each in fields(kind)}
    if model.watchdog == "silent" and model.watchdog_tolerance is None:
        raise ConfigError(
            "a silent watchdog needs watchdog_tolerance, the share of the hold limit by which it"
            " may be early or late",
            field="watchdog_tolerance",
        )
    dissipation = Dissipation(
        **{
            **stated,
            "watchdog_tolerance": model.watchdog_tolerance or 0.0,
            "watchdog_limit": model.longest_force,
            "largest_speed": model.largest_speed or math.inf,
            "hand_speed": model.hand_speed or math.inf,
        },
        period=servo.period_ns * 1e-9,
        hold_limit=servo.longest_hold,
        allowance=servo.allowance,
        energy_cap=None if servo.energy_cap == "auto" else servo.energy_cap,
    )
    if servo.readings_per_tick == 1:
        check_delay(model, servo.reply_wait_ns * 1e-9)
    certain = 1.0 - dissipation.watchdog_tolerance  # share of the hold limit
    if servo.hold_limit != "auto" and servo.hold_limit * certain < 1.0:
        raise ConfigError(
            f"a watchdog with a tolerance of {dissipation.watchdog_tolerance:.0%} may drop a force"
            f" before the period is over: expected a hold_limit of at least {1.0 / certain:.3g}"
            f" periods, or auto, got {servo.hold_limit:g}"
        )
    return dissipation


def check_delay(model: DeviceModel, needed: float) -> None:
    """Raise ConfigError if a force may act later after the only reading of a tick than stated.

    ``needed`` is that time at the least, in s.
    """
    if model.write_delay < needed:
        raise ConfigError(
            f"with one reading in a tick a force acts {1e3 * needed:.3g} ms or more after it:"
            f" expected write_delay: {stated_delay(needed):g} ms or more, got"
            f" {1e3 * model.write_delay:g} ms",
            field="write_delay",
        )


def stated_delay(seconds: float) -> float:
    """Return the ``write_delay`` to state where one was measured, in ms: with a reserve of 10 %."""
    return math.ceil(1.1e4 * seconds) / 10.0
