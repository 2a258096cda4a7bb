"""Knowledge of a device: the description that every bounding law relies on.

Fill it in from an identification of the device. Every number is a promise about the device: a
minimum of what it dissipates, a maximum of what it errs. ``docs/theory.md``, section 3, says how
the certified laws use each; ``docs/assumptions.md`` what a wrong one costs.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias, get_args

from forcebound.axes import OfAxes as OfAxes
from forcebound.axes import PerAxis as PerAxis
from forcebound.axes import entries
from forcebound.axes import per_axis as per_axis
from forcebound.errors import ConfigError
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Angle,
    AngularSpeed,
    Damping,
    Energy,
    Force,
    JointDamping,
    Length,
    Range,
    Ratio,
    Speed,
    Time,
    Torque,
    check_ranges,
)

DampingOfAxes: TypeAlias = OfAxes[Annotated[Damping, NOT_NEGATIVE]]
FrictionOfAxes: TypeAlias = OfAxes[Annotated[Force, NOT_NEGATIVE]]
LengthOfAxes: TypeAlias = OfAxes[Annotated[Length, NOT_NEGATIVE]]
ForceOfAxes: TypeAlias = OfAxes[Annotated[Force, Range()]]
DampingOfJoints: TypeAlias = OfAxes[Annotated[JointDamping, NOT_NEGATIVE]]
TorqueOfJoints: TypeAlias = OfAxes[Annotated[Torque, NOT_NEGATIVE]]
AngleOfJoints: TypeAlias = OfAxes[Annotated[Angle, NOT_NEGATIVE]]

#: ``guarding``: looks at the readings, first at the hold limit, drops the force when one of them
#: has moved back from where it was when that force began to act, and says when and where; see
#: ``guard_period``. ``reporting``: drops it at the hold limit, and says so.
#: ``silent``: drops it and says nothing. ``none``: the force stays on until the next write, or
#: until ``watchdog_limit``.
Watchdog: TypeAlias = Literal["guarding", "reporting", "silent", "none"]
WATCHDOGS: tuple[str, ...] = get_args(Watchdog)

#: What the motors may leave out of a force. ``per_write``: they give any share of it, constant from
#: the time when a written force acts until the next one does. ``freely``: the share may change at
#: any time. ``never``: they give all of it.
Attenuates: TypeAlias = Literal["never", "per_write", "freely"]
ATTENUATES: tuple[str, ...] = get_args(Attenuates)

MOST_LATE = 6  # periods, of a write: the ledger has places for as many forces on their way


@dataclass(frozen=True, kw_only=True)
class StatedNumbers:
    """Stated numbers of a device, for any rate of its servo.

    Coordinates are axes at the tip, in m and N, or joints, in rad and N m; then read "m" as rad and
    "N" as N m. Where a number for each axis is allowed, one number means all axes alike. The
    defaults describe an effect that the device does not have.

    Attributes:
        damping: Minimum viscous damping b; alike or for each axis.
        friction: Minimum Coulomb friction f_c. One number: along the path of the tip. One for each
            axis: on each axis by itself.
        resolution: Step of the position reading Δ; 0: exact readings; alike or for each axis.
        saturation: Largest force F_sat.
        watchdog: What drops a force that is older than the hold limit: a watchdog that guards it
            (it drops the force once a reading moves back, and reports it), one that drops it and
            reports when and where, one that does not report, or none; see :data:`Watchdog`.
        watchdog_tolerance: The watchdog drops the force, a guarding one looks first, somewhere
            between ``1 - tolerance`` and ``1 + tolerance`` hold limits. A silent one must state it.
        watchdog_limit: Without a watchdog: longest time that a force can stay on when no other
            comes; then the hardware drops it, or something else that you vouch for. A guarding
            watchdog drops it then at the latest; auto: never, or after 100 ms if it is guarded.
        guard_period: δ of a guarding watchdog, less than the period: longest time from the last
            look that saw nothing to the force being gone after the next look. A force that has
            moved back before the hold limit is gone at the hold limit.
        presliding: Distance z_m over which friction yields elastically before it slides: friction
            divided by the bristle's stiffness; alike or for each axis.
        gain_error: Largest relative error x of a motor's force, constant in a run: it gives between
            1 - x and 1 + x of what it should. The motors of several axes may differ within that.
        lag: Time constant τ of the amplifier, first order.
        write_delay: Longest time from latching a reading to the effect of the force written
            thereafter, which may come after later readings: at most 6 periods. What it is in each
            sample is measured. A force acts until the effect of the next one that was written.
        largest_speed: A reading that implies more is refused; null: none is.
        hand_speed: The hand moves no faster than this, on average over a period or longer; null:
            that is not stated. It allows more force: what the hand can get out of a hold is then
            less. A faster hand is counted, with the energy that it can have got.
        attenuates: Whether a motor may give less than the force written, any share up to 1 and
            another on each axis or joint, as under a current limit that is not reported; see
            :data:`Attenuates`. What ``write`` of the device returns needs no such statement.
        least_share: Share that a motor which attenuates gives at least.

    Raises:
        ConfigError: If a value is out of range.
    """

    damping: DampingOfAxes
    friction: FrictionOfAxes
    resolution: LengthOfAxes
    saturation: Annotated[Force, POSITIVE]
    watchdog: Watchdog
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] | None = None
    watchdog_limit: Annotated[Time, POSITIVE] | Literal["auto"] = "auto"
    guard_period: Annotated[Time, NOT_NEGATIVE] = 0.0
    presliding: LengthOfAxes = 0.0
    gain_error: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    lag: Annotated[Time, NOT_NEGATIVE] = 0.0
    write_delay: Annotated[Time, NOT_NEGATIVE] = 0.0
    largest_speed: Annotated[Speed, POSITIVE] | None = None
    hand_speed: Annotated[Speed, POSITIVE] | None = None
    attenuates: Attenuates = "never"
    least_share: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.watchdog not in WATCHDOGS:
            raise ConfigError(
                f"watchdog must be one of {', '.join(WATCHDOGS)}, got {self.watchdog!r}",
                field="watchdog",
            )
        if self.attenuates not in ATTENUATES:
            raise ConfigError(
                f"attenuates must be one of {', '.join(ATTENUATES)}, got {self.attenuates!r}",
                field="attenuates",
            )


@dataclass(frozen=True, kw_only=True)
class StatedAxes(StatedNumbers):
    """Stated numbers of a device whose axes carry weights that do not change with its pose.

    Attributes:
        weight: Weight on each axis that the device carries by itself, positive against positive
            motion; alike or for each axis. It acts when the force is dropped.
        weight_error: Largest error of that, constant in a run, less than the friction, which must
            hold it; alike or for each axis.
    """

    weight: ForceOfAxes = 0.0
    weight_error: FrictionOfAxes = 0.0


@dataclass(frozen=True, kw_only=True)
class JointNumbers(StatedNumbers):
    """Stated numbers of a device in its joints.

    No weight: gravity pulls at a joint as the pose has it, so no constant describes it.

    Attributes:
        damping: Minimum viscous damping of the joints; one number, or one of each.
        friction: Minimum Coulomb friction; one of each joint gives more force than one number,
            which counts along the path of all joints.
        resolution: Of the encoders.
        saturation: Largest torque: length of the vector of the joints' torques.
        presliding: Angle over which friction yields elastically before it dissipates.
        largest_speed: A reading that implies more is refused; null: none is.
        hand_speed: The hand turns the joints no faster than this, as the length of the vector of
            their speeds and on average over a period or longer; null: that is not stated.
    """

    damping: DampingOfJoints
    friction: TorqueOfJoints
    resolution: AngleOfJoints
    saturation: Annotated[Torque, POSITIVE]
    presliding: AngleOfJoints = 0.0
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = None
    hand_speed: Annotated[AngularSpeed, POSITIVE] | None = None


#: Numbers for which there is no proof with ``attenuates`` (docs/theory.md, 3.10).
_NOT_ATTENUATED = {
    "watchdog": "while it guards a late force no reading shows what a hand gains; use 'reporting'",
    "lag": "a filter with memory has no proof; expected 0 s",
    "gain_error": "a share is a gain; expected 0, with the largest gain as that stated",
    "weight": "the motor may drop the weight that it carries; expected 0 N",
}


@dataclass(frozen=True, kw_only=True)
class Dissipation(StatedAxes):
    """Description of a device that a law may rely on: its stated numbers, and how it is sampled.

    Attributes:
        period: Nominal sampling period T.
        hold_limit: Longest time T_max that the device holds a force; it then drops it to 0. Without
            a watchdog: longest time for which a punctual force is planned.
        allowance: Most that the hand may get out of holds longer than the hold limit, ε.
        energy_cap: Most energy that a ledger keeps; None: the most that the saturation can use.

    Raises:
        ConfigError: If a value is out of range, or the numbers do not go together.
    """

    damping: OfAxes[Annotated[Damping, POSITIVE]]
    period: Annotated[Time, POSITIVE]
    hold_limit: Annotated[Time, POSITIVE]
    watchdog: Watchdog = "silent"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    watchdog_limit: float = math.inf  # s
    largest_speed: float = math.inf  # m/s
    hand_speed: float = math.inf  # m/s
    allowance: Annotated[Energy, NOT_NEGATIVE] = 0.0
    energy_cap: Annotated[Energy, POSITIVE] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("largest_speed", "hand_speed"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"{name} must be > 0, got {getattr(self, name):g}")
        if self.hand_speed < math.inf:
            self._check_hand()
        self._check_hold()
        self._check_axes()
        if self.attenuates != "never":
            self._check_attenuation()

    def _check_hold(self) -> None:
        if self.hold_limit < self.period:
            raise ConfigError(
                f"hold_limit must be at least the period, {self.period} s, or every force is cut; "
                f"got {self.hold_limit} s"
            )
        if self.watchdog == "none" and not self.hold_limit <= self.watchdog_limit < math.inf:
            raise ConfigError(
                "watchdog 'none' needs a watchdog_limit of at least the hold limit, "
                f"{self.hold_limit} s, and finite, got {self.watchdog_limit} s: state after which "
                "time the hardware drops the force at last, or the longest stall that you vouch for"
            )
        if self.write_delay > MOST_LATE * self.period:
            raise ConfigError(
                f"write_delay must be at most {MOST_LATE} periods, {MOST_LATE * self.period} s, got"
                f" {self.write_delay} s: choose a lower rate for so slow a device",
                field="write_delay",
            )
        if self.watchdog == "guarding":
            self._check_guard()

    def _check_hand(self) -> None:
        fault, has_presliding = "", any(entries(self.presliding))
        if self.lag > 0.0 and has_presliding:
            fault = f"a lag of {self.lag} s and presliding"
        elif self.lag > 0.0 and (self.watchdog == "reporting" or self.watchdog_tolerance > 0.0):
            fault = f"a lag of {self.lag} s and a {self.watchdog} watchdog that may drop a force at"
            fault += " an unknown time"
        elif self.watchdog == "guarding" and has_presliding and any(entries(self.weight_error)):
            fault = "a guarding watchdog, presliding and a weight_error"
        if fault:
            raise ConfigError(
                f"hand_speed of {self.hand_speed:g} with {fault}: what the hand gets is not"
                " proved then; state hand_speed: null, or no number that the device does not have",
                field="hand_speed",
            )

    def _check_guard(self) -> None:
        if not 0.0 < self.guard_period < self.period:
            raise ConfigError(
                "watchdog 'guarding' needs a guard_period above 0 s and below the period, "
                f"{self.period} s, got {self.guard_period} s"
            )
        if self.lag > 0.0 or self.write_delay > 0.0:
            raise ConfigError(
                f"watchdog 'guarding' with a lag of {self.lag} s and a write_delay of "
                f"{self.write_delay} s: what a late force costs is known only without both, since "
                "one drop may hide another; use watchdog 'reporting'"
            )

    def _check_attenuation(self) -> None:
        for name, why in _NOT_ATTENUATED.items():
            value = getattr(self, name)
            if any(entries(value)) if name != "watchdog" else value == "guarding":
                raise ConfigError(
                    f"attenuates: {self.attenuates} with {name} {value}: {why}", field="attenuates"
                )
        unproved = f"hand_speed {self.hand_speed:g}" if self.hand_speed < math.inf else ""
        if self.attenuates == "freely" and any(entries(self.presliding)):
            unproved = "presliding, where a hand may tremble without friction: expected per_write"
        elif self.watchdog == "none" and any(entries(self.presliding)):
            unproved = "presliding and no watchdog: what a late hold can have given is not known"
        if unproved:
            raise ConfigError(
                f"attenuates: {self.attenuates} has no proof with {unproved}", field="attenuates"
            )

    def _check_axes(self) -> None:
        if self.friction == 0.0 or isinstance(self.friction, tuple):
            return
        each = {"damping": self.damping, "presliding": self.presliding}
        for name, value in (each | {"weight_error": self.weight_error}).items():
            if isinstance(value, tuple):
                raise ConfigError(
                    f"{name} of each axis needs the friction of each axis too: "
                    "one number means friction along the path"
                )

    @property
    def least_damping(self) -> float:
        """Minimum damping of the worst axis, in N s/m."""
        return min(entries(self.damping))

    @property
    def least_friction(self) -> float:
        """Minimum friction of the worst axis, in N."""
        return min(entries(self.friction))

    @property
    def coarsest_resolution(self) -> float:
        """Resolution of the worst axis, in m."""
        return max(entries(self.resolution))
