r"""Theoretical limits of the stiffest passive wall, for maps of simulated runs.

All of these are for an elastic wall of stiffness K, a device of mass, viscous damping b and Coulomb
friction f_c, a force held for a period T, and no bounding law. None includes saturation, a
one-sided wall or a particular hand: they guarantee passivity with *any* hand, so a simulation with
one hand may stay passive beyond them. A simulation must not leak *below* them; stiffness above them
is due to the law.

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

import math

from forcebound.haptics.controllers.passivity import colgate_schenkel
from forcebound.lab.engine import Row

LABELS = {
    "colgate_schenkel": "Colgate & Schenkel 1997",
    "abbott_okamura": "Abbott & Okamura 2005",
    "diolaiti": "Diolaiti et al. 2006",
    "with_hand": "Colgate & Schenkel, with the hand's damping",
    "encoder": "encoder: 2 f_c / resolution",
}


def encoder(friction: float, resolution: float) -> float:
    """Return the stiffest wall that gives no energy over two edges, in N/m; ``resolution`` in m."""
    return 2.0 * friction / resolution if resolution > 0.0 else math.inf


def diolaiti(
    damping: float, friction: float, period: float, resolution: float, delay: float
) -> float:
    """Return the stiffest passive wall, in N/m; ``delay`` from reading to writing, in s."""
    by_delay = colgate_schenkel(damping, period, delay=delay)
    return min(by_delay, encoder(friction, resolution))


def limit_of(row: Row, name: str) -> float:
    """Return a limit for the case of a row, in N/m.

    Args:
        row: Of the result of a sweep: its resolved parameters and its loop delay.
        name: A key of :data:`LABELS`.
    """
    damping, friction = row["device.damping"], row["device.friction"]
    period, resolution = 1.0 / row["device.rate"], row["device.resolution"]
    delay = (row["loop_delay_ms.p50"] or 0.0) * 1e-3
    wall, hand = (row.get(f"{part}.damping") or 0.0 for part in ("environment", "operator"))
    return {
        "colgate_schenkel": colgate_schenkel(damping, period, wall, delay),
        "with_hand": colgate_schenkel(damping + hand, period, wall, delay),
        "encoder": encoder(friction, resolution),
        "abbott_okamura": diolaiti(damping, friction, period, resolution, 0.0),
        "diolaiti": diolaiti(damping, friction, period, resolution, delay),
    }[name]
