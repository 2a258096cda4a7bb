"""True numbers of a simulated device, where they differ from the stated ones.

Without it, a simulated device is the least favourable one that its statements permit: exactly the
minimum damping and friction, the motor at the upper end of its gain error, the full write delay,
the watchdog as late as it may be. So a law that relies on the statements has no hidden reserve, and
an experiment that asks what a wrong statement costs changes one number here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple, TypeAlias

from forcebound.haptics.laws.dissipation import (
    AngleOfJoints,
    DampingOfAxes,
    DampingOfJoints,
    ForceOfAxes,
    FrictionOfAxes,
    LengthOfAxes,
    OfAxes,
    TorqueOfJoints,
)
from forcebound.messages.packets import Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    Range,
    Ranged,
    Ratio,
    Time,
)

RatioOfMotors: TypeAlias = OfAxes[Annotated[Ratio, NOT_NEGATIVE]]


@dataclass(frozen=True, kw_only=True)
class WeakSpot(Ranged):
    """A part of the workspace with less friction than elsewhere.

    Attributes:
        centre: In the coordinates of the readings: m, or rad of the joints.
        radius: In the same unit.
        share: Of the friction, and of the distance over which it yields, that is left there.
    """

    centre: tuple[float, ...]
    radius: Annotated[float, POSITIVE]
    share: Annotated[Ratio, PROBABILITY]

    def share_at(self, place: Sequence[float]) -> float:
        """Return the share of the friction that is left at a place."""
        return self.share if math.dist(place, self.centre) < self.radius else 1.0


@dataclass(frozen=True, kw_only=True)
class TrueMotor(Ranged):
    """True values of the motor and its watchdog; null: as stated.

    Attributes:
        gain: The motor gives so many times the commanded force; one number, or one of each motor.
        lag: Time constant of the amplifier, first order.
        write_delay: From a write to the moment when its force acts.
        watchdog: The watchdog drops a force after so many hold limits.
        random: Draw each write delay and each time of the watchdog evenly from what the device
            states: from none to all of the write delay, and within the tolerance.
        seed: Of these draws.
        weak_spot: Less friction in a part of the workspace: its ``centre`` and ``radius``, in m (of
            joints: rad), and the ``share`` of the friction that is left there; null: nowhere.
    """

    gain: RatioOfMotors | None = None
    lag: Annotated[Time, NOT_NEGATIVE] | None = None
    write_delay: Annotated[Time, NOT_NEGATIVE] | None = None
    watchdog: Annotated[Ratio, POSITIVE] | None = None
    random: bool = False
    seed: Annotated[int, Range(at_least=0)] = 1
    weak_spot: WeakSpot | None = None


@dataclass(frozen=True, kw_only=True)
class TrueAxes(TrueMotor):
    """True values of a device with independent axes; null: as stated.

    Attributes:
        damping: Viscous damping; one for all axes, or one of each, as are the next four.
        friction: Coulomb friction of each axis by itself.
        presliding: Distance over which friction yields elastically.
        resolution: Resolution of the encoder.
        weight: Of the tip, positive against positive motion.
    """

    damping: DampingOfAxes | None = None
    friction: FrictionOfAxes | None = None
    presliding: LengthOfAxes | None = None
    resolution: LengthOfAxes | None = None
    weight: ForceOfAxes | None = None


@dataclass(frozen=True, kw_only=True)
class TrueJoints(TrueMotor):
    """True values of an arm; null: as stated.

    Attributes:
        damping: Viscous damping of the joints; one number, or one of each, as are the next three.
        friction: Coulomb friction of each joint by itself.
        presliding: Angle over which friction yields elastically.
        resolution: Resolution of the encoder.
    """

    damping: DampingOfJoints | None = None
    friction: TorqueOfJoints | None = None
    presliding: AngleOfJoints | None = None
    resolution: AngleOfJoints | None = None


@dataclass(frozen=True, kw_only=True)
class TrueServos(TrueJoints):
    """True values of emulated servos; null: as stated.

    Attributes:
        gain: Of a servo, its true torque constant over the one that is stated; one, or one of each.
        supply: Voltage of the supply, in V; null: that of the data sheet, or the largest stated.
        sag: What the supply loses for each A that the servos take together, in ohm.
        latency: Time that the converter at the USB port keeps what comes from the servos.
    """

    supply: Annotated[Ratio, POSITIVE] | None = None
    sag: Annotated[Ratio, NOT_NEGATIVE] = 0.0
    latency: Annotated[Time, NOT_NEGATIVE] = 0.0


class TrueNumbers(NamedTuple):
    """True numbers of a simulated device; vectors have one number of each axis.

    Coordinates are those of :class:`forcebound.haptics.laws.dissipation.StatedNumbers`.
    """

    damping: Vector  # N s/m
    friction: Vector  # N, of each axis by itself
    presliding: Vector  # m
    resolution: Vector  # m
    weight: Vector  # N
    gain: Vector  # of what is commanded of the motor
    lag: float  # s
    write_delay: float  # s; with a seed the longest
    watchdog: float  # hold limits after which it drops a force; not with a seed
    seed: int | None  # of random write delays and times of the watchdog
    weak_spot: WeakSpot | None
