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
``viscous_path``       increase of the least ∫\|v\|² dt that the readings prove, m²/s
                       (:func:`least_viscous_path`); 0 when the hold limit was exceeded
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
        limit: ``(state, asked, elapsed, distance, viscous_path, path, work, held, held_sum,
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


#: Samples after which the younger of two anchors takes the place of the older. With eight,
#: two anchors gain 97 % of what 64 would, in displayed stiffness (``docs/theory.md``, section 3).
ANCHOR_SAMPLES = 8


def clear_square(reading: float, anchor: float, half_resolution: float) -> float:
    """Return the square, in m², of what of a move cannot be quantisation, which is at most 2r."""
    clear = max(abs(reading - anchor) - 2.0 * half_resolution, 0.0)
    return clear * clear


def least_viscous_path(
    proven: float,
    step_square: float,
    elapsed: float,
    older_square: float,
    older_age: float,
    younger_square: float,
    younger_age: float,
    between: float,
) -> float:
    r"""Return the least :math:`\int |v|^2 dt` since the older anchor, in m²/s.

    .. math:: V = \max\Big(V + \frac{c_1^2}{dt}, \frac{c_a^2}{t - t_a},
                           V_{ab} + \frac{c_b^2}{t - t_b}\Big),
              \qquad c^2 = \sum_i (|q_i - q_{before,i}| - 2r)_+^2

    A slow hand moves by about one step of the encoder a sample, and one step proves nothing: the
    true position may have been at one edge of the reading's cell and now be at the other. Over
    several samples the same 2r is lost only once. By Cauchy-Schwarz each term is a lower bound; so
    is the largest.

    Args:
        proven: V so far, since the older anchor a.
        step_square: :math:`c_1^2`, in m², from the last sample: sum of :func:`clear_square` over
            the axes.
        elapsed: dt, time since the last sample, in s, positive.
        older_square: :math:`c_a^2`, in m², from the older anchor.
        older_age: Time since the older anchor, in s, positive.
        younger_square: :math:`c_b^2`, in m², from the younger anchor b.
        younger_age: Time since the younger anchor, in s, positive.
        between: :math:`V_{ab}`: what was proven from the older anchor to the younger.
    """
    return max(
        proven + step_square / elapsed,
        older_square / older_age,
        between + younger_square / younger_age,
    )


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
