r"""The stiffness that a hand felt, of what the environment has, and what took the rest.

In a wall of stiffness K, at the depth x, the hand should feel K x. The answer in use belongs to an
earlier state, of depth x'; it gives the commanded force F_c, of which saturation and law leave F_a:

.. math:: K x - F_a = K (x - x') + (K x' - F_c) + (F_c - F_a)

The first part is of late answers, the second of controller and environment; where no answer is in
use, both are of missing answers. The last part is of the law, or of the saturation if the law left
the force as it was. A force that one of the two has cut would be no larger with a punctual answer,
so there the parts before are none, unless the hand felt more than K x.

Two parts are of missed ticks. A silent or reporting watchdog drops the force of a hold longer than
the hold limit L until the next write: F_a (1 - L / interval). (A guarding one drops it only once
the hand yields.) And with ``device.hold_limit: auto`` a certified law plans its forces for the late
ticks: it gives at most f_c + 2 sqrt(b G / L) for a ledger of G, so with the *same ledger* it would
have given up to sqrt(L / L_0) F_a on a punctual clock.

The law's part is then split by what the law lacked (:mod:`forcebound.results.little_force`): what
each cause takes in the twin of the run, also by emptying the ledger, and little dissipation for the
rest.
"""

from typing import NamedTuple

import numpy as np

from forcebound.results.contact import says_something, steady_window
from forcebound.results.little_force import split_by_causes
from forcebound.results.samples import Samples
from forcebound.results.surface import Floats

DROPPING = ("silent", "reporting", None)  # watchdogs; None: not stated
ROUNDING = 1e-9  # of a force
LARGEST_GAIN = 0.1  # of the losses


class Stiffness(NamedTuple):
    """What a hand felt of a stiffness: means over the samples in contact of the steady window."""

    asked: float  # N/m, of the environment, where the hand feels it
    felt: float  # N/m
    shares: dict[str, float] | None  # by what took the rest, largest first, together 1


def felt_stiffness(run: Samples) -> Stiffness | None:
    """Return what a run's hand felt of the stiffness; None without contact in the window."""
    surface, columns = run.surface, run.columns
    assert surface.stiffness is not None
    chosen = run.contact & steady_window(run.time) & (surface.stiffness > 0.0)
    if not chosen.any():
        return None
    commanded, saturated = surface.along(columns.commanded_force), surface.along(run.saturated)
    applied, asked = run.normal_force, surface.stiffness * run.depth
    age = columns.reply_age
    is_answered = np.isfinite(age) & (columns.engagement > 0.0)
    depth_then = np.interp(run.time - np.nan_to_num(age), run.time, run.depth)
    answered = surface.stiffness * np.maximum(depth_then, 0.0)
    limit, shortest = run.hold_limits
    interval = np.diff(run.time, append=run.time[-1:] + 1.0 / run.rate)
    drops = run.device.watchdog in DROPPING
    dropped = applied * (1.0 - np.minimum(1.0, limit / interval)) if drops else 0.0 * applied
    planned = np.clip((np.sqrt(limit / shortest) - 1.0) * applied, 0.0, saturated - applied)
    by_law = saturated - applied > ROUNDING * np.abs(saturated)
    by_motor = (commanded - saturated > ROUNDING * np.abs(commanded)) & ~by_law
    loss, is_cut = asked - applied, by_law | by_motor
    before = np.where(is_cut, np.minimum(loss, 0.0), loss)
    missing = np.where(is_answered, 0.0, before)
    ramp = np.where(is_answered & ~is_cut, (1.0 - columns.engagement) * answered, 0.0)
    late = np.where(is_cut, np.clip(asked - answered, before, 0.0), asked - answered)
    late = np.where(is_answered, late, 0.0)
    lost = {
        "law": np.where(by_motor, 0.0, loss - before) - planned,
        "saturation": np.where(by_motor, loss - before, 0.0),
        "late answers": late,
        "missing answers": missing,
        "missed ticks": dropped + planned,
        "engage ramp": ramp,
        "controller or environment": before - late - missing - ramp,
    }
    weights = np.where(chosen, interval, 0.0)

    def mean(force: Floats) -> float:
        return float(np.average(force[chosen] / run.depth[chosen], weights=weights[chosen]))

    felt, stiffness = mean(applied - dropped), mean(asked)
    shares = _shares({name: float(weights @ part) for name, part in lost.items()})
    if shares is not None and "law" in shares and run.causes:
        shares = split_by_causes(shares, run.causes, stiffness - felt)
    return Stiffness(stiffness, felt, shares)


def felt_share(run: Samples) -> float | None:
    """Return the share of the stiffness that a run's hand felt; None without one that is known."""
    felt = felt_stiffness(run)
    if felt is None or not says_something(felt.felt, felt.asked, run.is_at_rest):
        return None
    return felt.felt / felt.asked


def _shares(lost: dict[str, float]) -> dict[str, float] | None:
    """Return the shares of the losses; None where gains are more than a tenth of them.

    Such gains are of late answers, which push a hand that bounces on its way out.
    """
    losses = {name: part for name, part in lost.items() if part > 0.0}
    whole, net = sum(losses.values()), sum(lost.values())
    if net < (1.0 - LARGEST_GAIN) * whole or not whole:
        return None
    return {
        name: losses[name] / whole for name in sorted(losses, key=losses.__getitem__, reverse=True)
    }
