"""Hands whose path is a formula: they press, stroke, palpate, tremble and shake.

The functions of numbers alone are those that compiled kernels share with the hands.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from typing import Annotated, ClassVar, NamedTuple, TypeAlias

from forcebound.errors import ConfigError
from forcebound.haptics.hands import Operator
from forcebound.messages.packets import MAX_AXES, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Angle,
    Damping,
    Force,
    Frequency,
    JointDamping,
    JointStiffness,
    Length,
    Mass,
    Range,
    Speed,
    Stiffness,
    Time,
    check_ranges,
)

MOST_BUTTONS = 8

# One number: on the first axis, 0 m on the others. Or a list of one for each axis.
Coordinates: TypeAlias = Length | tuple[Length, ...]


def coordinates(place: Coordinates) -> Vector:
    """Return a place as a vector, in m; its axes beyond the last are at 0."""
    return place if isinstance(place, tuple) else (place,)


class Segment(NamedTuple):
    """A straight line from one point to another."""

    start: Vector  # m
    end: Vector  # m, same shape
    direction: Vector  # unit vector; zeros if both are one point
    length: float  # m

    def at(self, travel: float) -> Vector:
        """Return the place after ``travel``, in m, from the start on; then the end."""
        if travel >= self.length:
            return self.end
        return tuple([a + travel * u for a, u in zip(self.start, self.direction, strict=True)])


def segment(start: Coordinates, end: Coordinates) -> Segment:
    """Return the straight line from one point to another."""
    pairs = list(zip_longest(coordinates(start), coordinates(end), fillvalue=0.0))
    length = math.hypot(*[b - a for a, b in pairs])
    direction = tuple([(b - a) / length if length > 0.0 else 0.0 for a, b in pairs])
    return Segment(tuple([a for a, _ in pairs]), tuple([b for _, b in pairs]), direction, length)


def _shifted(place: Vector, shift: Vector) -> Vector:
    if len(place) == len(shift):  # as nearly always, and quicker
        return tuple([a + b for a, b in zip(place, shift, strict=True)])
    return tuple([a + b for a, b in zip_longest(place, shift, fillvalue=0.0)])


@dataclass(frozen=True, kw_only=True)
class SoftGrip(Operator):
    """Part of a hand: a mass at the handle, and spring and damper to the target.

    The defaults are close to the soft grip of the paper's experiments (section 4.1).
    """

    places: ClassVar[tuple[str, ...]] = ()  # fields that are places

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.275
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 950.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 2.8

    def __post_init__(self) -> None:
        check_ranges(self)
        for name in self.places:
            count = len(coordinates(getattr(self, name)))
            if not 1 <= count <= MAX_AXES:
                expected = f"{name} must be one number, or 1 to {MAX_AXES} (one per axis)"
                raise ConfigError(f"{expected}, got {count}", field=name)


@dataclass(frozen=True, kw_only=True)
class Press:
    """One press of a button.

    Attributes:
        button: Its number, from 0.
        start: When it goes down, since the force engaged.
        end: When it comes up.
    """

    button: Annotated[int, Range(at_least=0, below=MOST_BUTTONS)] = 0
    start: Annotated[Time, NOT_NEGATIVE]
    end: Annotated[Time, NOT_NEGATIVE]

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.end <= self.start:
            message = f"end must be after start, {self.start:g} s, got {self.end:g} s"
            raise ConfigError(message, field="end")


@dataclass(frozen=True, kw_only=True)
class PressingButtons(Operator):
    """Part of a hand that presses buttons.

    Attributes:
        presses: Of the buttons, each with a start and an end; a device has buttons if there are
            any.
    """

    presses: tuple[Press, ...] = ()

    def buttons(self, elapsed: float) -> int | None:
        if not self.presses:
            return None
        return sum({1 << one.button for one in self.presses if one.start <= elapsed < one.end})


@dataclass(frozen=True)
class NoHand(Operator):
    """No mass, no spring, no damper: only motor and friction move the device, from 0 m on."""

    mass: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0

    def target(self, elapsed: float) -> Vector:
        return (0.0,)


@dataclass(frozen=True, kw_only=True)
class WallInPlace(SoftGrip):
    """No hand: walls, which the handle or the tip of an arm meets, as a follower's tool does.

    They can only push. The joints of an arm may meet limits, too.

    Attributes:
        mass: That the handle carries, without its weight.
        stiffness: Of the walls; 0: there is none.
        damping: Of the walls.
        start: Where the handle begins: on the first axis, or a list of one for each axis.
        gap: From there to a wall across the first axis, or a list of one for each axis; negative:
            in negative direction, as a floor; null: none across this axis.
        joint_limits: Of an arm: lowest and highest angle of each joint, in a list; empty: none.
        joint_stiffness: Of these limits, which are springs.
        joint_damping: Of these limits.
    """

    places: ClassVar[tuple[str, ...]] = ("start",)

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.0
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    start: Coordinates = 0.0
    gap: Length | tuple[Length | None, ...] = 0.010
    joint_limits: tuple[tuple[Angle, Angle], ...] = ()
    joint_stiffness: Annotated[JointStiffness, POSITIVE] = 100.0
    joint_damping: Annotated[JointDamping, NOT_NEGATIVE] = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in self.joint_limits:
            if low >= high:
                message = f"joint_limits: expected the lower angle first, got [{low:g}, {high:g}]"
                raise ConfigError(message, field="joint_limits")

    @property
    def walls(self) -> Vector:  # type: ignore[override]
        gaps = self.gap if isinstance(self.gap, tuple) else (self.gap,)
        return tuple([math.nan if gap is None else gap for gap in gaps])

    def target(self, elapsed: float) -> Vector:
        return _shifted(coordinates(self.start), (0.0,) * len(self.walls))  # one of each wall


@dataclass(frozen=True)
class _ApproachingHand(SoftGrip):
    """Part of a hand whose target moves straight from ``start`` to ``end``.

    Attributes:
        start: Where the target begins: on the first axis, or a list of one for each axis.
        end: Where it stays, such as behind a surface; likewise.
        approach_speed: From the one to the other.
    """

    places: ClassVar[tuple[str, ...]] = ("start", "end")

    start: Coordinates = -0.010
    end: Coordinates = 0.014  # 4 mm behind the surface of the paper's wall at 10 mm
    # Paper 4.2: "high" is 150 to 250 mm/s, "low" 20 to 50 mm/s.
    approach_speed: Annotated[Speed, POSITIVE] = 0.2

    def target(self, elapsed: float) -> Vector:
        return self._approach.at(self.approach_speed * elapsed)

    @cached_property
    def _approach(self) -> Segment:
        return segment(self.start, self.end)


@dataclass(frozen=True)
class PressingHand(_ApproachingHand):
    """Mass, spring and damper whose target moves straight from ``start`` to ``end``."""


@dataclass(frozen=True)
class StrokingHand(_ApproachingHand, PressingButtons):
    """Mass, spring and damper whose target goes straight to ``end`` and then strokes about it.

    Pressed into a surface, with a ``stroke`` along it, the tip slides: the spring presses with
    about its stiffness times the distance from the surface to the target.

    Attributes:
        end: Middle of the strokes, such as behind a surface; likewise.
        stroke: From the middle to the first turn, a list of one for each axis; the other turn is
            opposite.
        frequency: Of strokes to and fro; the motion is a sine.
    """

    places: ClassVar[tuple[str, ...]] = ("start", "end", "stroke")

    approach_speed: Annotated[Speed, POSITIVE] = 0.1
    stroke: Coordinates = (0.0, 0.020)  # across the first axis
    frequency: Annotated[Frequency, NOT_NEGATIVE] = 0.5

    def target(self, elapsed: float) -> Vector:
        since = max(elapsed - self._approach.length / self.approach_speed, 0.0)
        share = math.sin(2.0 * math.pi * self.frequency * since)
        stroke = tuple([share * length for length in coordinates(self.stroke)])
        return _shifted(super().target(elapsed), stroke)


@dataclass(frozen=True)
class TremblingHand(_ApproachingHand):
    """Mass, spring and damper whose target moves from ``start`` to ``end`` and trembles.

    With a soft spring and a target far behind the surface the hand pushes with a force that hardly
    depends on where the handle is, as an arm does whose grip is soft. ``tremor`` is the amplitude
    of a sinusoidal force of the muscles; it moves the target by ``tremor / stiffness``. A hand's
    physiological tremor has 8 to 12 Hz.

    Attributes:
        end: Where it stays, apart from the tremor; likewise.
        tremor: On the first axis, or a list of one for each axis. Each axis trembles a quarter of
            a cycle after the one before, so that the tip circles.
        tremor_frequency: Of every axis.
        tremor_phase: Of the first axis, when the force engages.
    """

    places: ClassVar[tuple[str, ...]] = ("start", "end", "tremor")

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.6
    stiffness: Annotated[Stiffness, POSITIVE] = 28.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.1
    end: Coordinates = 0.13  # 120 mm behind the surface of the paper's wall at 10 mm
    approach_speed: Annotated[Speed, POSITIVE] = 0.1
    tremor: Annotated[Force, NOT_NEGATIVE] | tuple[Annotated[Force, NOT_NEGATIVE], ...] = 0.4
    tremor_frequency: Annotated[Frequency, NOT_NEGATIVE] = 8.0
    tremor_phase: Angle = 0.0

    def target(self, elapsed: float) -> Vector:
        phase = 2.0 * math.pi * self.tremor_frequency * elapsed + self.tremor_phase
        tremor = [
            force / self.stiffness * math.sin(phase - 0.5 * math.pi * axis)
            for axis, force in enumerate(coordinates(self.tremor))
        ]
        return _shifted(super().target(elapsed), tuple(tremor))


@dataclass(frozen=True)
class SinusoidalHand(SoftGrip):
    """Mass, spring and damper whose target is a sine along the first axis (paper Fig. 19: 2 Hz).

    Attributes:
        centre: Of the sine.
        amplitude: Of the sine; it begins at ``centre - amplitude``.
        frequency: Of the sine.
    """

    centre: Length = 0.010
    amplitude: Annotated[Length, NOT_NEGATIVE] = 0.004
    frequency: Annotated[Frequency, NOT_NEGATIVE] = 2.0

    def target(self, elapsed: float) -> Vector:
        phase = 2.0 * math.pi * self.frequency * elapsed
        return (self.centre - self.amplitude * math.cos(phase),)


@dataclass(frozen=True)
class ChirpHand(SoftGrip):
    """Mass, spring and damper whose target is a sine of rising frequency along the first axis.

    The frequency rises by the same factor in the same time, from ``lowest`` to ``highest``
    within ``sweep_time``, and stays there. Measures of impedance need such a motion; a shaker in
    place of the hand makes it.

    Source: Farina, Simultaneous measurement of impulse response and distortion with a swept-sine
    technique, 108th Convention of the Audio Engineering Society, 2000.

    Attributes:
        centre: Of the sine, where it begins.
        amplitude: Of the sine.
        lowest: Frequency at the beginning.
        highest: Frequency from the end of the sweep on.
        sweep_time: From the lowest to the highest frequency.
    """

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.05
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 2_000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 10.0
    centre: Length = 0.013
    amplitude: Annotated[Length, NOT_NEGATIVE] = 0.0007
    lowest: Annotated[Frequency, POSITIVE] = 1.0
    highest: Annotated[Frequency, POSITIVE] = 100.0
    sweep_time: Annotated[Time, POSITIVE] = 20.0

    def target(self, elapsed: float) -> Vector:
        swept = min(max(elapsed, 0.0), self.sweep_time)
        octaves = math.log(self.highest / self.lowest)
        share = octaves * swept / self.sweep_time
        cycles = self.lowest * (self.sweep_time * math.expm1(share) / octaves if octaves else swept)
        cycles += self.highest * (elapsed - swept)
        return (self.centre + self.amplitude * math.sin(2.0 * math.pi * cycles),)
