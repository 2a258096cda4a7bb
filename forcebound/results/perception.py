"""Limits of human touch: vibration thresholds, and the least difference that is felt.

Numbers from psychophysics, each with its source. They are means over a few people in a laboratory:
an order of magnitude, not a promise.
"""

import numpy as np
from msgspec import Struct

from forcebound.results.cells import Summary
from forcebound.results.surface import Floats

#: Smallest fraction of a figure whose change is felt.
WEBER_FRACTIONS: dict[str, tuple[float, str]] = {
    # Jones and Hunter, A perceptual analysis of stiffness, Experimental Brain Research 79, 1990.
    "displayed_stiffness_n_per_m": (0.23, "Jones and Hunter 1990"),
    # Pang, Tan and Durlach, Manual discrimination of force using active finger motion, Perception
    # and Psychophysics 49(6), 1991: about 7 % from 2.5 to 10 N.
    "peak_force_n": (0.07, "Pang, Tan and Durlach 1991"),
}

THRESHOLD = 1e-7  # m, peak, at 250 Hz; Verrillo 1963
LOW, BEST = 40.0, 250.0  # Hz: flat below, -12 dB per octave between, +9 dB per octave above


def vibration_threshold(frequency: Floats) -> Floats:
    """Return the smallest displacement that is felt as vibration, in m (peak of a sine).

    Flat up to 40 Hz, then 12 dB per octave down to 0.1 um at 250 Hz, then 9 dB per octave up. A
    hand that grasps a handle may be ten times as sensitive (Brisben, Hsiao and Johnson, Journal of
    Neurophysiology 81, 1999), so vibration 20 dB below this is not felt by anybody, and vibration
    above it by everybody.

    Source: Verrillo, Effect of contactor area on the vibrotactile threshold, Journal of the
    Acoustical Society of America 35, 1963, contactor of 2.9 cm2.
    """
    octaves = np.log2(np.maximum(frequency, LOW) / BEST)
    decibels = np.where(octaves < 0.0, -12.0 * octaves, 9.0 * octaves)
    return np.asarray(THRESHOLD * 10.0 ** (decibels / 20.0))


class Difference(Struct, frozen=True):
    """By how much a figure of a run differs from that of the reference."""

    figure: str
    difference: float  # a fraction of the reference
    weber_fraction: float
    is_perceptible: bool | None  # None: a hand was not at rest, so that its mean says nothing
    source: str


def differences(reference: Summary, other: Summary) -> list[Difference]:
    """Return the differences of the figures of :data:`WEBER_FRACTIONS` that both runs have."""
    found, is_known = [], False not in (reference.get("at_rest"), other.get("at_rest"))
    for figure, (fraction, source) in WEBER_FRACTIONS.items():
        before, after = reference[figure], other[figure]
        if before and after is not None:
            difference = after / before - 1.0
            is_felt = abs(difference) >= fraction if is_known or "force" in figure else None
            found.append(Difference(figure, difference, fraction, is_felt, source))
    return found
