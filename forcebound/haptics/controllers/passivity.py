"""The stiffest spring and damper that a device can show without a law and stay passive."""


def colgate_schenkel(
    damping: float, period: float, wall_damping: float = 0.0, delay: float = 0.0
) -> float:
    r"""Return the stiffest passive wall, in N/m; 0 if none is passive.

    .. math:: K \le \frac{b - |B|}{T / 2 + t_d}

    with the device's damping b, the period T, the wall's damping B from a backward difference, and
    the delay :math:`t_d` from reading to writing.

    Source: J. E. Colgate and G. Schenkel, Passivity of a class of sampled-data systems: application
    to haptic interfaces, Journal of Robotic Systems 14(1), 1997.
    """
    return max((damping - abs(wall_damping)) / (0.5 * period + delay), 0.0)
