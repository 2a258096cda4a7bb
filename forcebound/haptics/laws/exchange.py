"""Energy that leaves a ledger for another one: how much there is to spare, and the debit.

Both are called between the decision about a force and its write. After a debit the force is decided
again, with what is left. So to the law a debit is a ledger that has earned less;
``docs/theory.md``, section 3.7, has the proof.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import TypeAlias

from forcebound.compiled import jit
from forcebound.errors import ConfigError
from forcebound.haptics.laws.all_axes import Ledgers
from forcebound.haptics.laws.allowance import largest_force, surplus
from forcebound.haptics.laws.law import BoundingLaw
from forcebound.haptics.laws.ledger import Ledger

#: J; debits are multiples of it, so sums of them up to 131 kJ have no rounding error.
GRAIN = 2.0**-36

Spare: TypeAlias = Callable[[Ledgers, float], float]
Debit: TypeAlias = Callable[[Ledgers, float], tuple[float, float]]


@cache
def compiled_exchange(law: BoundingLaw) -> tuple[Spare, Debit]:
    """Return what a bounder does to give energy, compiled; ConfigError if the law cannot.

    ``spare(ledgers, magnitude) -> J`` is what there is beyond the need of the commanded force, of
    ``magnitude`` N. ``debit(ledgers, most) -> (J, N)`` takes at most so much; it returns what it
    took, and the largest force that is left.
    """
    if not law.exchanges:
        raise ConfigError("this law cannot exchange energy with another hand")
    if law.limits_holds:
        return jit(_spare_of_holds), jit(_debit_of_holds)
    return jit(_spare_of_state), jit(_debit_of_state)


def _spare_of_holds(ledgers: Ledgers, magnitude: float) -> float:
    return _left(ledgers[0], min(magnitude, ledgers[0].saturation))


def _debit_of_holds(ledgers: Ledgers, most: float) -> tuple[float, float]:
    ledger = ledgers[0]
    # Even without a new force, the old one of an amplifier with a lag decays: that stays paid.
    taken = whole_grains(min(most, _left(ledger, 0.0)))
    for end in range(ledger.ends):
        ledger.state[end] -= taken
        ledger.available[end] -= taken
    return taken, min(largest_force(ledger), ledger.saturation)


def _left(ledger: Ledger, force: float) -> float:
    """Return what a hold of ``force``, in N, in the commanded direction leaves, in J."""
    left = surplus(ledger, 0, force)
    return min(left, surplus(ledger, 1, force)) if ledger.ends == 2 else left


def _spare_of_state(ledgers: Ledgers, magnitude: float) -> float:
    return ledgers[0].state[0]


def _debit_of_state(ledgers: Ledgers, most: float) -> tuple[float, float]:
    taken = whole_grains(min(most, ledgers[0].state[0]))
    ledgers[0].state[0] -= taken
    return taken, ledgers[0].saturation


def whole_grains(energy: float) -> float:
    """Return an energy, in J, rounded down to a multiple of ``GRAIN``; at least 0."""
    return math.floor(energy / GRAIN) * GRAIN if energy > 0.0 else 0.0
