r"""What a bounding law is: four pure functions of numbers, and what it may know of the device.

The functions take and return floats only and use nothing but arithmetic and :mod:`math`, so that
the very same function objects run in plain Python in the live node, and compiled in audits and
sweeps.

Arguments that are the same for all laws:

=====================  =======================================================================
``state``              the law's one remembered number: an energy, in J (or a stiffness, in N/m)
``asked``              \|F_e(n)\|, N: magnitude of the force asked for, already saturated
``elapsed``            measured time since the last sample, s, positive
``distance``           \|Δq\|, m: how far the reading has moved since the last sample
``clear_square``       Σ_i max(\|Δq_i\| - 2r, 0)², m²: what of it cannot be quantisation
``path``               increase of ‖(path_1, ..., path_n)‖₂, m; path_i is the way that the play
                       operator of axis i has gone; 0 when the hold limit was exceeded
``work``               F(n-1)·Δq, J
``held``               ‖F(n-1)‖₂, N: force held since the last sample
``held_sum``           Σ_i \|F_i(n-1)\|, N; 0 in ``settle`` when the hold limit was exceeded
``applied``            ‖F(n)‖₂, N: force written at this sample
``change_sum``         Σ_i \|F_i(n) - F_i(n-1)\|, N; F(n-1) = 0 when the hold limit was exceeded
parameters             ``damping`` b, N s/m; ``friction`` f_c, N; ``half_resolution`` r, m;
                       ``period`` T, s; ``hold_limit`` T_max, s; ``axes`` number of axes
=====================  =======================================================================
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from forcebound.errors import ConfigError

#: The constants of a device as the functions of a law take them, in this order.
Parameters: TypeAlias = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Dissipation:
    """What a law may rely on about a device: the least that it dissipates, and its sampling.

    Attributes:
        damping: Minimum viscous damping b, in N s/m.
        friction: Minimum Coulomb friction f_c, in N.
        resolution: Step of the position reading Δ, in m; 0: exact readings.
        period: Nominal sampling period T, in s.
        hold_limit: Longest time T_max that the device holds a force, in s; it then drops it to 0.
        saturation: Largest force F_sat, in N.

    Raises:
        ConfigError: If a value is out of range.
    """

    damping: float
    friction: float
    resolution: float
    period: float
    hold_limit: float
    saturation: float

    def __post_init__(self) -> None:
        for name, unit in (
            ("damping", "N s/m"),
            ("period", "s"),
            ("hold_limit", "s"),
            ("saturation", "N"),
        ):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ConfigError(f"{name} must be > 0 {unit} and finite, got {value} {unit}")
        for name, unit in (("friction", "N"), ("resolution", "m")):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"{name} must be >= 0 {unit} and finite, got {value} {unit}")
        if self.hold_limit < self.period:
            raise ConfigError(
                f"hold_limit must be at least the period, {self.period} s, or every force is cut; "
                f"got {self.hold_limit} s"
            )


@dataclass(frozen=True)
class BoundingLaw:
    """One bounding law; :mod:`forcebound.bounding` says what it promises.

    Attributes:
        summary: One line for lists and legends.
        start: ``(*parameters) -> state`` at the first reading.
        limit: ``(state, asked, elapsed, distance, clear_square, path, work, held, held_sum,
            *parameters) -> (state, largest force in N, added damping in N s/m)``.
        settle: ``(state, applied, change_sum, held_sum, *parameters) -> state`` once the force of
            this sample is known.
        energy: ``(state, held, held_sum, *parameters) -> J``: the energy that the law believes in
            after ``settle``; ``held`` and ``held_sum`` are now of F(n).
        uses_friction: False: the law counts viscous damping alone, f_c = 0.
        is_certified: The bound holds for the physical energy (``docs/theory.md``).
        adds_damping: The law may add a force of its own, so it may exceed what was asked for.
    """

    summary: str
    start: Callable[..., float]
    limit: Callable[..., tuple[float, float, float]]
    settle: Callable[..., float]
    energy: Callable[..., float]
    uses_friction: bool = True
    is_certified: bool = False
    adds_damping: bool = False

    def parameters(self, dissipation: Dissipation, axes: int = 1) -> Parameters:
        """Return the constants that the functions of this law take after their other arguments."""
        return (
            dissipation.damping,
            dissipation.friction if self.uses_friction else 0.0,
            dissipation.resolution / 2.0,
            dissipation.period,
            dissipation.hold_limit,
            float(axes),
        )


def play(reading: float, position: float, half_width: float) -> float:
    r"""Return the new position of the play (backlash) operator.

    .. math:: y' = \max(q - r, \min(q + r, y))

    It moves only when the reading has left it by more than ``half_width``. Its path is the shortest
    of all signals that stay within ``half_width`` of the readings, up to where it starts; so it
    never takes an encoder that chatters on one edge for travel.

    Args:
        reading: New reading q, in m.
        position: Position y of the operator so far, in m.
        half_width: r, in m, half the resolution of the reading.
    """
    return max(reading - half_width, min(reading + half_width, position))


def keep(
    state: float,
    applied: float,
    change_sum: float,
    held_sum: float,
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    """``settle`` of a law that needs no settling: return ``state``."""
    return state


def start_empty(
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    """``start`` of a law whose state is an energy that begins at 0 J."""
    return 0.0


def read_state(
    state: float,
    held: float,
    held_sum: float,
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    """``energy`` of a law whose state is the energy that it believes in, in J."""
    return state
