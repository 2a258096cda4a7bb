"""The stiffest spring and damper that a device can show without a law and stay passive."""


def colgate_schenkel(
    damping: float, period: float, wall_damping: float = 0.0, delay: float = 0.0
) -> float:
    r"""Return the stiffest passive wall, in N/m; 0 if none is passive.

    .. math:: K \le \frac{b - |B|}{T / 2 + t_d}

    Args:
        damping: b of the device, in N s/m.
        period: T, in s.
        wall_damping: B, in N s/m, from a backward difference.
        delay: t_d from reading to writing, in s.

    Source: J. E. Colgate and G. Schenkel, Passivity of a class of sampled-data systems: application
    to haptic interfaces, Journal of Robotic Systems 14(1), 1997.
    """
    return max((damping - abs(wall_damping)) / (0.5 * period + delay), 0.0)
