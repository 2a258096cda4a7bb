"""Measures of energy: its largest fall, what a contact gave back, the passivity observer.

Pure functions of arrays. Energy is what has flowed from the hand into the device, in J; NaN: it is
unknown. The minimum since the start cannot show what a law gives back of energy that it saved
before; the largest fall can.
"""

from dataclasses import dataclass

import numpy as np

from forcebound.analysis.surface import Floats

POWER_WINDOW = 10  # samples over which the observed power is a mean: one step of an encoder in one
#                    sample is 0.2 W at 8 N


@dataclass(frozen=True)
class Fall:
    """A fall of energy and what follows it."""

    energy: float  # J
    time_to_regain: float | None  # s from its end until the energy is back; None: not in the run


def largest_fall(time: Floats, energy: Floats) -> Fall | None:
    r"""Return the most energy that the hand got back at a stretch.

    .. math:: \max_{s \le t} \, E(s) - E(t)

    A spring that is released gives back what was put in: this is no leak. It is what the hand has
    to hold against. The first of several; None without ground truth.
    """
    if not energy.size or not np.isfinite(energy).all():
        return None
    highest = np.maximum.accumulate(energy)
    end = int(np.argmax(highest - energy))
    back = np.flatnonzero(energy[end:] >= highest[end])
    regained = float(time[end + back[0]] - time[end]) if back.size else None
    return Fall(float(highest[end] - energy[end]), regained)


def since_contact(
    time: Floats, energy: Floats, position: Floats, contact: int, mass: float
) -> float | None:
    r"""Return the lowest energy since first contact, against what the device brought into it, in J.

    .. math:: \min_{t \ge t_c} E(t) - \left( E(t_c) - \tfrac{1}{2} m \, v(t_c)^2 \right)

    Below zero, contact has given the hand more than it took, whatever friction took on the way to
    the wall. With a law that saves (``certified``) this may be so in a passive run: it spends what
    it has saved. The kinetic energy is that of the faster of the two sample intervals at ``t_c``,
    so it is never too small for a speed that only rises or only falls.

    Args:
        time: In s, shape ``(n,)``.
        energy: In J, same shape.
        position: True position, in m, shape ``(n, axes)``.
        contact: Index of the first sample in contact; ``t_c`` is the sample before.
        mass: Apparent mass of the device, in kg.
    """
    if not np.isfinite(energy[contact:]).all():
        return None
    before = max(contact - 1, 0)
    around = slice(max(before - 1, 0), before + 2)
    moves = np.diff(position[around], axis=0) / np.diff(time[around])[:, np.newaxis]
    speed = float(np.linalg.norm(moves, axis=1).max(initial=0.0)) if contact else 0.0
    brought = float(energy[before]) - 0.5 * mass * speed**2 if contact else 0.0
    return float(energy[contact:].min()) - brought


@dataclass(frozen=True)
class Observed:
    """Findings of the passivity observer."""

    energy_min: float  # J
    power_min: float | None  # W, mean over 10 samples; None: a shorter run
    deficit_share: float  # of the samples, those with an energy below zero


def observe(time: Floats, force: Floats, position: Floats) -> Observed | None:
    r"""Return what a passivity observer at the motor reports of a run.

    .. math:: E(n) = \sum_{k=1}^{n} F(k-1) \cdot (q(k) - q(k-1))

    the energy that the motor took, from what a device measures: readings and applied forces. Below
    zero, the motor has given energy; the device's own friction and damping may have covered it.

    Time, in s, has shape ``(n,)``; applied force, in N, and reading, in m, ``(n, axes)``. None with
    fewer than two samples.

    Source: Hannaford and Ryu, Time-domain passivity control of haptic interfaces, IEEE Transactions
    on Robotics and Automation 18(1), 2002, Eq. 6, with the exact work of a held force.
    """
    if time.size < 2:
        return None
    work = np.sum(force[:-1] * np.diff(position, axis=0), axis=1)
    energy = np.concatenate(([0.0], np.cumsum(work)))
    power = (energy[POWER_WINDOW:] - energy[:-POWER_WINDOW]) / (
        time[POWER_WINDOW:] - time[:-POWER_WINDOW]
    )
    return Observed(
        float(energy.min()),
        float(power.min()) if power.size else None,
        float(np.mean(energy < 0.0)),
    )
