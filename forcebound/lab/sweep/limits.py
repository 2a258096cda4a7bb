r"""Theoretical limits of the stiffest wall, for maps of simulated runs.

All of these are for an elastic wall of stiffness K, a device of mass, viscous damping b and Coulomb
friction f_c, a force held for a period T, and no bounding law. None includes saturation or a
one-sided wall. Those without a hand guarantee passivity with *any* hand, so a simulation with one
hand may stay passive beyond them. A simulation must not leak *below* them; stiffness above them is
due to the law. A limit is drawn where its conditions (:data:`CONDITIONS`) hold, and nowhere else.

``colgate_schenkel``
    :math:`b > K (T / 2 + t_d) + |B|` with B the wall's damping, computed from a backward
    difference, and :math:`t_d` the delay from reading to writing. J. E. Colgate and G. Schenkel,
    Passivity of a class of sampled-data systems: application to haptic interfaces, Journal of
    Robotic Systems 14(1), 1997. Exact without B for whole samples of delay (``passive_damping``
    in ``tests/test_limits.py``): K T / b = 1 / (1/2 + d); a sufficient condition with B. No
    quantisation. The velocity's low-pass is not in it.
``with_hand``
    The same with the damping of the simulated hand added to that of the device: a limit of
    stability for this hand alone, not of passivity. Below it the hand comes to rest, since its own
    damping takes up the energy that the device gives it.
``gil``
    :math:`K < (b + b_h + B) / (T / 2 + t_d)`, with the damping of the hand: the hand comes to rest,
    and yet the wall need not be passive. J. J. Gil, E. Sanchez, T. Hulin, C. Preusche and G.
    Hirzinger, Stability boundary for haptic rendering: influence of damping and delay, Journal of
    Computing and Information Science in Engineering 9(1), 2009. A linear system without friction
    and quantisation, short delays, fast sampling, low damping; here :math:`(b + b_h + B) (T + t_d)
    \le 0.1\,m`, with the masses of device and hand, where it is within 10 % of the poles of the
    sampled loop (``tests/test_limits.py``). Unlike in the limits of passivity, the wall's damping
    helps.
``encoder``
    :math:`K \le 2 f_c / \Delta`: a cycle over two edges of an encoder of resolution Δ gives
    :math:`(K \Delta - 2 f_c) \epsilon`, however small ε.
``abbott_okamura``
    :math:`K \le \min(2 b / T, 2 f_c / \Delta)`. J. J. Abbott and A. M. Okamura, Effects of position
    quantization and sampling rate on virtual-wall passivity, IEEE Transactions on Robotics 21(5),
    2005. Necessary and sufficient for an undamped wall read by an encoder, without delay.
``diolaiti``
    :math:`K < b / (T / 2 + t_d)` and :math:`K \le 2 f_c / \Delta`. N. Diolaiti, G. Niemeyer, F.
    Barbagli and J. K. Salisbury, Stability of haptic rendering: discretization, quantization, time
    delay, and Coulomb effects, IEEE Transactions on Robotics 22(2), 2006: the region that they call
    passive, in which the energy from hold and delay does not exceed the viscous losses, nor that
    from the encoder's steps the friction. In their further regions (locally stable, limit cycles)
    friction stops a small motion and not a large one: that is where a simulation of one motion has
    its boundary.
"""

import json
import math
from typing import Any

from forcebound.haptics.controllers.passivity import colgate_schenkel
from forcebound.lab.engine import Row

LABELS = {
    "colgate_schenkel": "Colgate & Schenkel 1997",
    "abbott_okamura": "Abbott & Okamura 2005",
    "diolaiti": "Diolaiti et al. 2006",
    "gil": "Gil et al. 2009: a hand at rest",
    "with_hand": "Colgate & Schenkel, with the hand's damping",
    "encoder": "encoder: 2 f_c / resolution",
}
_WALL = "the stiffness of a wall as axis and a device of independent axes"
#: What each needs.
CONDITIONS = dict.fromkeys(LABELS, _WALL) | {
    "abbott_okamura": "an undamped wall that answers within a period",
    "diolaiti": "an undamped wall",
    "gil": "little damping, delay and period for the mass",
}
_WALLS = ("wall", "damped_wall")
_LOW = 0.1  # (b + B) (T + t_d) / m


def encoder(friction: float, resolution: float) -> float:
    """Return the stiffest wall that gives no energy over two edges, in N/m; ``resolution`` in m."""
    return 2.0 * friction / resolution if resolution > 0.0 else math.inf


def diolaiti(
    damping: float, friction: float, period: float, resolution: float, delay: float
) -> float:
    """Return the stiffest passive wall, in N/m; ``delay`` from reading to writing, in s."""
    by_delay = colgate_schenkel(damping, period, delay=delay)
    return min(by_delay, encoder(friction, resolution))


def gil(damping: float, period: float, wall_damping: float, delay: float, mass: float) -> float:
    """Return the stiffest wall at which a hand comes to rest, in N/m; NaN for much damping.

    Args:
        damping: Of device and hand, in N s/m.
        period: Of the servo loop, in s.
        wall_damping: In N s/m, from a backward difference.
        delay: From reading to writing, in s.
        mass: Of device and hand, in kg.
    """
    both = damping + wall_damping
    is_low = both * (period + delay) <= _LOW * mass
    return both / (0.5 * period + delay) if is_low else math.nan


def limit_of(row: Row, name: str) -> float:
    """Return a limit for the case of a row, in N/m; NaN where its conditions do not hold.

    Args:
        row: Of the result of a sweep: its resolved parameters and its loop delay.
        name: A key of :data:`LABELS`.
    """
    if row.get("environment.kind") not in _WALLS or "device.axes" not in row:
        return math.nan
    if row.get("over.stiffness", row["environment.stiffness"]) != row["environment.stiffness"]:
        return math.nan
    damping, friction, resolution = (
        _on_first_axis(row[f"device.{key}"]) for key in ("damping", "friction", "resolution")
    )
    period, delay = 1.0 / row["device.rate"], (row["loop_delay_ms.p50"] or 0.0) * 1e-3
    wall, hand = (row.get(f"{part}.damping") or 0.0 for part in ("environment", "operator"))
    mass = row["device.mass"] + (row.get("operator.mass") or 0.0)
    without_delay = diolaiti(damping, friction, period, resolution, 0.0)
    return {
        "colgate_schenkel": colgate_schenkel(damping, period, wall, delay),
        "with_hand": colgate_schenkel(damping + hand, period, wall, delay),
        "gil": gil(damping + hand, period, wall, delay, mass),
        "encoder": encoder(friction, resolution),
        "abbott_okamura": math.nan if wall or delay >= period else without_delay,
        "diolaiti": math.nan if wall else diolaiti(damping, friction, period, resolution, delay),
    }[name]


def _on_first_axis(number: Any) -> float:
    """Return a number of a device, or of its first axis: a table has a list as its text."""
    return float(json.loads(number)[0] if isinstance(number, str) else number)
