"""Measures of energy: its largest fall, what a contact gave back, the passivity observer.

Pure functions of arrays. Energy is what has flowed from the hand into the device, in J; NaN: it is
unknown. The minimum since the start cannot show what a law gives back of energy that it saved
before; the largest fall can.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from forcebound.results.surface import Floats

POWER_WINDOW = 10  # samples over which the observed power is a mean: one step of an encoder in one
#                    sample is 0.2 W at 8 N
BESIDE = 8  # holds on either side of others that change what is known of these
SHORTEST = 1e-6  # s between two readings; less is none


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


class Holds(NamedTuple):
    """What is known of when and where the forces of a motor acted, one row per sample.

    Coordinates may be joints: then N m for N, and rad for m.
    """

    read: Floats  # s, when the readings were latched, (n,); they grow
    write: Floats  # s, from when on the forces acted, (n,)
    end: Floats  # s, when they were dropped, (n,); infinite: not before the next one acts
    lag: float  # s, time constant of the motor
    force: Floats  # N, (n, axes)
    reading: Floats  # m, (n, axes)
    resolution: float | Floats  # m, step of the readings; of each axis
    late: Floats  # s, by which each force may act at another place than its stamp says, (n,)


@dataclass(frozen=True)
class Observed:
    """Findings of the passivity observer."""

    energy_min: float  # J
    error: float  # J, by which the true minimum may be lower
    power_min: float | None  # W, mean over 10 samples; None: a shorter run
    deficit_share: float  # of the samples, those with an energy below zero


def observe(holds: Holds) -> Observed | None:
    r"""Return what a passivity observer at the motor reports of a run.

    .. math:: E(n) = \sum_{k=1}^{n} F(k-1) \cdot (x(e_{k-1}) - x(b_{k-1}))

    the energy that the motor took, from what a device measures: the force acted from b to e, and
    x is interpolated between the readings at their stamps. Below zero, the motor has given energy;
    the device's own friction and damping may have covered it.

    An error of x by at most d, where the force changes by dF, is one of the energy by at most
    ``|dF| d``. So the errors of readings cost as much as in the ledger (docs/theory.md, lemma 2):
    half a resolution; what the hand moves while the stamps are not certain; and how far the path
    may depart from a straight line: an eighth of the second difference at a steady acceleration,
    twice that here, since the force changes on the way. This last part is an estimate.

    None with fewer than two samples.

    Source: Hannaford and Ryu, Time-domain passivity control of haptic interfaces, IEEE Transactions
    on Robotics and Automation 18(1), 2002, Eq. 6, with the exact work of a held force.
    """
    if holds.read.size < 2:
        return None
    begin, work, error, doubt = _accounts(holds)
    energy = np.concatenate(([0.0], np.cumsum(work)))
    error = np.concatenate(([0.0], np.cumsum(error))) + doubt
    power = (energy[POWER_WINDOW:] - energy[:-POWER_WINDOW]) / (
        begin[POWER_WINDOW:] - begin[:-POWER_WINDOW]
    )
    return Observed(
        float(energy.min()),
        float(energy.min() - (energy - error).min()),
        float(power.min()) if power.size else None,
        float(np.mean(energy < 0.0)),
    )


class MotorAccount:
    """The same observer of a run that goes on: the energy of a motor from its first force on.

    Attributes:
        energy_min: Lowest energy that it took so far, in J.
        error: By which the true minimum may be lower, in J.
    """

    def __init__(self) -> None:
        self.energy_min = self.error = 0.0
        self._energy = self._error = self._least = 0.0
        self._has_begun = False

    def take(self, holds: Holds) -> None:
        """Take the next holds, with the ``BESIDE`` before and behind them, which are known too."""
        _, work, error, doubt = _accounts(holds)
        inner = slice(BESIDE if self._has_begun else 0, -BESIDE)
        energies = self._energy + np.cumsum(work[inner])
        errors = self._error + np.cumsum(error[inner])
        if energies.size:
            self._has_begun = True
            self._energy, self._error = float(energies[-1]), float(errors[-1])
            least = (energies - errors - doubt[1:][inner]).min()
            self._least = min(self._least, float(least))
            self.energy_min = min(self.energy_min, float(energies.min()))
            self.error = self.energy_min - self._least


def _accounts(holds: Holds) -> tuple[Floats, Floats, Floats, Floats]:
    """Return when the forces act; work and error of each hold; the error of the one that goes on.

    Shapes are ``(n,)``, those of work and error ``(n - 1,)``.
    """
    # A lag shifts a step by its time constant. Beyond the last reading no path is known.
    begin = np.minimum(holds.write + holds.lag, holds.read[-1])
    end = np.clip(holds.end[:-1] + holds.lag, begin[:-1], begin[1:])
    force, kept = holds.force, np.where((end < begin[1:])[:, np.newaxis], 0.0, holds.force[:-1])
    doubt = _doubt(holds)
    begins, ends = (
        [_at(times, holds.read, values) for values in (holds.reading, doubt)]
        for times in (begin, end)
    )
    work = np.sum(force[:-1] * (ends[0] - begins[0][:-1]), axis=1)
    before = np.concatenate((np.zeros_like(force[:1]), kept))
    changed = _dot(force - before, begins[1])[:-1] + _dot(force[:-1] - kept, ends[1])
    return begin, work, changed, _dot(before, begins[1])


def _doubt(holds: Holds) -> Floats:
    """Return how far the path may be from the readings, on each axis, in m, (n, axes)."""
    moves = np.diff(holds.reading, axis=0)
    speed = np.abs(moves) / np.maximum(np.diff(holds.read), SHORTEST)[:, np.newaxis]
    bend = np.abs(np.diff(moves, axis=0, prepend=moves[:1], append=moves[-1:])) / 4.0
    fastest = np.maximum(np.concatenate((speed[:1], speed)), np.concatenate((speed, speed[-1:])))
    widest = np.maximum(bend, np.concatenate((bend[1:], bend[-1:])))
    return np.asarray(0.5 * holds.resolution + fastest * holds.late[:, np.newaxis] + widest)


def _at(times: Floats, known: Floats, values: Floats) -> Floats:
    """Return values, (n, axes), at other times."""
    return np.stack([np.interp(times, known, column) for column in values.T], axis=1)


def _dot(force: Floats, path: Floats) -> Floats:
    return np.asarray(np.sum(np.abs(force) * path, axis=1))
