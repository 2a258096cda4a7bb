"""Prices of errors of gains and weights (``docs/theory.md``, section 3.2)."""

from forcebound.haptics.laws.ledger import Ledger


def spread_price(ledger: Ledger) -> float:
    """Return what motors with different gains can give beyond motors with the same gain, in J."""
    total = magnitudes = 0.0
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        work = axis.work - axis.constants.half_resolution * abs(axis.memory.mean_force)
        total += work
        magnitudes += abs(work)
    return ledger.gain * (magnitudes - abs(total))


def drift_price(ledger: Ledger) -> float:
    """Return what an error of the weights can have given since the start, in J."""
    price = 0.0
    for k in range(ledger.axes):
        one = ledger.axis[k].constants
        distance = abs(ledger.reading[k] - ledger.axis[k].origin)
        price += one.weight_error * (distance + 2.0 * one.half_resolution)
    return price
